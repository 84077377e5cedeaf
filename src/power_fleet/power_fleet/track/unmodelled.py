"""Growth of what the model misses, and its diagnosis on recordings before and after."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from power_estimator.effects.fit.design import Active
from power_estimator.judge.recordings import load
from power_lab.diagnose.outcome import Outcome
from power_lab.discover.discovery import FLOOR, FLOOR_SHARE_OF_RMS
from power_lab.session import Session
from power_lab.structure.words import in_words
from wattwalk_core.errors import InputError, printable

from power_fleet.track.change_test import LEAST_RECORDINGS, Change, ChangeModel
from power_fleet.track.history import DriveHistory
from power_fleet.track.reading import Request
from power_fleet.track.search import chance_of, random_orders

NAME = 'unmodelled'  # hypothesis that the model misses more than before
SHARE = 0.01
"""Share of quiet histories in which it is raised: of the false alarms of all of `track`."""
_POOLED = 8  # recordings before and after, the nearest
_AFTER, _BEFORE = 0.7, 0.05  # of the change, in a recording that counts as after or before it


@dataclass(frozen=True)
class Growth:
    """Certain growth over time of the rms error that the fits of a drive leave."""

    drive: int
    change: Change  # of the logarithm of the error
    before: float  # W rms
    after: float
    certainty: float


@dataclass(frozen=True)
class Pool:
    """Diagnosis of several recordings of a drive together; sentence: also why there is none."""

    recordings: tuple[str, ...]
    verdict: str
    effects: tuple[str, ...] = ()
    sentence: str = ''

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `track --json` writes them."""
        return {
            'verdict': self.verdict,
            'effects': list(self.effects),
            'recordings': list(self.recordings),
            'sentence': self.sentence,
        }


@dataclass(frozen=True)
class Unmodelled:
    """Effect that the model lacks from some recording on, by diagnosis before and after."""

    before: Pool
    after: Pool
    growth: Growth | None = None  # of the error, where that is certain
    added: tuple[Active, ...] = ()  # effects that the model is tracked with
    discovered: str = ''  # what `discover` says of the recordings after

    @property
    def course(self) -> str:
        """Text on the growth and since when."""
        since = printable(self.after.recordings[0])
        if self.growth is None:
            return f'the model misses something from {since} on'
        size = f'{self.growth.before:.2f} to {self.growth.after:.2f} W rms'
        return f'what the model misses grew from {size}, seen from {since} on'

    @property
    def cause(self) -> str:
        """Sentence on what the diagnoses before and after say of the cause."""
        if self.discovered:
            return f'No known effect explains it. {self.discovered}'
        named = [name for name in self.after.effects if name not in self.before.effects]
        joined = ' or ' if self.after.verdict == 'ambiguous' else ' and '
        if named:
            words = joined.join(in_words(name) for name in named)
            return f'Diagnosis names {words} in the recordings after and not in those before.'
        if self.after.effects:
            words = joined.join(in_words(name) for name in self.after.effects)
            return f'Diagnosis names {words} in the recordings before and after.'
        return f'Diagnosis of the recordings after: {self.after.sentence}'

    def json(self, drive: str) -> dict[str, Any]:
        """Return JSON-compatible values, as `track --json` writes them."""
        return {
            'drive': drive,
            'from_w': None if self.growth is None else round(self.growth.before, 4),
            'to_w': None if self.growth is None else round(self.growth.after, 4),
            'before': self.before.json(),
            'after': self.after.json(),
            'added': [active.name for active in self.added],
            'text': f'{drive}: {self.course}. {self.cause}',
        }


def growths(histories: Sequence[DriveHistory]) -> list[Growth]:
    """Find drives whose fit error certainly grows; false alarms: 1 % over all drives together."""
    models = {
        place: ChangeModel.of(_of_errors(history))
        for place, history in enumerate(histories)
        if len(history.time) >= LEAST_RECORDINGS
    }
    if not models:
        return []
    chance = [own.by_chance([NAME], random_orders(len(own.time))) for own in models.values()]
    limit = np.max(chance, axis=0)
    out = []
    for place, model in models.items():
        (change,) = model.best([NAME])
        p = chance_of(model.evidence(change), limit)
        if p > SHARE or change.size <= 0:
            continue
        known = model.with_changes(change)
        size = known.changes[0].size
        before = float(np.exp(known.levels[0][0]))
        after = before * float(np.exp(size))
        floor = max(FLOOR, FLOOR_SHARE_OF_RMS * histories[place].power)
        if np.sqrt(max(after**2 - before**2, 0.0)) > floor:
            out.append(Growth(place, known.changes[0], before, after, 1.0 - p))
    return sorted(out, key=lambda one: one.before / one.after)


def _of_errors(history: DriveHistory) -> DriveHistory:
    """The history of the logarithm of the fits' error as the only estimate."""
    count = len(history.time)
    return replace(
        history,
        labels=((NAME, 0),),
        values=np.log(np.maximum(history.errors, 1e-9))[:, None],
        covariance=np.zeros((count, 1, 1)),
        responses={NAME: np.ones(1)},
        watts=np.ones(1),
        rms=np.ones(1),
    )


def explain(
    history: DriveHistory,
    change: Change,
    growth: Growth | None,
    paths: Mapping[str, Path],
    request: Request,
    show: Callable[[str], None],
) -> Unmodelled | None:
    """Diagnose a drive's recordings before and after a change, and discover what has no name.

    paths: of the recordings by name. None where the model misses no more after than before.
    """
    early, late = sides(history, change)
    show(f'diagnosing {history.drive} from {late[0]} on')
    after, found = _pool(late, history, paths, request)
    if found is None or after.verdict == 'no_evidence':
        return None
    lab, outcome = found
    show(f'diagnosing {history.drive} before {late[0]}')
    before, _ = _pool(early, history, paths, request)
    if after.verdict == 'none_of_the_above':
        if growth is None and before.verdict == after.verdict:
            return None
        show(f'discovering what {history.drive} has from {late[0]} on')
        try:
            discovered = lab.discover(show=show).sentence
        except InputError as error:
            discovered = str(error)
        return Unmodelled(before, after, growth, (), discovered)
    if growth is None and set(after.effects) <= set(before.effects):
        return None
    return Unmodelled(before, after, growth, outcome.diagnosis.actives)


def sides(history: DriveHistory, change: Change) -> tuple[list[str], list[str]]:
    """Names of the recordings next to a change, before it and after it."""
    course = change.profile.over(history.time)
    early = np.flatnonzero(course <= max(_BEFORE, float(course[0])))
    late = np.flatnonzero(course >= min(_AFTER, float(course[-1])))
    names = history.recordings
    return [names[i] for i in early[-_POOLED:]], [names[i] for i in late[:_POOLED]]


def _pool(
    names: Sequence[str], history: DriveHistory, paths: Mapping[str, Path], request: Request
) -> tuple[Pool, tuple[Session, Outcome] | None]:
    found = [paths[name] for name in names]
    try:
        loaded = load(found, [history.joint], slow=request.slow, anyway=request.anyway)
        lab = Session(request.judge(loaded), request.model, request.spec)
        outcome = lab.diagnose()
    except InputError as error:
        return Pool(tuple(names), 'no_evidence', (), str(error)), None
    diagnosis = outcome.diagnosis
    pool = Pool(tuple(names), diagnosis.verdict, diagnosis.effects, outcome.sentence)
    return pool, (lab, outcome)
