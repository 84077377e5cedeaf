"""The verdict in words."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from power_lab.diagnose.diagnosis import MOST_RIVALS
from power_lab.diagnose.findings import Diagnosis
from power_lab.structure.candidates import CONSTANT_TORQUE
from power_lab.structure.floors import above_floor
from power_lab.structure.words import in_words


def sentence(diagnosis: Diagnosis, before: float, after: float) -> str:
    """
    One sentence that a person understands without the tables.

    before, after: held-out error of the model and with the effects that it lacks, W.
    """
    unexplained = float(np.sqrt(np.mean(diagnosis.unexplained.explained)))
    if diagnosis.verdict == 'named':
        told = f'{_named(diagnosis, before, after)}{_left(diagnosis)}'
        last = diagnosis.steps[-1]
        rivals = last.added == diagnosis.chosen and len(last.members) > MOST_RIVALS
        if rivals and not last.none_possible and above_floor(last.gain, diagnosis.floor):
            told += ' A further effect may be missing; this recording cannot say which.'
        return told
    if diagnosis.verdict == 'ambiguous':
        sure = [name for name in diagnosis.effects if name in diagnosis.certain]
        open_ = [name for name in diagnosis.effects if name not in diagnosis.certain]
        start = (
            f'{_begun(sure)} {_are(sure)} missing, and beside '
            f'{"it" if len(sure) == 1 else "them"} '
            if sure
            else 'Missing is '
        )
        if sure == [CONSTANT_TORQUE]:
            return (
                f'The power shows {in_words(CONSTANT_TORQUE)} that is not in the model, and '
                f'{_joined(open_, "or")} beside it or not; this recording cannot tell them apart '
                f'(the error falls from {before:.2f} to {after:.2f} W with all of them).'
            )
        told = f'{start}one of {_joined(open_, "or")}; this recording cannot tell them apart'
        if diagnosis.beside is None:
            told += f' (the error falls from {before:.2f} to {after:.2f} W with the best of them)'
        return f'{told}{_left(diagnosis)}'
    if diagnosis.verdict == 'none_of_the_above' and diagnosis.chosen == (CONSTANT_TORQUE,):
        return (
            f'The power shows {in_words(CONSTANT_TORQUE)} that is not in the model: with it the '
            f'error on held-out data falls from {before:.2f} to {after:.2f} W. None of the known '
            'effects is needed beside it.'
        )
    if diagnosis.verdict == 'none_of_the_above':
        tail = ''
        if diagnosis.chosen:
            verb = 'explains' if len(diagnosis.chosen) == 1 else 'explain'
            tail = f' {_begun(diagnosis.chosen)} {verb} a part of the error.'
        where = f' It shows most in: {_unexplained_kind(diagnosis)}.'
        if diagnosis.remainder is not None:
            where = (
                f' It shows most over {diagnosis.remainder.over[0]}: `discover` can describe it.'
            )
        return (
            'The model misses something that none of the known effects explains '
            f'({unexplained:.2f} W of structure is left).{where}{tail}{_beyond(diagnosis)}'
        )
    if diagnosis.chosen:
        return (
            f'No evidence that would bear a name: {_joined(diagnosis.chosen)} lowers the error on '
            f'held-out data from {before:.2f} to {after:.2f} W, but as much structure is left '
            f'({unexplained:.2f} W), no more than the sampling of the signals may put on.'
        )
    return (
        f'No evidence that an effect is missing: the error of {before:.2f} W on held-out data has '
        f'no structure above {float(np.sqrt(np.mean(np.square(diagnosis.floor)))):.2f} W that an '
        'effect would explain.'
    )


def _named(diagnosis: Diagnosis, before: float, after: float) -> str:
    """The names and what they explain, without a full stop."""
    begun = f'{_begun(diagnosis.effects)} {_are(diagnosis.effects)} missing from the model'
    one = len(diagnosis.effects) == 1
    if diagnosis.beside is not None:
        explained = float(np.sqrt(np.mean(diagnosis.explained)))
        verb = 'it explains' if one else 'they explain'
        return f'{begun}: {verb} {explained:.2f} W of the error of {before:.2f} W on held-out data'
    return (
        f'{begun}: with {"it" if one else "them"} the error on held-out data falls from '
        f'{before:.2f} to {after:.2f} W{_of_noise(diagnosis, after)}'
    )


def _of_noise(diagnosis: Diagnosis, left: float) -> str:
    """The part of an error that is left which is the meter's noise."""
    noise = noise_w(diagnosis)
    if not np.isfinite(noise):
        return ''
    if noise >= left:
        return f", no more than the meter's noise of {noise:.2f} W"
    return f", of which the meter's noise is {noise:.2f} W"


def noise_w(diagnosis: Diagnosis) -> float:
    """W rms over the drives, NaN where no meter's noise is known."""
    known = diagnosis.noise[np.isfinite(diagnosis.noise)]
    return float(np.sqrt(np.mean(np.square(known)))) if known.size else float('nan')


def remainder(diagnosis: Diagnosis) -> NDArray[np.float64]:
    """Structure that no known effect explains beside what is named, W² [D]."""
    if diagnosis.beside is not None and diagnosis.remainder is not None:
        return diagnosis.remainder.gain
    return diagnosis.unexplained.explained


def _left(diagnosis: Diagnosis) -> str:
    """The remainder beside what is named, to the full stop."""
    if diagnosis.remainder is None and not diagnosis.unmodelled:
        return '.'
    left = float(np.sqrt(np.mean(remainder(diagnosis))))
    told = f'; {left:.2f} W of structure is left that no known effect explains, most '
    if diagnosis.remainder is None:
        return f'{told}in {_unexplained_kind(diagnosis)}.'
    return f'{told}of it over {diagnosis.remainder.over[0]}: `discover` can describe it.'


def _begun(names: Sequence[str]) -> str:
    words = _joined(names)
    return words[:1].upper() + words[1:]


def _are(names: Sequence[str]) -> str:
    return 'is' if len(names) == 1 else 'are'


def _beyond(diagnosis: Diagnosis) -> str:
    if not diagnosis.beyond:
        return ''
    return (
        f' {_begun(diagnosis.beyond)} would lower the error only with a coefficient '
        'at the bound of what is physical, so it is not named.'
    )


def _joined(names: Sequence[str], word: str = 'and') -> str:
    words = [in_words(name) for name in names]
    if len(words) < 2:
        return ''.join(words)
    return f'{", ".join(words[:-1])} {word} {words[-1]}'


def _unexplained_kind(diagnosis: Diagnosis) -> str:
    unexplained = diagnosis.unexplained
    sizes = {
        'the state of the drive (torque, speed, position …)': float(unexplained.state.sum()),
        "other drives' power (cross-talk)": float(unexplained.cross.sum()),
        'time alone, whatever the drive does': float(unexplained.slow.sum()),
    }
    kind = max(sizes, key=lambda key: sizes[key])
    periods = unexplained.period[np.isfinite(unexplained.period)]
    if 'time' in kind and periods.size:
        kind += f', with a period of about {float(np.median(periods)):.0f} s'
    return kind
