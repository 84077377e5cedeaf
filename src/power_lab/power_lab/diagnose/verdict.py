"""Verdict in words: a sentence with its number, what is left, and what to do."""

import math
from collections.abc import Sequence

import numpy as np

from power_lab.diagnose.findings import Diagnosis
from power_lab.structure.words import in_words

MOST_WORDS = 25
"""Words of the sentence."""


def sentence(diagnosis: Diagnosis, before: float, after: float) -> str:
    """Verdict in at most 25 words, with the number that matters.

    before, after: held-out error of the model, and with the effects that are certain, W.
    """
    shown = [one for one in diagnosis.candidates if one.name in diagnosis.effects]
    # Rounded down: what is not certain is not said at 0.95.
    sure = math.floor(100 * min((one.probability for one in shown), default=0.0)) / 100
    if diagnosis.verdict == 'named' and round(after, 2) < round(before, 2):
        end = f'the error on held-out data falls from {before:.2f} to {after:.2f} W.'
        return _fitting(
            diagnosis.effects, 'and', f'{{names}} {{are}} missing: with {{them}} {end}'
        )
    if diagnosis.verdict == 'named':
        rises = round(after, 2) > round(before, 2)
        way = f'rises from {before:.2f} to' if rises else 'stays at'
        end = f'with {{them}} the held-out error {way} {after:.2f} W.'
        begin = f'{{names}} {{are}} missing with probability {sure:.2f}, but'
        return _fitting(diagnosis.effects, 'and', f'{begin} {end}')
    if len(shown) > 1:
        end = 'these recordings cannot say which.'
        return _fitting(diagnosis.effects, 'or', f'Missing is one of {{names}}; {end}')
    if shown:
        fall = f'the held-out error falls by {shown[0].delta_rmse_w:.2f} of {before:.2f} W.'
        begin = f'{{names}} {{are}} missing with probability {sure:.2f}'
        return _fitting(diagnosis.effects, 'or', f'{begin}: with {{them}} {fall}')
    best = diagnosis.uncertain
    if best is not None:
        return _fitting(
            [best.name],
            'or',
            f'No effect is certain: of {before:.2f} W of held-out error, {{names}} takes off '
            f'{best.delta_rmse_w:.2f} W, with a probability of {best.probability:.2f}.',
        )
    if diagnosis.residual is not None:
        return (
            'None of the known effects explains what the model misses: '
            f'{diagnosis.residual.rms_w:.2f} W rms of {before:.2f} W on held-out data.'
        )
    return (
        'No evidence that an effect is missing: the error on held-out data is '
        f'{before:.2f} W, as far as these recordings can show.'
    )


def _fitting(effects: Sequence[str], word: str, template: str) -> str:
    """Return a sentence with as many of the effects as it has room for, the first ones."""
    names, told = [in_words(name) for name in effects], ''
    for count in range(len(names), 0, -1):
        shown = [*names[:count], *([f'{len(names) - count} more'] if count < len(names) else [])]
        text = shown[0] if len(shown) == 1 else f'{", ".join(shown[:-1])} {word} {shown[-1]}'
        are, them = ('is', 'it') if len(names) == 1 else ('are', 'them')
        told = template.format(names=text, are=are, them=them)
        if len(told.split()) <= MOST_WORDS:
            break
    return told[:1].upper() + told[1:]


def remainder(diagnosis: Diagnosis) -> str:
    """Return a line on what stays unexplained, '' where that is too little."""
    left = diagnosis.residual
    if left is None:
        return ''
    over = f', most of it over {left.over[0]}' if left.over else ''
    noise = f"; the meter's noise is {left.noise_w:.2f} W" if np.isfinite(left.noise_w) else ''
    return (
        f'{left.rms_w:.2f} W rms stays unexplained, {100 * left.share:.0f} % of what the model '
        f'misses{over}{noise}.'
    )


def to_add(diagnosis: Diagnosis, before: float, after: float) -> tuple[str, ...]:
    """Return the effects that are named, none where held-out data does not bear them out."""
    return diagnosis.effects if diagnosis.verdict == 'named' and after < before else ()


def to_do(diagnosis: Diagnosis, before: float, after: float) -> str:
    """Return the next step in a sentence."""
    record = 'record the motion of `next_recording`'
    if effects := to_add(diagnosis, before, after):
        return f'Next: `power_lab add {" ".join(effects)}`, then diagnose again.'
    if diagnosis.verdict == 'named':
        return f'Next: {record} before adding it; this recording does not bear it out.'
    if diagnosis.verdict == 'ambiguous':
        return f'Next: {record}, which tells them apart.'
    if diagnosis.uncertain is not None:
        return f'Next: {record}, which shows whether it is {in_words(diagnosis.uncertain.name)}.'
    if diagnosis.verdict == 'none_of_the_above' and diagnosis.prepared.whole:
        return 'Next: meter each drive; the power of all together does not tell whose it is.'
    if diagnosis.verdict == 'none_of_the_above':
        return 'Next: `power_lab discover` learns the shape of it.'
    return f'To see more: {record}.'
