"""Verdict in words: a sentence with its number, what is left, and what to do."""

from collections.abc import Sequence

import numpy as np
from power_estimator.posterior.priors import NAMED

from power_lab.diagnose.findings import Candidate, Diagnosis, certainty, rounded_down
from power_lab.structure.words import in_words

MOST_WORDS = 25
"""Words of the sentence."""
_IN_TABLE = 8
_LIKELY = 0.5  # that something is missing, from which the likeliest effects are said
_ALIKE = 0.95  # of the largest fall of the held-out error: the same for all that is told


def sentence(diagnosis: Diagnosis, before: float, after: float) -> str:
    """Verdict in at most 25 words, with the numbers that matter.

    before, after: held-out error of the model, and with the effects that are certain, W.
    """
    shown, left = _shown(diagnosis), diagnosis.left
    stays = f'{left.rms_w:.2f} W ({_share(left.of_power)} of power)'
    sure = certainty(min((one.probability for one in shown), default=0.0))
    named = diagnosis.verdict == 'named'
    if named and round(after, 2) < round(before, 2):
        falls = f'falls from {before:.2f} to {after:.2f} W'
        long = f'{{names}} {{are}} missing: with {{them}} the error on held-out data {falls}'
        short = f'{{names}} {{are}} missing: with {{them}} the held-out error {falls}'
        brief = f'{{names}} {{are}} missing: held-out error {before:.2f} to {after:.2f} W'
        told = [f'{long}; {stays} stays unexplained.', f'{short}; {stays} stays.']
        told += [] if left.most else [f'{long}.']
        return _fitting(diagnosis.effects, 'and', *told, f'{brief}; {stays} stays.')
    if named or len(shown) == 1:
        fall, now = (0.0, '') if named else (shown[0].delta_rmse_w, 'without it ')
        rises = round(after, 2) > round(before, 2)
        way = f'the held-out error {"rises to" if rises else "stays at"}'
        said = f', but with {{them}} {way} {after:.2f} W'
        if round(fall, 2) > 0.0:
            said = f': it takes {fall:.2f} of {before:.2f} W of error away'
        return _fitting(
            diagnosis.effects,
            'and',
            f'{{names}} {{are}} missing with probability {sure}{said}; {now}{stays} stays.',
            f'{{names}} {{are}} missing ({sure}){said}; {now}{stays} stays.',
        )
    missing = 'is' if diagnosis.found.any_missing >= NAMED else 'may be'
    one = f'{missing} missing ({rounded_down(diagnosis.found.any_missing, 2):.0%})'
    likely = diagnosis.effects or likeliest(diagnosis)
    names = ': {names}' if likely else ''
    if diagnosis.verdict == 'none_of_the_above' and likely:
        template = f'No known effect explains {stays}; one {one}{names}.'
        return _fitting(likely, 'or', template)
    any_ = certainty(diagnosis.found.any_missing)
    if diagnosis.verdict == 'none_of_the_above':
        beside = f'that a known one is missing besides has probability {any_}'
        return f'No known effect explains what the model misses: {stays}; {beside}.'
    if likely or diagnosis.found.any_missing >= _LIKELY:
        long = f'Something {one}, but these recordings do not tell what{names}; {stays} stays'
        short = f'Something {one}, not told what{names}; {stays} stays unexplained.'
        return _fitting(likely, 'or', f'{long} unexplained.', f'{long}.', short)
    none = f'No evidence in these recordings that an effect is missing (probability {any_})'
    return f'{none}: {stays} stays unexplained.'


def likeliest(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return names of effects of which one is probably missing; () below a probability of 0.5."""
    if diagnosis.found.any_missing < _LIKELY:
        return ()
    first = [] if diagnosis.uncertain is None else [diagnosis.uncertain]
    return tuple(dict.fromkeys(one.name for one in (*first, *diagnosis.open)))


def candidates_to_show(diagnosis: Diagnosis) -> list[Candidate]:
    """Return the most probable candidates, and all that the sentence may name."""
    said = {*diagnosis.effects, *likeliest(diagnosis)}
    return [one for i, one in enumerate(diagnosis.candidates) if i < _IN_TABLE or one.name in said]


def _shown(diagnosis: Diagnosis) -> list[Candidate]:
    return [one for one in diagnosis.candidates if one.name in diagnosis.effects]


def _share(value: float) -> str:
    return f'{value:.0%}' if value >= 0.1 else f'{100 * value:.2g}%'


def _fitting(effects: Sequence[str], word: str, *templates: str) -> str:
    """Return the first sentence that has room for all effects, else the last with some of them."""
    names = [in_words(name) for name in effects] or ['']
    are, them = ('is', 'it') if len(names) == 1 else ('are', 'them')
    told = ''
    for count in range(len(names), 0, -1):
        shown = [*names[:count], *([f'{len(names) - count} more'] if count < len(names) else [])]
        text = shown[0] if len(shown) == 1 else f'{", ".join(shown[:-1])} {word} {shown[-1]}'
        for template in templates if count == len(names) else templates[-1:]:
            told = template.format(names=text, are=are, them=them)
            if len(told.split()) <= MOST_WORDS:
                return told[:1].upper() + told[1:]
    return told[:1].upper() + told[1:]


def remainder(diagnosis: Diagnosis, after: float) -> str:
    """Return a line on the error that stays unexplained, '' where it is too small.

    after: held-out error of the model with the effects that are certain, W.
    """
    left = diagnosis.left
    if not left.stands_out:
        return ''
    over = f', most of it over {left.over[0]}' if left.over else ''
    whole, stays = f'{after:.2f} W', f'{left.rms_w:.2f} W'
    if whole == stays:
        return f'All {whole} of held-out error stay unexplained{over}.'
    rest = [f"the meter's noise ({left.noise_w:.2f} W)"] if np.isfinite(left.noise_w) else []
    rest += [] if diagnosis.prepared.steady else ['what passes between two samples']
    told = f'; the rest is {" and ".join(rest)}' if rest else ''
    return f'Of {whole} of held-out error {stays} rms stays unexplained{over}{told}.'


def undecided(diagnosis: Diagnosis) -> list[str]:
    """Return a sentence for each set of effects of which one is missing beside those named."""
    if diagnosis.verdict != 'named':
        return []
    told = []
    for one in diagnosis.found.undecided:
        names = ' or '.join(in_words(name) for name in one.names)
        sure = certainty(one.probability)
        text = f'{names} is missing, too (probability {sure}); these recordings do not tell which.'
        told.append(text[:1].upper() + text[1:])
    return told


def to_add(diagnosis: Diagnosis, before: float, after: float) -> tuple[str, ...]:
    """Return the effects to add: those named, unless held-out data does not bear them out.

    Of several, one of which is missing, the likeliest where each leads to the same error.
    """
    if diagnosis.verdict == 'named':
        return diagnosis.effects if after < before else ()
    falls = [one.delta_rmse_w for one in _shown(diagnosis)]
    alike = len(falls) > 1 and min(falls) > 0.0 and min(falls) >= _ALIKE * max(falls)
    return diagnosis.effects[:1] if alike else ()


def to_learn(diagnosis: Diagnosis) -> bool:
    """Return whether `discover` may learn what no known effect explains."""
    unknown = diagnosis.verdict in ('none_of_the_above', 'no_evidence')
    return unknown and diagnosis.left.stands_out and not diagnosis.prepared.whole


def to_do(diagnosis: Diagnosis, before: float, after: float) -> str:
    """Return the next step in a sentence; before, after: as in `sentence`."""
    record = 'record the proposed motion'
    effects = to_add(diagnosis, before, after)
    if diagnosis.verdict == 'named' and effects:
        return f'Next: `ros2 run power_lab add {" ".join(effects)}` …, then diagnose again.'
    if diagnosis.verdict == 'named':
        return f'Next: {record} before adding it; this recording does not bear it out.'
    if effects:
        add = f'`ros2 run power_lab add {effects[0]}` …'
        return f'Next: {add}: with each the held-out error is the same.'
    if diagnosis.verdict == 'ambiguous':
        told = 'them apart' if len(diagnosis.effects) > 1 else 'whether it is missing'
        return f'Next: {record}, which tells {told}.'
    learn = '`ros2 run power_lab discover` learns the shape of what stays'
    if (best := diagnosis.uncertain) is not None:
        fall = f'alone it takes {best.delta_rmse_w:.2f} of {before:.2f} W off'
        doubt = 'but is not told apart from what no formula explains'
        doubt += f'; {learn}' if to_learn(diagnosis) else ''
        return f'Next: {record}, which shows whether it is {in_words(best.name)}: {fall}, {doubt}.'
    if to_learn(diagnosis):
        return f'Next: {learn}.'
    alone = len(diagnosis.prepared.signals.names) == 1
    if diagnosis.verdict == 'none_of_the_above' and not alone:
        return 'Next: meter each drive; the power of all together does not tell whose it is.'
    return f'To see more: {record}.'
