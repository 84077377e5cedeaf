"""Facts that every judgement of a recording rests on, in words."""

import numpy as np
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.sizing import UNKNOWN_CONSTANT
from power_estimator.effects.training import LEAST_SECONDS
from power_estimator.posterior.priors import LEAST_TO_JUDGE


def notes(prepared: Prepared) -> list[str]:
    """Sentences on what limits a fit: little data, one meter, torque computed from a current."""
    found = []
    if prepared.steady:
        without = [effect.name for effect in builtin_catalogue().values() if effect.needs_time]
        found.append(
            f'{prepared.extent} of a steady recording, each a row of its own: not offered are '
            f'{", ".join(without)} and a winding that warms unmeasured, which all show '
            'while something changes'
        )
    elif prepared.seconds < LEAST_SECONDS:
        found.append(
            f'{prepared.seconds:.1f} s are little: believe the intervals, not the values; '
            f'diagnose needs {LEAST_TO_JUDGE:.0f} s'
        )
    if prepared.whole and len(prepared.signals.names) > 1:
        found.append(
            'only the power of the whole robot was measured: the drives share it by how they '
            'move, drives that move alike cannot be told apart, and idle is the constant of the '
            'robot, spread evenly'
        )
    elif prepared.whole:
        found.append('the power of the whole robot was measured: idle has its electronics in it')
    if prepared.reducer.window:
        found.append(
            f'the meter is slow: energy over {prepared.reducer.window:.1f} s was judged, nothing '
            'faster'
        )
    for name, constant in zip(prepared.signals.names, prepared.torque_constant, strict=True):
        if constant == UNKNOWN_CONSTANT:
            found.append(f'{name} turns too little to tell its torque constant; taken as 1 N·m/A')
        elif np.isfinite(constant):
            found.append(f'{name}: {constant:.3g} N·m/A, from the power that its current makes')
    return found
