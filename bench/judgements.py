"""
Judgements that the benchmark of reliability scores, and the lab of today as one that judges.

A judge is a function (AlignedDataset, effects of the base model) -> Judgement; the benchmark takes
any by `--judge module:function`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from math import hypot
from typing import Any

from power_recordings.alignment.dataset import AlignedDataset

LEVELS = (0.5, 0.8, 0.95)


@dataclass(frozen=True)
class Statement:
    """Claim that an effect, or an error of the measurement, is missing from the model."""

    effect: str  # of the catalogue, or torque_scale, power_gain, current_offset, torque_bias
    probability: float


@dataclass(frozen=True)
class Interval:
    """Claim that a coefficient of a drive lies between two values."""

    drive: str
    coefficient: str  # as in `truths`: k, inertia, idle, spring, friction_at_1, load_friction, …
    level: float  # 0.5, 0.8 or 0.95
    low: float
    high: float


@dataclass(frozen=True)
class Judgement:
    """Everything that a judge says of a recording; what it is silent about has probability 0."""

    statements: tuple[Statement, ...] = ()
    intervals: tuple[Interval, ...] = ()
    words: str = ''  # verdict, for the reader


Judge = Callable[[AlignedDataset, Sequence[str]], Judgement]


def plugged_in(name: str) -> Judge:
    """Return the judge `module:function`; ValueError for a name without a colon."""
    module, colon, function = name.partition(':')
    if not colon:
        raise ValueError(f'--judge {name!r}: give module:function')
    judge: Judge = getattr(import_module(module), function)
    return judge


def diagnosed(data: AlignedDataset, known: Sequence[str]) -> Judgement:
    """Today's `diagnose` and `fit`: 0.97 for what is named, and the intervals at 95 % of `fit`."""
    from power_estimator.effects import builtin_catalogue
    from power_estimator.effects.fit.design import Active
    from power_estimator.effects.fit.fitter import measurement_terms
    from power_estimator.effects.training import fit_model, material
    from power_lab.diagnose.diagnosis import Diagnoser
    from power_lab.diagnose.probable import probable, with_names

    catalogue = builtin_catalogue()
    given = material(data, per='drive')
    actives = [Active.of(catalogue[name]) for name in known]
    actives = [active for active in actives if active.effect.usable(given.prepared.signals)]
    structure = given.structure(actives)
    terms = measurement_terms(catalogue, shaft=True, steady=given.prepared.steady)
    diagnoser = Diagnoser(given.fitter(per_drive=True), structure.plus(*terms), catalogue)
    found, posterior = diagnoser.run(), probable(given, structure.actives, catalogue, 0.0)
    if posterior is not None:
        found = with_names(found, posterior, diagnoser)
    named = found.effects if found.verdict == 'named' else ()
    model, _ = fit_model('trial', given, actives, catalogue)
    intervals = [one for group in model.groups for one in _intervals(group)]
    words = f'{found.verdict} {" ".join(found.effects)}'.strip()
    return Judgement(tuple(Statement(name, 0.97) for name in named), tuple(intervals), words)


COEFFICIENTS = {
    'copper_loss': 'k',
    'rotor_inertia': 'inertia',
    'idle': 'idle',
    'spring': 'spring',
    'load_friction': 'load_friction',
}


def _intervals(group: Any) -> list[Interval]:
    """Intervals of a drive; the friction at 1 rad/s by its parts, as if they were independent."""
    drive = group.type.name
    out = [
        Interval(drive, name, 0.95, *value.interval)
        for effect, name in COEFFICIENTS.items()
        for value in group.coefficients.get(effect, ())[:1]
    ]
    parts = [
        value
        for effect in ('coulomb_friction', 'viscous_friction')
        for value in group.coefficients.get(effect, ())[:1]
    ]
    if parts:
        centre = sum(value.value for value in parts)
        low = hypot(*(value.value - value.interval[0] for value in parts))
        high = hypot(*(value.interval[1] - value.value for value in parts))
        out.append(Interval(drive, 'friction_at_1', 0.95, centre - low, centre + high))
    return out
