"""Generalised least squares of changes in a drive's estimates, and their largest by chance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from sklearn.covariance import ledoit_wolf
from wattwalk_core.arrays import Floats

from power_fleet.track.history import DriveHistory

LEAST_RECORDINGS = 8
ALONE = '~'  # before the name of an estimate that moves alone, whatever caused it
LEAST_SIDE = 3  # recordings before a change and after it
_LEAST_RAMP = 4  # recordings
_RAMP_STEPS = 18  # places at which ramps begin or end
_MEDIAN = 0.6745  # of the absolute value of a standard normal variate
_LEAST = 1e-6
_OWN_PART = 1e-3  # of the information on a change that others must leave
_ROUNDS = 5  # of the robust slopes
_FAR = 3.0  # standard deviations that a difference counts as at most


@dataclass(frozen=True)
class Profile:
    """Course of a change: 0 up to recording `begin`, straight in time, 1 from `end` on."""

    begin: int
    end: int

    @property
    def step(self) -> bool:
        """Return whether it happens between two recordings."""
        return self.end - self.begin <= 1

    @property
    def first(self) -> int:
        """Index of the first recording after a step, or of that in which a ramp begins."""
        return self.end if self.step else self.begin

    def over(self, time: Floats) -> Floats:
        """Share of the change in each recording [M], at times in s [M]."""
        if self.step:
            return (np.arange(len(time)) >= self.end).astype(np.float64)
        length = max(float(time[self.end] - time[self.begin]), 1e-9)
        return np.clip((time - time[self.begin]) / length, 0.0, 1.0)

    def penalty(self, count: int) -> float:
        """Penalty on the statistic for the second date of a ramp: log(count), as in BIC."""
        return 0.0 if self.step else float(np.log(count))


def profiles(count: int) -> list[Profile]:
    """Profiles to try on count recordings: a step at each, and ramps between points of a grid."""
    out = [Profile(end - 1, end) for end in range(LEAST_SIDE, count - LEAST_SIDE + 1)]
    grid = np.unique(np.linspace(0, count - 1, min(_RAMP_STEPS, count)).round().astype(int))
    out += [
        Profile(int(begin), int(end))
        for begin in grid
        for end in grid
        if end - begin >= _LEAST_RAMP and begin <= count - 1 - LEAST_SIDE and end >= LEAST_SIDE
    ]
    return out


@dataclass(frozen=True)
class Change:
    """A change of one hypothesis (an effect or a fault) with its profile."""

    hypothesis: str
    profile: Profile
    size: float = 0.0  # in the unit of the hypothesis
    error: float = 0.0  # standard error of the size
    statistic: float = 0.0  # squared size over squared error


@dataclass(frozen=True)
class ChangeModel:
    """Estimates of a drive as level, slopes by covariates, known changes and scatter.

    The scatter of recordings is normal with a covariance that is estimated: what recordings of
    one robot differ by is far more than the interval of each.
    """

    history: DriveHistory
    time: Floats  # [M], that ramps are straight in
    scale: Floats  # [m], unit of each estimate
    own: Floats  # [m], scaled standard error of a usual recording
    excess: Floats  # [M, m, m], scaled, by which a recording says less than the others
    changes: tuple[Change, ...] = ()
    known_scatter: Floats | None = None  # [m, m], taken from another model of the history
    order: NDArray[np.intp] | None = None  # [M], in which the recordings are taken

    @classmethod
    def of(cls, history: DriveHistory) -> 'ChangeModel':
        """Build the model of a history without known changes."""
        spread = history.values.std(axis=0)
        own = np.sqrt(np.median(np.diagonal(history.covariance, axis1=1, axis2=2), axis=0))
        scale = np.maximum(np.maximum(spread, own), 1e-12)
        rising = bool((np.diff(history.time) > 0).all())
        time = history.time if rising else np.arange(len(history.time), dtype=np.float64)
        relative = history.covariance / (scale[:, None] * scale)
        values, vectors = np.linalg.eigh(relative - np.median(relative, axis=0))
        wider = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
        return cls(history, time, scale, np.maximum(own / scale, _LEAST), wider)

    def _taken(self, values: Floats) -> Floats:
        return values if self.order is None else values[self.order]

    @cached_property
    def design(self) -> Floats:
        """Regressors of the level and of the covariates [M, p]."""
        count = len(self.time)
        return self._taken(np.concatenate([np.ones((count, 1)), self.history.covariates], axis=1))

    @cached_property
    def values(self) -> Floats:
        """Estimates in units of their scale [M, m]."""
        return self._taken(self.history.values / self.scale)

    def direction(self, hypothesis: str) -> Floats:
        """Change of the scaled estimates [m] by one unit; `~name`: of that estimate alone."""
        if hypothesis.startswith(ALONE):
            labels = self.history.labels
            return np.eye(len(labels))[labels.index((hypothesis.removeprefix(ALONE), 0))]
        return self.history.responses[hypothesis] / self.scale

    def _changed(self) -> list[Floats]:
        """Regressors [M, m] of the known changes."""
        return [
            self._taken(change.profile.over(self.time))[:, None]
            * self.direction(change.hypothesis)
            for change in self.changes
        ]

    def _unchanged(self) -> Floats:
        """Scaled estimates [M, m] less the known changes."""
        if not self.changes:
            return self.values
        sizes = np.array([change.size for change in self.changes])
        return np.asarray(self.values - np.tensordot(sizes, np.stack(self._changed()), axes=1))

    @cached_property
    def residual(self) -> Floats:
        """Scaled estimates [M, m] less level, slopes and known changes, by least squares."""
        current = self._unchanged()
        slopes, *_ = np.linalg.lstsq(self.design, current, rcond=None)
        return np.asarray(current - self.design @ slopes)

    @cached_property
    def scatter(self) -> Floats:
        """Covariance [m, m] of scaled estimates beside covariates, shrunk as Ledoit and Wolf do.

        It is that of the differences of successive recordings, which a change that is not known
        yet hardly moves; one that stands out, as that across a step, counts as three standard
        deviations. It is no less than the recordings' own errors; for fewer than 8 recordings it
        is the identity.
        """
        if self.known_scatter is not None:
            return self.known_scatter
        if len(self.time) < LEAST_RECORDINGS:
            return np.eye(len(self.scale))
        parts = (self._unchanged(), self.design[:, 1:])
        steps, moves = (np.diff(part, axis=0) / np.sqrt(2.0) for part in parts)
        solver, told = np.linalg.pinv(moves), np.zeros_like(steps)
        for _ in range(_ROUNDS):
            size = np.sqrt(np.median(np.square(steps - told), axis=0)) / _MEDIAN
            size = np.maximum(size, self.own)
            clipped = np.clip((steps - told) / size, -_FAR, _FAR) * size
            told = moves @ (solver @ (told + clipped))
        scaled = np.clip((steps - told) / size, -_FAR, _FAR)
        covariance, _ = ledoit_wolf(scaled, assume_centered=True)
        count, p = self.design.shape
        return np.asarray(covariance * size[:, None] * size) * count / max(count - p, 1)

    @cached_property
    def covariances(self) -> Floats:
        """Covariance of each recording's scaled estimates [M, m, m]: wider where it says less."""
        return self.scatter + self._taken(self.excess)

    @cached_property
    def precision(self) -> Floats:
        """Inverse covariances [M, m, m]."""
        return np.asarray(np.linalg.inv(self.covariances))

    @cached_property
    def _nuisance(self) -> tuple[Floats, Floats, Floats]:
        """Nuisance weighted by precision [M, m, q], inverse normal matrix [q, q], sizes [q].

        It is level and slopes of each estimate, and the known changes.
        """
        count, m = self.values.shape
        each = np.einsum('tp,mn->tmpn', self.design, np.eye(m)).reshape(count, m, -1)
        x = np.concatenate(
            [each, *(regressor[..., None] for regressor in self._changed())], axis=2
        )
        weighted = self.precision @ x
        inverse = np.linalg.pinv(np.einsum('tmq,tmr->qr', x, weighted), hermitian=True)
        sizes = inverse @ np.einsum('tmq,tm->q', weighted, self.values)
        return weighted, np.asarray(inverse), np.asarray(sizes)

    @cached_property
    def _tried(self) -> tuple[list[Profile], Floats, Floats]:
        """The n profiles that are tried, their courses [n, M] and their penalties [n]."""
        tried = profiles(len(self.time))
        courses = np.stack([profile.over(self.time) for profile in tried])
        return tried, courses, np.array([own.penalty(len(self.time)) for own in tried])

    def best(self, hypotheses: Sequence[str]) -> list[Change]:
        """Return the likeliest change of each hypothesis, the best first."""
        tried, courses, penalty = self._tried
        sizes, squared = self._swept(hypotheses, courses)
        places = np.argmax(squared - penalty[:, None], axis=0)
        out = []
        for column, (name, place) in enumerate(zip(hypotheses, places, strict=True)):
            size, statistic = float(sizes[place, column]), float(squared[place, column])
            error = abs(size) / max(float(np.sqrt(statistic)), 1e-12)
            out.append(Change(name, tried[place], size, error, statistic))
        return sorted(out, key=lambda change: -self.evidence(change))

    def _swept(self, hypotheses: Sequence[str], courses: Floats) -> tuple[Floats, Floats]:
        """Sizes and squared t values [n, H] of changes by n courses [n, M], of H hypotheses."""
        directions = np.stack([self.direction(name) for name in hypotheses], axis=1)
        weighted, inverse, sizes = self._nuisance
        own = weighted.transpose(0, 2, 1) @ directions  # [M, q, H]
        turned = self.precision @ directions  # [M, m, H]
        score = np.einsum('tmh,tm->th', turned, self.values) - np.einsum('tqh,q->th', own, sizes)
        alone = np.einsum('tmh,mh->th', turned, directions)
        top = courses @ score
        own_part = np.square(courses) @ alone
        bottom = own_part.copy()
        for column in range(directions.shape[1]):
            shared = courses @ own[..., column]
            bottom[:, column] -= np.einsum('nq,nq->n', shared @ inverse, shared)
        known = bottom < _OWN_PART * own_part  # covariates and known changes say it already
        bottom = np.maximum(bottom, _OWN_PART * own_part)
        return np.where(known, 0.0, top / bottom), np.where(known, 0.0, np.square(top) / bottom)

    def kept(self, change: Change) -> float:
        """Return the squared t value that a change has beside covariates and known changes."""
        course = change.profile.over(self.time)[None]
        return float(self._swept((change.hypothesis,), course)[1].item())

    def evidence(self, change: Change) -> float:
        """Return the statistic of a change less the penalty of its profile."""
        return change.statistic - change.profile.penalty(len(self.time))

    def by_chance(self, hypotheses: Sequence[str], orders: NDArray[np.intp]) -> Floats:
        """Largest evidence of any hypothesis and profile in each of B orders of recordings [B].

        Without a change, recordings may trade places; covariates go with them. orders: [B, M].
        """
        _, courses, penalty = self._tried
        out = np.empty(len(orders))
        for place, order in enumerate(orders):
            _, squared = replace(self, order=order)._swept(hypotheses, courses)
            out[place] = (squared - penalty[:, None]).max()
        return out

    def with_changes(self, *changes: Change, scatter: Floats | None = None) -> 'ChangeModel':
        """Return the model with more known changes; scatter [m, m]: by default re-estimated."""
        model = replace(self, changes=(*self.changes, *changes), known_scatter=scatter)
        for _ in range(2):
            model = replace(model, changes=model.sized())
        return model

    def sized(self) -> tuple[Change, ...]:
        """Return the known changes with sizes and errors by all of them together."""
        _, inverse, found = self._nuisance
        count = len(self.changes)
        errors = np.sqrt(np.maximum(np.diag(inverse)[-count:], 1e-300))
        return tuple(
            replace(
                change, size=float(size), error=float(error), statistic=float((size / error) ** 2)
            )
            for change, size, error in zip(self.changes, found[-count:], errors, strict=True)
        )

    @cached_property
    def log_likelihood(self) -> float:
        """Gaussian log-likelihood of the residuals at the model's own scatter."""
        _, logs = np.linalg.slogdet(self.covariances)
        squares = np.einsum('tm,tmn,tn->t', self.residual, self.precision, self.residual)
        return float(-0.5 * (logs + squares).sum())

    @cached_property
    def levels(self) -> tuple[Floats, Floats]:
        """Level [m] before all changes, at mean covariates, and its standard error, unscaled."""
        _, inverse, sizes = self._nuisance
        m = self.values.shape[1]
        error = np.sqrt(np.maximum(np.diag(inverse)[:m], 0.0))
        return sizes[:m] * self.scale, error * self.scale
