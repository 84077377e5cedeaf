"""Columns, noise and normal equations of one meter."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

from power_estimator.drive_types import assign, infer_types
from power_estimator.effects import Signals
from power_estimator.effects.fit.blocks import for_each
from power_estimator.effects.fit.design import Active, BasePower, Structure
from power_estimator.effects.fit.design_builder import DesignBuilder, Linearisation
from power_estimator.effects.fit.whole_robot import WholeBuilder
from power_estimator.effects.library.bus import returned_shares
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.state import OtherDrives
from power_estimator.posterior.departures import Departures, Point
from power_estimator.posterior.discrepancy import Features, smooth_features
from power_estimator.posterior.effect_columns import EffectColumns
from power_estimator.posterior.gaussian import NormalEquations, Standing, Weighed, marginalised
from power_estimator.posterior.noise import DEGREES, learned_errors
from power_estimator.posterior.priors import (
    ALL_SEARCHED,
    BAD_CABLE,
    BLOCK,
    DEPARTING,
    DISCREPANCY,
    KINDS,
    SEARCHED,
    SHARES,
    SPIKE,
)
from power_estimator.posterior.sensors import SENSORS, UNMOVED, SensorErrors

FRICTIONS: Final = ('viscous_friction', 'coulomb_friction', 'stribeck_friction')
"""Effects that the friction at 1 rad/s consists of, without load."""
_SPREADS: Final = (0.1, 1.0, 0.01, 0.01)
"""Prior spreads of effects, nuisances, bent columns and features where the noise is learned."""


@dataclass(frozen=True)
class Noise:
    """Spread of the errors, and what is weighted by it once for all sets of effects."""

    variance: float  # W²
    lasting: float  # W², of the errors with those of the next row
    rows: NDArray[np.intp]  # [K] that count
    starts: NDArray[np.intp]  # of the blocks among these
    left: Floats  # W [K], that no column explains
    root: Floats  # of their weights, 1/W [K, 1]
    absent: Sequence[object]  # keys of effects, by column of what may be absent
    standing: Standing  # these columns, and the discrepancy


class MeterProblem:
    """Rows, columns and noise of one meter: of a drive, or of a whole robot."""

    def __init__(
        self, prepared: Prepared, fixed: Sequence[Active], base: BasePower | None
    ) -> None:
        """fixed: effects of the model without coefficients; base: a model underneath."""
        self.prepared, self.signals = prepared, prepared.signals
        self.fixed = tuple(fixed)
        # A model underneath may have learned a part of what is lost: any share may be missing.
        self.shares: Mapping[str, tuple[float, float]] = SHARES if base is None else {}
        self.builder = (WholeBuilder if prepared.whole else DesignBuilder)(prepared, base)
        self.departures = Departures(self.builder)
        self.place = int(np.argmin(np.abs(prepared.shifts)))  # of the delay of the power
        self.noise: Noise | None = None
        self.used = prepared.measured[:, 0] & prepared.resolved[:, 0]
        shown = self.power()[self.used]
        self.rms = float(np.sqrt(np.mean(np.square(shown)))) if shown.size else 1.0

    def drawn(self, point: Point) -> Floats:
        """Power that the drive draws by the effects of a point, W [T, D]."""
        return self._at(point).signals.drawn

    def slope(self, point: Point) -> Floats:
        """Derivative of a point's power by the motor's torque, W/(N·m) [T, D]."""
        s = self._at(point).signals
        return s.motor_velocity + s.torque_cost

    def _at(self, point: Point) -> Linearisation:
        structure = Structure((*self.fixed, *(active for active, _ in point.values())))
        values = np.concatenate([own for _, own in point.values()] or [np.empty(0)])
        return self.builder.point(structure, values[None])

    def share_bus(self, drawn: Floats) -> None:
        """Take what the other drives draw, W [T, D], as their part of the bus."""
        self.signals = replace(self.signals, others=OtherDrives.of(drawn))
        self.prepared = self.builder.prepared = replace(self.prepared, signals=self.signals)

    def power(self) -> Floats:
        """Metered watts with the delay taken out [N]."""
        return np.asarray(self.prepared.power[self.place, :, 0], dtype=np.float64)

    @cached_property
    def general(self) -> Features:
        """The discrepancy's features."""
        return smooth_features(self.prepared)

    @cached_property
    def errors(self) -> SensorErrors:
        """Errors of the sensors."""
        return SensorErrors.of(self.signals)

    def columns(self, actives: Sequence[Active], point: Point) -> EffectColumns:
        """Linearise effects about a point, which has coefficients in SI by name."""
        at = self._at(point)
        slope = at.signals.motor_velocity + at.signals.torque_cost
        departed = self.departures.of(point, at.signals)
        blocked = blocked_shares(at.signals, point)
        more = [at.power, *self.errors.watts(at.power, slope, blocked)]
        every = {active.key: active for active in (*actives, *(own for own, _ in point.values()))}
        found, beside = self.builder.columns_and([*every.values()], at, more)
        of = {key: own[:, 0] for key, own in zip(every, found, strict=True)}
        raw = [of[active.key] for active in actives]
        joined = np.concatenate([np.empty((len(self.used), 0)), *raw], axis=1)
        size = np.maximum(np.sqrt(np.mean(joined[self.used] ** 2, axis=0)), 1e-12)
        power = beside[:, 0, 0]
        nuisance = np.concatenate([beside[:, 0, 1:], departed.formed], axis=1)
        linear = np.zeros(len(joined))
        for active, own in point.values():
            linear += of[active.key] @ own
        metered = self._metered_share(power)
        of_point = ~np.isin((*SENSORS, *departed.causes), UNMOVED)
        nuisance = nuisance * np.where(of_point, metered, 1.0)
        keys = {active.key for active in actives}
        may_be_absent = self.noise.absent if self.noise else ()
        absent = [i for i, key in enumerate(may_be_absent) if key not in keys]
        scaled = self._sizes(actives, point, raw) / size
        return EffectColumns(
            tuple(actives),
            joined * scaled,
            scaled,
            nuisance,
            metered * departed.bent,
            np.array(absent, np.intp),
            power - linear,
            _friction_at_one(actives, scaled, nuisance.shape[1], departed.at_one, point),
            (*departed.causes, *self.general.causes, *departed.bent_causes),
        )

    def _metered_share(self, power: Floats) -> float:
        """Factor that makes a point's power [N] no larger than what was metered.

        Else a point that is far off would have errors of sensors and departures as large as itself
        for the same price, and stay far off.
        """
        shown, power = self.power()[self.used], power[self.used]
        return min(max(float(shown @ power) / max(float(power @ power), 1e-12), 0.0), 1.0)

    def _sizes(self, actives: Sequence[Active], point: Point, raw: Sequence[Floats]) -> Floats:
        """Watts of one unit of prior spread [n]: the rms power, of a part the whole's own."""
        sizes: list[float] = []
        for active in actives:
            size = self.rms * (BAD_CABLE if active.name == 'line_resistance' else 1.0)
            wholes = [
                own[self.used] @ point[a.name][1]
                for a, own in zip(actives, raw, strict=True)
                if a.name in point and a.name.partition('@')[0] == active.effect.part_of
            ]
            if wholes:
                watts = float(np.sqrt(np.mean(np.square(sum(wholes)))))
                size = min(max(watts, SPIKE * self.rms), self.rms)
            sizes += [size] * len(active.effect.terms)
        return np.array(sizes)

    def learn_noise(self, columns: EffectColumns, known: Sequence[str]) -> None:
        """Noise, weights and tempering by a fit of all effects; what absent ones may explain."""
        rows = np.flatnonzero(self.used)
        every, spread = self._all_columns(columns)
        y = (self.power() - columns.constant)[rows]
        rate = len(self.used) / max(float(np.ptp(self.prepared.time)), 1e-9)
        # Operating points are independent of one another.
        count_of = len(rows) if self.prepared.steady else round(len(rows) / (rate * BLOCK))
        blocks = np.array_split(np.arange(len(rows)), max(4, count_of))
        blocks = [block for block in blocks if len(block)]
        least = 1e-12 * self.rms**2
        found = learned_errors(every[rows], spread, y, columns.effects.shape[1], blocks, least)
        tempering = max(self._overlapping(), found.tempering)
        root = np.sqrt(found.weights / (found.variance * tempering))[:, None]
        power = self.prepared.power[:, rows, 0].T.astype(np.float64)
        terms = [active for active in columns.actives for _ in active.effect.terms]
        counts = Counter(active.name for active in terms)
        new = np.flatnonzero([active.name not in known for active in terms])
        spike = SPIKE / np.sqrt([counts[terms[i].name] for i in new])
        absent = columns.effects[:, new][rows] * (spike * root)
        standing = Standing.of(self._general_w[rows] * root, power * root, absent)
        overlap = self.prepared.reducer.overlap
        lasting = found.variance if self.prepared.steady else found.lasting(rows, overlap)
        starts = np.cumsum([0, *(len(block) for block in blocks[:-1])])
        keys = [terms[i].key for i in new]
        self.noise = Noise(found.variance, lasting, rows, starts, found.left, root, keys, standing)

    def scatter(self, columns: EffectColumns, places: slice, values: Floats) -> Floats:
        """Squares of an effect's score [2]: summed by blocks, and as the noise lets expect.

        values: of the effect. Where errors are larger just when it draws power, such as at a
        foot's landing, the first is larger than the second. DEGREES blocks in which they are alike
        are added, so that a few blocks say little.
        """
        assert self.noise is not None
        rows, root = self.noise.rows, self.noise.root
        every, spread = self._all_columns(columns)
        every = every[rows] * root
        own = every[:, places] @ values
        rest = np.delete(every * spread, np.r_[places], axis=1)
        taken = np.linalg.solve(rest.T @ rest + np.eye(rest.shape[1]), rest.T @ own)
        apart = own - rest @ taken
        scores = np.add.reduceat(apart * self.noise.left * root[:, 0], self.noise.starts)
        expected = float(apart @ apart)
        usual = expected * DEGREES / len(scores)
        return np.array([scores @ scores + usual, expected + usual])

    def _all_columns(self, columns: EffectColumns) -> tuple[Floats, Floats]:
        """Columns of effects, nuisances and the discrepancy [N, k], with prior spreads [k]."""
        parts = columns.effects, columns.nuisance, columns.bent, self._general_w
        spread = np.repeat(_SPREADS, [own.shape[1] for own in parts])
        return np.concatenate(parts, axis=1), spread

    def _overlapping(self) -> float:
        """Rows whose windows overlap, of a slow meter; 1 of all others."""
        window = self.prepared.reducer.window
        if not window:
            return 1.0
        return max(1.0, window / float(np.median(np.diff(self.prepared.time))))

    @property
    def _general_w(self) -> Floats:
        return self.rms * self.general.values

    def weighed(self, columns: EffectColumns) -> Weighed:
        """Weighted products of all columns with one another and with the power."""
        assert self.noise is not None
        rows, root = self.noise.rows, self.noise.root
        a = np.concatenate([columns.effects, columns.nuisance, columns.bent], axis=1)[rows]
        a *= root
        return self.noise.standing.beside(
            a, columns.constant[rows] * root[:, 0], columns.absent_places
        )

    def normals(self, columns: EffectColumns) -> NormalEquations:
        """Normal equations at K sizes of the discrepancy, for all delays of the power."""
        groups = columns.bent.shape[1], len(columns.absent_places)
        return marginalised(self.weighed(columns), groups, (DISCREPANCY, DEPARTING))

    def departing(
        self,
        columns: EffectColumns,
        normal: NormalEquations,
        sizes: Floats,
        mean: Floats,
        place: int,
    ) -> tuple[Floats, Floats, Floats]:
        """Columns of departures, of the discrepancy and bent ones [N, k], as `columns.causes`.

        Beside them the mean and covariance of their weights. sizes, mean: prior spreads and
        posterior mean of effects and nuisances [n + z].
        """
        assert self.noise is not None
        weighed, turn = self.weighed(columns), self.noise.standing.turn
        covariance = weighed.covariance(np.concatenate([sizes, normal.spread]))
        formed = np.arange(columns.effects.shape[1] + len(SENSORS), len(mean))
        bent = len(mean) + np.arange(columns.bent.shape[1])
        general = np.arange(len(covariance) - len(turn), len(covariance))
        order = np.concatenate([formed, general, bent])
        weights = np.concatenate([mean, weighed.smooth(normal, mean, place)])[order]
        covariance = covariance[np.ix_(order, order)]
        turned = slice(len(formed), len(formed) + len(general))
        weights[turned] = turn @ weights[turned]
        covariance[turned] = turn @ covariance[turned]
        covariance[:, turned] = covariance[:, turned] @ turn.T
        parts = columns.nuisance[:, len(SENSORS) :], self._general_w, columns.bent
        return np.concatenate(parts, axis=1), weights, covariance


def blocked_shares(signals: Signals, point: Point) -> Floats:
    """Share of each drive in the power that the supply does not take back [T, D], else 0.

    A meter of the whole robot sees all that takes it.
    """
    nothing = np.zeros_like(signals.drawn)
    limits = [a for a, _ in point.values() if a.name.startswith('regeneration_limit')]
    if signals.one_meter or not any(active.parameters.get('supply') for active in limits):
        return nothing
    returned, total, blocked = returned_shares(signals)
    return np.divide(returned, total, out=nothing, where=blocked > 0.0)


def meter_problems(
    prepared: Prepared, fixed: Sequence[Active], base: BasePower | None
) -> list[MeterProblem]:
    """Return a problem for each meter."""
    if len(prepared.names) == 1:
        return [MeterProblem(prepared, fixed, base)]
    drives = range(len(prepared.names))
    return for_each(
        lambda d: MeterProblem(prepared.drive(d), fixed, base and base.drive(d)), drives
    )


def representatives(meters: Sequence[MeterProblem]) -> tuple[int, ...]:
    """Choose the meters that sets are searched on: up to ALL_SEARCHED all, of more SEARCHED.

    The largest power of each type of drive goes first, then the second largest, and so on.
    """
    if len(meters) <= ALL_SEARCHED:
        return tuple(range(len(meters)))
    names = [meter.signals.names[0] for meter in meters]
    ranked = [
        (rank, d)
        for own in assign(names, infer_types(names)).values()
        for rank, d in enumerate(sorted(own, key=lambda d: -meters[d].rms))
    ]
    return tuple(sorted(d for _, d in sorted(ranked)[:SEARCHED]))


def _friction_at_one(
    actives: Sequence[Active],
    scaled: Floats,
    nuisances: int,
    at_one: Mapping[int, tuple[str, float]],
    point: Point,
) -> Floats:
    """Weights of effects and nuisances in the friction at 1 rad/s, N·m [n + z]."""
    weights, place = np.zeros(len(scaled) + nuisances), 0
    sizes = {'friction': 0.0, 'viscous': 0.0}
    for active in actives:
        share = 0.0
        if active.name in ('viscous_friction', 'coulomb_friction'):
            share = 1.0
        elif active.name == 'stribeck_friction':
            share = float(np.exp(-(active.parameters['speed'] ** -2)))
        weights[place] = share * scaled[place]
        if active.name in point and share:
            sizes[KINDS[active.name]] += share * float(point[active.name][1][0])
        place += len(active.effect.terms)
    for column, (kind, value) in at_one.items():
        weights[len(scaled) + len(SENSORS) + column] = sizes[kind] * value
    return weights
