"""Search for changes over all drives and effects, with one rate of false alarms for all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Catalogue
from wattwalk_core.arrays import Floats

from power_fleet.track.change_test import ALONE, LEAST_RECORDINGS, Change, ChangeModel
from power_fleet.track.history import DriveHistory
from power_fleet.track.recording_fit import TIME_OFFSET

FALSE_ALARMS = 0.05  # share of quiet histories that raise any alarm, over all drives and effects
_OF_COEFFICIENTS = 0.04  # of them; the rest is for growth of what the model misses
_ORDERS = 199
_MOST_CHANGES = 3  # of a drive
_LIKE = 2.0  # log-likelihood: what differs by less cannot be told apart
_PRIOR_WIDTHS = 3.0  # widths of the prior of one recording that a fault may drift by
_SMALL = 0.25  # of the rms W of a change that goes with another of the same drive and date
_LEAST_ALARM = 0.005  # of a drive's rms W: a smaller change is no alarm, however certain
_ALIKE = 0.6  # correlation of the courses of two changes of the same date
_LEAST_EXPLAINED = 0.1  # W rms
_WITHIN = ('torque_bend', 'offset_drift')  # errors of the measurement that no time series is of
_SEED = 19


@dataclass(frozen=True)
class CertainChange:
    """Certain change of one drive, and other changes that explain it as well."""

    drive: int
    change: Change
    certainty: float
    rivals: tuple[Change, ...]


@dataclass(frozen=True)
class Explained:
    """A change that a covariate explains, so that it is no change of the drive."""

    drive: int
    change: Change
    covariate: str


@dataclass(frozen=True)
class Search:
    """Result of a search over D drives."""

    models: tuple[ChangeModel, ...]  # [D], with the changes found
    findings: tuple[CertainChange, ...]
    explained: tuple[Explained, ...]
    certainties: tuple[Mapping[str, float], ...]  # [D], by hypothesis, of a further change


def hypotheses_of(history: DriveHistory) -> list[str]:
    """Names of the effects and faults whose change a history can show."""
    return [name for name in history.responses if name not in _WITHIN]


def search(histories: Sequence[DriveHistory], catalogue: Catalogue) -> Search:
    """Find changes, with a false alarm in at most 4 % of sets of histories without any change.

    The largest evidence of any drive, effect, fault and date is compared with the largest that the
    same recordings show in random orders. Changes found are taken out, and the rest is searched
    again.
    """
    long = [i for i, own in enumerate(histories) if len(own.time) >= LEAST_RECORDINGS]
    models = [ChangeModel.of(history) for history in histories]
    chance = {i: _chance(models[i]) for i in long}
    findings: list[CertainChange] = []
    rounds = dict.fromkeys(long, 0)
    while long:
        limit = _limit(chance)
        open_ = [i for i in long if rounds[i] < _MOST_CHANGES]
        leaders = {i: models[i].best(hypotheses_of(histories[i]))[0] for i in open_}
        if not leaders:
            break
        drive = max(leaders, key=lambda i: models[i].evidence(leaders[i]))
        p = chance_of(models[drive].evidence(leaders[drive]), limit)
        if p > _OF_COEFFICIENTS:
            break
        change, rivals, models[drive] = _resolved(models[drive], leaders[drive], catalogue)
        rounds[drive] += 1
        found = CertainChange(drive, change, 1.0 - p, rivals)
        if not _goes_with(found, findings, histories[drive]):
            findings.append(found)
        chance[drive] = _chance(models[drive])
    findings = _one_delay(findings, histories)
    certainties = _certainties(models, chance)
    explained = _explained(histories, findings, chance)
    latest = tuple(_latest(finding, models[finding.drive]) for finding in findings)
    return Search(tuple(models), latest, tuple(explained), tuple(certainties))


def _one_delay(
    findings: Sequence[CertainChange], histories: Sequence[DriveHistory]
) -> list[CertainChange]:
    """Leave out changes of the delay that go with another change of the robot.

    The delay is estimated for all drives of a robot together: what changes on one of them may
    move it, and a change of the delay itself is seen on each.
    """
    out: list[CertainChange] = []
    for own in sorted(findings, key=lambda finding: finding.change.hypothesis == TIME_OFFSET):
        history = histories[own.drive]
        known = any(
            _at_once(own, other, history)
            for other in out
            if histories[other.drive].recordings == history.recordings
        )
        if own.change.hypothesis != TIME_OFFSET or not known:
            out.append(own)
    return out


def _latest(finding: CertainChange, model: ChangeModel) -> CertainChange:
    """The finding with the size that all changes of the drive together give it."""
    same = (finding.change.hypothesis, finding.change.profile)
    found = next(c for c in model.changes if (c.hypothesis, c.profile) == same)
    return replace(finding, change=found)


def _chance(model: ChangeModel) -> Floats:
    return model.by_chance(hypotheses_of(model.history), random_orders(len(model.time)))


def random_orders(count: int) -> NDArray[np.intp]:
    """Orders of so many recordings [B, M], the same for all drives that have as many."""
    random = np.random.default_rng([_SEED, count])
    return np.stack([random.permutation(count) for _ in range(_ORDERS)])


def chance_of(evidence: float, limit: Floats) -> float:
    """Return the share of random orders whose largest evidence, limit [B], is as large."""
    return float((1 + (limit >= evidence).sum()) / (1 + len(limit)))


def _resolved(
    model: ChangeModel, first: Change, catalogue: Catalogue
) -> tuple[Change, tuple[Change, ...], ChangeModel]:
    """Return the likeliest change, those that are as likely, and the model with the first of them.

    All are compared at the scatter that the first leaves.
    """
    names = hypotheses_of(model.history)
    for _ in range(2):
        scatter = model.with_changes(first).scatter
        every = replace(model, known_scatter=scatter).best(names)
        first = every[0]
    tried = [(model.with_changes(change, scatter=scatter), change) for change in every]
    worth = [
        own.log_likelihood - change.profile.penalty(len(own.time)) / 2 + prior(own, catalogue)
        for own, change in tried
    ]
    order = np.argsort(-np.array(worth))
    chosen = replace(tried[order[0]][0], known_scatter=None)
    found = chosen.changes[-1]
    if catalogue[found.hypothesis.split('.')[0]].kind == 'physics':
        # An effect whose shape is not quite the formula's moves errors of the measurement, too.
        with_it = [
            Change(ALONE + name, found.profile)
            for name, term in model.history.labels
            if catalogue[name.split('.')[0]].kind == 'measurement' and term == 0
        ]
        chosen = model.with_changes(found, *with_it)
    place = len(model.changes)
    chosen = replace(chosen, changes=chosen.sized())
    rivals = [
        tried[i][0].changes[-1] for i in order[1:] if worth[i] > worth[int(order[0])] - _LIKE
    ]
    return chosen.changes[place], tuple(rivals), chosen


def _goes_with(
    found: CertainChange, findings: Sequence[CertainChange], history: DriveHistory
) -> bool:
    """Return whether a change is tiny, or a small part of another of the drive and date."""
    if watts(history, found.change) < _LEAST_ALARM * history.power:
        return True
    return any(
        _at_once(found, other, history)
        and watts(history, found.change) < _SMALL * watts(history, other.change)
        for other in findings
        if other.drive == found.drive
    )


def _at_once(found: CertainChange, other: CertainChange, history: DriveHistory) -> bool:
    """Return whether the courses of two changes over the recordings of a history are alike."""
    one, two = (own.change.profile.over(history.time) for own in (found, other))
    return bool(np.corrcoef(one, two)[0, 1] > _ALIKE)


def watts(history: DriveHistory, change: Change) -> float:
    """Rms power of a change over the recordings, W."""
    if change.hypothesis == 'power_gain':
        return abs(change.size) * history.power
    return abs(change.size) * float(history.rms[history.labels.index((change.hypothesis, 0))])


def prior(model: ChangeModel, catalogue: Catalogue) -> float:
    """Log prior of the size of a model's last change: Gaussian for a fault, 0 for an effect."""
    change = model.changes[-1]
    effect = catalogue[change.hypothesis.split('.')[0]]
    width = effect.terms[0].prior if effect.kind == 'measurement' else np.inf
    if not np.isfinite(width):
        return 0.0
    return float(-0.5 * (change.size / (_PRIOR_WIDTHS * width)) ** 2)


def _limit(chance: Mapping[int, Floats]) -> Floats:
    """Largest evidence of any drive in each random order [B]; [] without drives."""
    return np.max([*chance.values()], axis=0) if chance else np.empty(0)


def _certainties(
    models: Sequence[ChangeModel], chance: Mapping[int, Floats]
) -> list[dict[str, float]]:
    out: list[dict[str, float]] = [{} for _ in models]
    limit = _limit(chance)
    for i in chance:
        for change in models[i].best(hypotheses_of(models[i].history)):
            out[i][change.hypothesis] = 1.0 - chance_of(models[i].evidence(change), limit)
    return out


def _explained(
    histories: Sequence[DriveHistory],
    findings: Sequence[CertainChange],
    chance: Mapping[int, Floats],
) -> list[Explained]:
    """Changes that would be certain if nobody knew the circumstances of the recordings."""
    known = {finding.drive for finding in findings}
    limit = _limit(chance)
    out = []
    for i in chance:
        if not histories[i].names:
            continue
        model = ChangeModel.of(histories[i].with_covariates(()))
        change = model.best(hypotheses_of(histories[i]))[0]
        if i in known or watts(histories[i], change) < _LEAST_EXPLAINED:
            continue
        if chance_of(model.evidence(change), limit) > _OF_COEFFICIENTS:
            continue
        names = histories[i].names
        beside = [ChangeModel.of(histories[i].with_covariates((name,))) for name in names]
        least = int(np.argmin([own.kept(change) for own in beside]))
        out.append(Explained(i, change, names[least]))
    return out
