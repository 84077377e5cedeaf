"""Departures of effects from their formulas, as columns of a meter's linear problem."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects import Signals
from power_estimator.effects.fit.design import Active, weighted
from power_estimator.effects.fit.design_builder import DesignBuilder
from power_estimator.effects.signals.reducer import Reducer
from power_estimator.posterior.discrepancy import fourier
from power_estimator.posterior.priors import DEPARTURES, KINDS
from power_estimator.posterior.sensors import slip

Point = Mapping[str, tuple[Active, Floats]]
"""Coefficients in SI by name of the effect."""
_TOWARDS_ZERO: Final = 0.05  # of the rms, where a direction fades out
_LOW: Final = 0.15  # of the rms speed, below which friction is another
_LENGTH: Final = 1.2  # of a smooth departure over its causes
_OCTAVES: Final = 4
"""Octaves, from 1 to 16 times, in which friction's sign may turn faster than by its formula.

Each takes part by a share of its own, of either sign: at rest a measured speed is noise, on which
the sign hardly depends, and beyond that it turns fast.
"""
_TURNS: Final = 0.5  # prior spread of an octave's share of the friction
_REACH: Final = 0.05  # s at the speed where its sign turns: the way on which friction turns
_AT_REST: Final = 0.5  # share of friction that a drive is held by when it stands
Kinds = tuple[str, ...]
_BENDS: Final[Mapping[Kinds, tuple[Mapping[str, float], int, float]]] = {
    ('friction', 'viscous', 'iron'): (
        {'speed': 1.0, 'load': 1.0, 'direction': 0.7, 'quadrant': 0.5},
        8,
        1.0,
    ),
    ('copper',): ({'load': 1.0}, 3, 1.0),
    ('shaft',): ({'load': 1.0, 'side': 0.7}, 4, 0.1),  # a torque sensor is nearly linear
}
"""By kinds of effects that depart smoothly together: weights of causes, features, and size."""


@dataclass(frozen=True)
class Departed:
    """Departures of the effects of a point, in watts at N rows."""

    formed: Floats  # [N, f], of the forms of DEPARTURES
    causes: tuple[str, ...]  # [f]
    at_one: Mapping[int, tuple[str, float]]  # kind and factor of friction at 1 rad/s, by column
    bent: Floats  # [N, b], smooth ones
    bent_causes: tuple[str, ...]  # [b]


class Departures:
    """Departures of a meter's effects from their formulas, in proportion to their power."""

    def __init__(self, builder: DesignBuilder) -> None:
        """builder: of the meter, which has its signals."""
        self._builder = builder

    def of(self, point: Point, signals: Signals) -> Departed:
        """Return the departures of a point's effects, and of the shaft's power.

        signals: with the motors' motion and torque at the point.
        """
        own = self._weighted(point, signals)
        powers = self._powers(point, own, signals)
        slow = self._when_slow(point, own, signals)
        fast = float(np.sqrt(np.mean(self._signals.velocity**2))) + 1e-9
        one = {
            'speed': float(np.log(1.0 / fast + _TOWARDS_ZERO)),
            'time': 1.0,
            'low': float(np.exp(-np.square(1.0 / (_LOW * fast)))),
        }
        at_one: dict[int, tuple[str, float]] = {}
        formed: list[Floats] = []
        causes: list[str] = []
        for kind, watts in powers.items():
            for form, spread in DEPARTURES[kind].items():
                if kind in ('friction', 'viscous'):
                    at_one[len(formed)] = kind, spread * one.get(form, 0.0)
                formed.append(spread * np.einsum('td,td->t', watts, self._thin_causes[form]))
                causes.append(f'departures of {kind}')
        bent, bent_causes = self._bent(powers)
        formed += [self._reducer.thin(watts).sum(axis=1) for watts in slow]
        causes += ['departures of friction'] * len(slow)
        reduced = self._reducer.reduce_thin(np.stack(formed).T)
        return Departed(reduced, tuple(causes), at_one, bent, tuple(bent_causes))

    def _bent(self, powers: Mapping[str, Floats]) -> tuple[Floats, list[str]]:
        """Smooth departures of drag, copper loss and the shaft's power [N, b], with causes.

        Iron loss departs as friction does: else the stiffer of the two would be named for it.
        """
        bent, causes = [], []
        for kinds, (_, _, share) in _BENDS.items():
            own = [powers[kind] for kind in kinds if kind in powers]
            if own:
                watts = self._reducer.reduce_thin(np.sum(own, axis=0))
                bent.append(share * np.einsum('nd,ndb->nb', watts, self._bends[kinds]))
                causes += [f'departures of {" and ".join(kinds)}'] * bent[-1].shape[1]
        return np.concatenate(bent, axis=1), causes

    def _weighted(self, point: Point, s: Signals) -> Mapping[str, Floats]:
        """Effects of a point by name, W, N·m or rad/s [T, D] as they act on these."""
        drives = s.torque.shape[1]
        return {
            name: weighted(
                self._builder.regressors(active, s), np.broadcast_to(own, (drives, len(own)))
            )
            for name, (active, own) in point.items()
        }

    def _powers(
        self, point: Point, effects: Mapping[str, Floats], s: Signals
    ) -> Mapping[str, Floats]:
        """Power of the shaft and of each kind of effects at a point, W [K, D] when thinned."""
        out = {'shaft': s.torque * s.velocity}
        for name, (active, _) in point.items():
            power, by = effects[name], active.effect.acts_on
            if by != 'power':
                power = power * (s.motor_velocity + s.torque_cost if by == 'torque' else s.torque)
            kind = _kind(name)
            out[kind] = out[kind] + power if kind in out else power
        return {kind: self._reducer.thin(power) for kind, power in out.items()}

    def _when_slow(self, point: Point, effects: Mapping[str, Floats], s: Signals) -> list[Floats]:
        """Departures of dry friction near standstill, W [T, D]; none without friction.

        The speed at which its sign turns is not known. And it holds a drive at rest as that last
        moved (Dahl 1968), where its formula is 0.
        """
        dry = {name: each for name, each in point.items() if _kind(name) == 'friction'}
        if not dry:
            return []
        standstill = s.scale.standstill
        rests = replace(s, motor_velocity=3.0 * standstill * self._last_way, velocity_noise=None)
        now, held = (
            np.sum([torques[name] for name in dry], axis=0)
            for torques in (effects, self._weighted(dry, rests))
        )
        near = np.abs(s.sliding) / standstill + 1e-9
        turns = [np.tanh(near)]
        for _ in range(_OCTAVES):
            turns.append(2.0 * turns[-1] / (1.0 + np.square(turns[-1])))  # tanh 2x by tanh x
        power = _TURNS * now * (s.motor_velocity + s.torque_cost) / turns[0]
        rest = (held - now) * np.exp(-np.square(near / 2.0)) * np.abs(self._last_way)
        return [
            *((fast - slow) * power for slow, fast in itertools.pairwise(turns)),
            _AT_REST * rest * s.torque_cost,
        ]

    @cached_property
    def _last_way(self) -> Floats:
        """The way that each drive last moved, −1 to 1 [T, D]; 0 where nothing shows it."""
        s, way = self._signals, np.zeros_like(self._signals.torque)
        if s.steady:
            return way
        for part in s.stretches():
            way[part] = slip(s.position[part], _REACH * s.scale.standstill)
        return np.nan_to_num(way)

    @property
    def _signals(self) -> Signals:
        return self._builder.prepared.signals

    @property
    def _reducer(self) -> Reducer:
        return self._builder.prepared.reducer

    @cached_property
    def _thin_causes(self) -> Mapping[str, Floats]:
        return {name: self._reducer.thin(cause) for name, cause in self._causes.items()}

    @cached_property
    def _causes(self) -> Mapping[str, Floats]:
        """Causes of departures, at the input rate [T, D]."""
        s = self._signals
        fast, strong = (np.sqrt(np.mean(x**2, axis=0)) + 1e-9 for x in (s.velocity, s.torque))
        direction = np.tanh(s.velocity / (_TOWARDS_ZERO * fast))
        side = np.tanh(s.torque / (2 * _TOWARDS_ZERO * strong))
        load = np.arcsinh(np.abs(s.torque) / strong)
        span = max(float(np.ptp(s.time)), 1e-9)
        time = 2 * (s.time - s.time.mean()) / span
        return {
            'speed': np.log(np.abs(s.velocity) / fast + _TOWARDS_ZERO),
            'load': load - load.mean(axis=0),
            'direction': direction,
            'side': side,
            'quadrant': direction * side,
            'time': np.broadcast_to(time[:, None] * (not s.steady), load.shape),
            'saturation': np.square(s.torque / (np.abs(s.torque).max(axis=0) + 1e-9)),
            'low': np.exp(-np.square(s.velocity / (_LOW * fast))),
        }

    @cached_property
    def _bends(self) -> Mapping[Kinds, Floats]:
        """Random Fourier features of how kinds of effects may depart smoothly [N, D, b]."""
        out = {}
        for kinds, (weights, count, _) in _BENDS.items():
            random = np.random.default_rng(5)
            raw = [weight * self._causes[name] for name, weight in weights.items()]
            by_drive = self._builder.prepared.reduced(np.stack(raw, axis=2)).swapaxes(0, 1)
            parts = [fourier(random, inputs, count, _LENGTH) for inputs in by_drive]
            out[kinds] = np.stack(parts, axis=1)
        return out


def _kind(name: str) -> str:
    """Kind of an effect by its name, also of one that is a drive's own."""
    return KINDS.get(name.partition('@')[0], 'other')
