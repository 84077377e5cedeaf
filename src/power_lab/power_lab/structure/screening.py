"""Quick look at all drivers of a drive, and at what they gain by chance."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.signals.prepared import Prepared
from wattwalk_core.arrays import Floats

from power_lab.structure.drivers import Family, driver_values
from power_lab.structure.shapes import DriveProblem, bend, hats, places, spread, weight_of

MOVES = 39
"""Residuals without a cause: the largest of 39 is exceeded by chance in 1 of 40."""
_LEAST_MOVE = 0.08  # of the recording
_TURNED = 5  # blocks of a second that change their sign together
_SLOW = 0.5
"""Share of a driver's variance in its means over a second from which on it is a slow one."""
_REPEATS = 0.7
"""Correlation of a driver with itself, moved as the residual is, that leaves both in step."""
LEARNED, LEARNED_ON_ONE = 8, 2
"""Families that shapes are learned of: over all drives, and on each."""
_NODES, _NODES_OF_TURN = 14, 40
_SMOOTHING = (1e-3, 1e-1, 10.0)


@dataclass(frozen=True)
class DriverGain:
    """Held-out gain of one family of regressors on one drive, W² in the mean of its rows."""

    family: Family
    gain: float
    by_chance: Floats  # [S], of residuals that are moved in time, or turned in sign


@dataclass(frozen=True)
class _Targets:
    """A residual and those without a cause, beside the base's columns."""

    fixed: Floats  # [R, m + 1 + S]
    train: Floats  # [F, m, m + 1 + S], products of the base's columns with all
    test: Floats
    start: Floats  # [1 + S], W², held-out error of the base less that of the targets, at most 0


class DriverScreen:
    """Screens the families of one drive on reduced signals.

    Driver and factor are reduced apart here, and the base's coefficients keep to their bounds only
    where they stand at one: this ranks families and says what comes by chance; shapes are learned
    without either shortcut.
    """

    def __init__(self, problem: DriveProblem, point: Linearisation, prepared: Prepared) -> None:
        self.problem, self.point, self.prepared = problem, point, prepared
        mask = problem.blocks.mask[..., 0]
        fold = np.broadcast_to(problem.folds.test[:, None], mask.shape)[mask]
        training = np.repeat(problem.folds.training[:, :, None], mask.shape[1], axis=2)[:, mask]
        self.rows = problem.blocks.rows[mask]
        self._tests = [np.flatnonzero(fold == f) for f in range(problem.folds.count)]
        self._near = [np.flatnonzero((own == 0.0) & (fold != f)) for f, own in enumerate(training)]
        self._values = np.nan_to_num(problem.residual[problem.blocks.rows])
        self._mask = mask
        count = len(self._values)
        least = max(1, round(_LEAST_MOVE * count))
        shifts = np.linspace(least, count - least, MOVES).round().astype(int)
        self._moves: list[int] = shifts.tolist()
        self._ridge = problem.ridge[problem.free]
        self._weights: dict[tuple[str, str], Floats] = {}

    def screen(self, family: Family) -> DriverGain | None:
        """Held-out gains of one family; None where its driver hardly varies."""
        driver = self._driver(family)
        z = driver[self.rows]
        nodes = spread(z, _NODES_OF_TURN if family.driver.name == 'angle' else _NODES)
        if nodes is None:
            return None
        weight = self._weight(family)[self.rows]
        columns = weight[:, None] * hats(places(z, nodes), np.arange(len(nodes)))
        targets = self._turned if self._repeats(driver) else self._moved
        gains = self._gains(columns, targets)
        return DriverGain(family, float(gains[0]), gains[1:])

    def _repeats(self, driver: Floats) -> bool:
        """Return whether a fast driver is in step with itself in two of the moves or more."""
        values = driver[self.problem.blocks.rows]
        values = values - values.mean()
        square = float(np.square(values).sum())
        slow = np.square(values.mean(axis=1)).sum() * values.shape[1] >= _SLOW * square
        if slow or not square > 0.0:
            return False
        alike = [float((values * np.roll(values, m, axis=0)).sum()) for m in self._moves]
        return sorted(alike)[-2] >= _REPEATS * square

    def _driver(self, family: Family) -> Floats:
        values = driver_values(family.driver, self.point.signals, self.problem.drive)
        if family.driver.name == 'angle':
            return values[self.prepared.reducer.centres()]
        return self.prepared.reduced(values)

    def _weight(self, family: Family) -> Floats:
        key = (family.factor.name, family.acts_on)
        if key not in self._weights:
            weight = weight_of(family, self.point, self.problem.drive)
            self._weights[key] = self.prepared.reduced(weight)
        return self._weights[key]

    @cached_property
    def _moved(self) -> _Targets:
        """The residual, and moved in time by whole seconds, so that it keeps its course."""
        return self._targets([np.roll(self._values, move, axis=0) for move in self._moves])

    @cached_property
    def _turned(self) -> _Targets:
        """The residual, and with the signs of its pieces drawn at random.

        For motions that repeat themselves: moved by whole periods a residual agrees with the
        joint as before.
        """
        values = self._values
        pieces = np.arange(len(values)) // _TURNED
        random = np.random.default_rng(0)
        signs = random.choice([-1.0, 1.0], (len(self._moves), int(pieces[-1]) + 1))
        return self._targets([values * own[pieces][:, None] for own in signs])

    def _targets(self, others: Sequence[Floats]) -> _Targets:
        m = len(self._ridge)
        base = self.problem.columns[self.rows][:, self.problem.free]
        targets = np.stack([one[self._mask] for one in (self._values, *others)], axis=1)
        fixed = np.concatenate([base, targets], axis=1)
        train, test = self._sums(base, fixed)
        solved = _solved(train[:, :, :m] + np.diag(self._ridge), train[:, :, m:])
        start = _error(test[:, :, :m], test[:, :, m:], solved)
        return _Targets(fixed, train, test, np.minimum(start, 0.0))

    def _sums(self, one: Floats, other: Floats) -> tuple[Floats, Floats]:
        """Sums of one'·other over the rows of training and of test, by fold."""
        tests = np.stack([one[rows].T @ other[rows] for rows in self._tests])
        near = np.stack([one[rows].T @ other[rows] for rows in self._near])
        return tests.sum(axis=0) - tests - near, tests

    def _gains(self, columns: Floats, targets: _Targets) -> Floats:
        """Gain W² by row of the residual and of those without a cause [1 + S]."""
        m, k = len(self._ridge), columns.shape[1]
        beside = np.concatenate([columns, targets.fixed], axis=1)
        grams, rights = [], []
        for base, own in zip(
            (targets.train, targets.test), self._sums(columns, beside), strict=True
        ):
            cross = own[:, :, k : k + m]
            whole = [[base[:, :, :m], cross.swapaxes(1, 2)], [cross, own[:, :, :k]]]
            grams.append(np.block(whole))
            rights.append(np.concatenate([base[:, :, m:], own[:, :, k + m :]], axis=1))
        (train, test), (right_train, right_test) = grams, rights
        curved = bend(k)
        unit = max(float(np.trace(train[:, m:, m:].mean(axis=0))) / k, 1e-12)
        best = np.full(right_test.shape[2], -np.inf)
        for smoothing in _SMOOTHING:
            matrix = train.copy()
            matrix[:, :m, :m] += np.diag(self._ridge)
            matrix[:, m:, m:] += unit * (smoothing * curved + 1e-6 * np.eye(k))
            error = _error(test, right_test, _solved(matrix, right_train))
            best = np.maximum(best, targets.start - error)
        return best / len(self.rows)


def chance(screened: Sequence[Sequence[DriverGain]], errors: Sequence[float]) -> float:
    """Chance that the largest share explained would come out of residuals without a cause.

    screened: by drive; errors: W² by row of each drive. The largest share over all drives and
    drivers is compared with the largest of each of them.
    """
    shares, moved = [], []
    for own, error in zip(screened, errors, strict=True):
        shares += [one.gain / error for one in own]
        moved += [one.by_chance / error for one in own]
    if not shares:
        return 1.0
    highest = np.max(np.stack(moved), axis=0)
    return float((1 + (highest >= max(shares)).sum()) / (1 + len(highest)))


def promising(screened: Sequence[Sequence[DriverGain]]) -> set[tuple[str, ...]]:
    """Groups of families that gain most over all drives, or on one of them, to learn shapes of."""
    pooled: dict[tuple[str, ...], float] = defaultdict(float)
    wanted: set[tuple[str, ...]] = set()
    for own in screened:
        best: dict[tuple[str, ...], float] = defaultdict(float)
        for one in own:
            best[one.family.group] = max(best[one.family.group], one.gain)
        for group, gain in best.items():
            pooled[group] += gain
        wanted.update(sorted(best, key=lambda g: -best[g])[:LEARNED_ON_ONE])
    wanted.update(sorted(pooled, key=lambda g: -pooled[g])[:LEARNED])
    return wanted


def _error(gram: Floats, moment: Floats, solved: Floats) -> Floats:
    """Sum of squared errors less that of the targets, W² [S]."""
    return np.asarray((solved * (gram @ solved - 2.0 * moment)).sum(axis=(0, 1)))


def _solved(matrix: Floats, right: Floats) -> Floats:
    scale = np.sqrt(np.maximum(np.diagonal(matrix, axis1=1, axis2=2), 1e-12))
    unit = matrix / (scale[:, :, None] * scale[:, None, :]) + 1e-9 * np.eye(matrix.shape[1])
    return np.asarray(np.linalg.solve(unit, right / scale[..., None]) / scale[..., None])
