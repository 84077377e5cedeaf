"""Columns, noise and normal equations of one drive."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Signals, builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure, weighted
from power_estimator.effects.fit.design_builder import DesignBuilder
from power_estimator.effects.signals.prepared import Prepared

from discrepancy.linear import Columns, Noise, Normal
from discrepancy.priors import (
    BENT,
    BLOCK,
    COEFFICIENTS,
    DEPARTURES,
    DISCREPANCY,
    KINDS,
    MISSING,
    SPIKE,
)

Floats = NDArray[np.float64]
Point = Mapping[str, tuple[Active, Floats]]
"""Coefficients in SI by name of the effect."""
CATALOGUE: Final = builtin_catalogue()


class DriveProblem:
    """One drive's rows, columns and noise."""

    def __init__(self, prepared: Prepared) -> None:
        self.prepared, self.signals = prepared, prepared.signals
        self.builder = DesignBuilder(prepared)
        self.delay = 0.0
        self.noise: Noise | None = None
        self.absent: dict[str, Floats] = {}
        self.used = prepared.measured[:, 0] & prepared.resolved[:, 0]
        self.candidates = [
            Active.of(effect, shape)
            for effect in (CATALOGUE[name] for name in MISSING)
            for shape in effect.shapes_of(self.signals.scale)
            # Iron loss whose current heats the winding is friction by another name.
            if effect.usable(self.signals, **shape) and not shape.get('carried')
        ]

    def power(self) -> Floats:
        """Metered watts with the delay taken out [N]."""
        return self.prepared.power_at(self.delay)[:, 0]

    @cached_property
    def rms(self) -> float:
        """Rms of the metered power, W."""
        return float(np.sqrt(np.mean(np.square(self.power()[self.used]))))

    @cached_property
    def causes(self) -> dict[str, Floats]:
        """Causes that departures depend on, at the input rate [T]."""
        s = self.signals
        speed, torque = s.velocity[:, 0], s.torque[:, 0]
        fast, strong = (np.sqrt(np.mean(x**2)) + 1e-9 for x in (speed, torque))
        direction = np.tanh(speed / (0.05 * fast))
        load = np.arcsinh(np.abs(torque) / strong)
        middle, span = s.time.mean(), np.ptp(s.time)
        return {
            'speed': np.log(np.abs(speed) / fast + 0.05),
            'load': load - load.mean(),
            'direction': direction,
            'quadrant': direction * np.tanh(torque / (0.1 * strong)),
            'time': 2 * (s.time - middle) / span,
            'low': np.exp(-np.square(speed / (0.15 * fast))),
            'fast': fast,
        }

    @cached_property
    def bends(self) -> Floats:
        """Random Fourier features of how an effect's power may depart smoothly, [T, 16]."""
        c = self.causes
        inputs = (c['speed'], c['load'], 0.7 * c['direction'], 0.5 * c['quadrant'])
        return _fourier(np.random.default_rng(5), np.stack(inputs, axis=1), 8, 1.2)

    @cached_property
    def general(self) -> Floats:
        """The discrepancy's features: sums of functions of one, two and all causes, [N, a]."""
        s, random = self.signals, np.random.default_rng(0)
        given = [s.torque, s.velocity, s.acceleration, s.torque_rate]
        scaled = [np.clip(x / (np.sqrt(np.mean(x**2)) + 1e-12), -6, 6) for x in given]
        if np.isfinite(s.position).all() and np.ptp(s.position) < 4 * np.pi:
            scaled.append((s.position - s.position.mean()) / (s.position.std() + 1e-9))
        parts = [_fourier(random, scaled[i], 5, 0.7) for i in (0, 1, *range(4, len(scaled)))]
        parts.append(_fourier(random, np.concatenate(scaled[:2], axis=1), 12, 1.0))
        parts.append(_fourier(random, np.concatenate(scaled, axis=1), 20, 1.6))
        time = self.prepared.time - self.prepared.time[0]
        waves = np.arange(1, int(np.clip(time[-1] / 15, 1, 20)) + 1)
        slow = np.cos(np.pi * waves * time[:, None] / time[-1]) / waves
        reduced = self.prepared.reduced(np.concatenate(parts, axis=1))
        return np.concatenate([reduced, slow], axis=1)

    def columns(self, actives: Sequence[Active], point: Point) -> Columns:
        """Linearise effects about a point, which has coefficients in SI by name."""
        chosen = [active for active, _ in point.values()]
        structure = Structure((Active.of(CATALOGUE['shaft']), *chosen))
        values = np.concatenate([own for _, own in point.values()] or [np.empty(0)])
        at = self.builder.point(structure, values[None])
        reduced, s = self.prepared.reduced, at.signals
        raw = [self.builder.columns(active, at)[:, 0] for active in actives]
        joined = np.concatenate(raw, axis=1)
        size = np.maximum(np.sqrt(np.mean(joined[self.used] ** 2, axis=0)), 1e-12)
        linear = sum(
            (self.builder.columns(active, at)[:, 0] @ own for active, own in point.values()),
            np.zeros(len(joined)),
        )
        slope = s.motor_velocity + s.torque_cost
        powers = _by_kind(point, s, slope)
        bent, departures, at_one = self._departures(powers)
        names = {active.name for active in actives}
        absent = [own for name, own in self.absent.items() if name not in names]
        sensors = self._sensors(at.power, s, slope)
        nuisance = np.concatenate([sensors, departures, *absent], axis=1)
        general = self.general * self.rms
        columns = Columns(
            tuple(actives),
            joined / size * self.rms,
            self.rms / size,
            nuisance,
            np.concatenate([general, bent], axis=1),
            general.shape[1],
            reduced(at.power)[:, 0] - linear,
            {},
        )
        return replace(columns, at_one=self._at_one(columns, point, sensors.shape[1], at_one))

    def _sensors(self, power: Floats, s: Signals, slope: Floats) -> Floats:
        """Errors of the measurement, scaled to what such sensors are known for [N, 9]."""
        reduced, scale = self.prepared.reduced, s.scale
        ampere, newton = float(scale.factor('A')[0]), float(scale.torque[0])
        minutes = (self.prepared.time - self.prepared.time.mean())[:, None] / 60.0
        voltage = reduced(s.voltage)
        way = np.tanh(s.torque_rate / (np.sqrt(np.mean(s.torque_rate**2)) + 1e-9) * 3.0)
        # Torque by a current and a constant is off by a fifth, a torque sensor by a tenth.
        torque_scale = 0.2 if s.at_motor.all() else 0.1
        return np.concatenate(
            [
                0.06 * reduced(power),  # gain of the meter
                torque_scale * reduced(s.torque * slope),
                0.01 * ampere * voltage,  # offset of its current
                0.003 * ampere * voltage * minutes,  # and its drift, A/min
                0.25 * newton * reduced(slope),  # offset of the torque
                0.5 * newton * reduced(slope * way),  # hysteresis of the torque
                0.0015 * reduced(s.torque * s.acceleration),  # s, lag of the velocity
                0.0015 * reduced(slope * s.torque_rate),  # s, lag of the torque
                -0.004 * reduced(np.gradient(power, 1.0 / s.rate, axis=0)),  # s, delay
            ],
            axis=1,
        )

    def _departures(self, powers: Mapping[str, Floats]) -> tuple[Floats, Floats, list[float]]:
        """Smooth departures [N, b], those of DEPARTURES [N, k], and friction's at 1 rad/s [k]."""
        c, reduced = self.causes, self.prepared.reduced
        low = np.exp(-np.square(1.0 / (0.15 * c['fast'])))
        one = (np.log(1.0 / c['fast'] + 0.05), -c['load'].mean(), 0.0, 0.0, 1.0, low)
        bent, departures, at_one = [], [], []
        for kind, watts in powers.items():
            speed, load, way, time, slow = DEPARTURES[kind]
            spreads = (speed, load, way, way, time, slow)
            forms = ('speed', 'load', 'direction', 'quadrant', 'time', 'low')
            for form, spread, value in zip(forms, spreads, one, strict=True):
                if spread:
                    departures.append(spread * reduced(watts * c[form][:, None]))
                    at_one.append(spread * value if kind == 'friction' else 0.0)
            if kind in ('friction', 'copper', 'shaft'):
                bent.append((0.1 if kind == 'shaft' else 1.0) * reduced(watts * self.bends))
        return np.concatenate(bent, axis=1), np.concatenate(departures, axis=1), at_one

    def _at_one(
        self,
        columns: Columns,
        point: Point,
        sensors: int,
        at_one: Sequence[float],
    ) -> dict[str, Floats]:
        """Weights of the quantities whose intervals are scored."""
        count = columns.effects.shape[1]
        out = {}
        place, friction, size = 0, np.zeros(count + columns.nuisance.shape[1]), 0.0
        for active in columns.actives:
            if name := COEFFICIENTS.get(active.name):
                weights = np.zeros(len(friction))
                weights[place] = columns.watts[place]
                out[name] = weights
            if share := _at_one_rad(active):
                friction[place] = share * columns.watts[place]
                size += share * float(point[active.name][1][0]) if active.name in point else 0.0
            place += len(active.effect.terms)
        if friction.any():
            friction[count + sensors : count + sensors + len(at_one)] = size * np.array(at_one)
            out['friction_at_1'] = friction
        return out

    def find_delay(self, columns: Columns) -> None:
        """Profile the delay of the power in a ridge fit of everything."""
        given = (columns.effects, columns.nuisance[:, :-1], columns.smooth)
        a = np.concatenate(given, axis=1)[self.used]
        a = a / np.maximum(np.sqrt(np.mean(a**2, axis=0)), 1e-12)
        factor = np.linalg.cholesky(a.T @ a + 1e-4 * len(a) * np.eye(a.shape[1]))
        errors = []
        for shift in self.prepared.shifts.tolist():
            y = (self.prepared.power_at(shift)[:, 0] - columns.constant)[self.used]
            errors.append(y @ y - np.sum(np.square(np.linalg.solve(factor, a.T @ y))))
        self.delay = float(self.prepared.shifts[int(np.argmin(errors))])

    def learn_noise(self, columns: Columns, known: Sequence[str]) -> None:
        """Noise, weights and tempering by a fit of all effects; what absent ones may explain."""
        rows = np.flatnonzero(self.used)
        a = np.concatenate([columns.effects, columns.nuisance, columns.smooth], axis=1)[rows]
        y = (self.power() - columns.constant)[rows]
        spread = np.ones(a.shape[1])
        spread[: columns.effects.shape[1]] = 0.1
        spread[-columns.smooth.shape[1] :] = 0.01
        blocks = np.array_split(np.arange(len(rows)), max(4, round(len(rows) / (50 * BLOCK))))
        share, variance = np.ones(len(blocks)), 1e-3 * float(y @ y) / len(y)
        for _ in range(3):
            weights = np.concatenate(
                [np.full(len(b), w) for b, w in zip(blocks, share, strict=True)]
            )
            gram, moment = a.T @ (a * weights[:, None]), a.T @ (weights * y)
            for _ in range(3):
                x = np.linalg.solve(gram / variance + np.diag(spread**-2), moment / variance)
                left = y - a @ x
                variance = float(weights @ left**2 / len(y))
            errors = np.array([np.mean(left[b] ** 2) for b in blocks])
            share = 5.0 / (4.0 + errors / np.median(errors))  # Student's t with 4 degrees
            share /= share.max()
        scores = np.stack([(weights[b] * left[b]) @ a[b] for b in blocks]) / variance
        inverse = np.linalg.inv(gram / variance + np.diag(spread**-2))
        used = slice(0, columns.effects.shape[1])
        meat = np.einsum('ij,ji->i', inverse, scores.T @ scores)[used].sum()
        bread = np.einsum('ij,ji->i', inverse, gram / variance)[used].sum()
        everywhere = np.zeros(len(self.used))
        everywhere[rows] = weights
        self.noise = Noise(variance, everywhere, max(1.0, float(meat / bread)))
        self.absent = {}
        own = defaultdict(list)
        place = 0
        for active in columns.actives:
            own[active.name].append(columns.effects[:, place : place + len(active.effect.terms)])
            place += len(active.effect.terms)
        for name, parts in own.items():
            if name not in known:
                joined = np.concatenate(parts, axis=1)
                self.absent[name] = joined * SPIKE / np.sqrt(joined.shape[1])

    def normals(self, columns: Columns) -> list[Normal]:
        """Evidence at each size of the discrepancy."""
        assert self.noise is not None
        weights = self.noise.weights / (self.noise.variance * self.noise.tempering)
        rows = np.flatnonzero(weights)
        a = np.concatenate([columns.effects, columns.nuisance, columns.smooth], axis=1)[rows]
        y, w = (self.power() - columns.constant)[rows], weights[rows]
        gram, moment, square = a.T @ (a * w[:, None]), a.T @ (w * y), float(w @ y**2)
        count = a.shape[1] - columns.smooth.shape[1]
        out = []
        for general in DISCREPANCY:
            for bent in BENT:
                spread = np.full(columns.smooth.shape[1], bent)
                spread[: columns.general] = general
                factor = np.linalg.cholesky(gram[count:, count:] + np.diag(spread**-2))
                left = np.linalg.solve(factor, gram[count:, :count])
                right = np.linalg.solve(factor, moment[count:])
                half = np.log(np.diag(factor)).sum() + np.log(spread).sum()
                constant = 0.5 * float(right @ right) - 0.5 * square - float(half)
                reduced = gram[:count, :count] - left.T @ left
                out.append(Normal(reduced, moment[:count] - left.T @ right, constant))
        return out


def _fourier(random: np.random.Generator, inputs: Floats, count: int, length: float) -> Floats:
    """Random Fourier features [T, 2·count] of inputs [T, k]: a Gaussian process."""
    phase = inputs @ random.normal(0.0, 1.0 / length, (inputs.shape[1], count))
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1) / np.sqrt(count)


def _by_kind(point: Point, s: Signals, slope: Floats) -> dict[str, Floats]:
    """Power of the shaft and of each kind of effect at a point, W [T, 1]."""
    out = {'shaft': s.torque * s.velocity}
    for active, own in point.values():
        kind = next(kind for kind, names in KINDS.items() if active.name in names)
        acts = {'torque': slope, 'speed': s.torque, 'power': 1.0}[active.effect.acts_on]
        out[kind] = out.get(kind, 0.0) + weighted(active.columns(s), own[None]) * acts
    return out


def _at_one_rad(active: Active) -> float:
    """Friction at 1 rad/s per unit coefficient."""
    shares = {'viscous_friction': 1.0, 'coulomb_friction': 1.0}
    if active.name == 'stribeck_friction':
        return float(np.exp(-(active.parameters['speed'] ** -2)))
    return shares.get(active.name, 0.0)
