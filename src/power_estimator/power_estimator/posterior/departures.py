"""Departures of effects from their formulas, as columns of a meter's linear problem."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects import Signals
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.design_builder import DesignBuilder
from power_estimator.posterior.discrepancy import fourier
from power_estimator.posterior.priors import DEPARTURES, KINDS

Point = Mapping[str, tuple[Active, Floats]]
"""Coefficients in SI by name of the effect."""
_TOWARDS_ZERO: Final = 0.05  # of the rms, where a direction fades out
_LOW: Final = 0.15  # of the rms speed, below which friction is another
_LENGTH: Final = 1.2  # of a smooth departure over its causes
_SHAFT: Final = 0.1  # of an effect's smooth departure: a torque sensor is nearly linear


@dataclass(frozen=True)
class Departed:
    """Departures of the effects of a point, in watts at N rows."""

    formed: Floats  # [N, f], of the forms of DEPARTURES
    causes: tuple[str, ...]  # [f]
    at_one: Mapping[int, tuple[str, float]]  # kind and factor of friction at 1 rad/s, by column
    bent: Floats  # [N, b], smooth ones
    bent_causes: tuple[str, ...]  # [b]


@dataclass(frozen=True)
class _Parts:
    """Low-passed power of one unit of an effect's n coefficients."""

    power: Floats  # [n, N, D]
    formed: Floats  # [n, N, f], times the forms that its kind departs by


class Departures:
    """Departures of a meter's effects; each effect's are linear in its coefficients.

    They are worked out once about one state of the drives, and stand for that of all points near.
    """

    def __init__(self, builder: DesignBuilder) -> None:
        """builder: of the meter, which has its signals."""
        self._builder = builder
        self._about: Signals | None = None
        self._kept: dict[object, _Parts] = {}

    def about(self, signals: Signals) -> None:
        """Take the motors' motion and torque of a point from now on."""
        self._about, self._kept = signals, {}

    def of(self, point: Point) -> Departed:
        """Return the departures of a point's effects, and of the shaft's power."""
        kinds: dict[str, list[tuple[_Parts, Floats]]] = {
            'shaft': [(self._parts(None), np.ones(1))]
        }
        for active, own in point.values():
            kinds.setdefault(_kind(active), []).append((self._parts(active), own))
        fast = float(np.sqrt(np.mean(self._signals.velocity**2))) + 1e-9
        one = {
            'speed': float(np.log(1.0 / fast + _TOWARDS_ZERO)),
            'time': 1.0,
            'low': float(np.exp(-np.square(1.0 / (_LOW * fast)))),
        }
        at_one: dict[int, tuple[str, float]] = {}
        causes: list[str] = []
        for kind in kinds:
            for form, spread in DEPARTURES[kind].items():
                if kind in ('friction', 'viscous'):
                    at_one[len(causes)] = kind, spread * one.get(form, 0.0)
                causes.append(f'departures of {kind}')
        formed = [
            sum(np.tensordot(own, parts.formed, 1) for parts, own in each)
            for each in kinds.values()
        ]
        bent, bent_causes = self._bent(kinds)
        return Departed(
            np.concatenate(formed, axis=1), tuple(causes), at_one, bent, tuple(bent_causes)
        )

    def _bent(
        self, kinds: Mapping[str, Sequence[tuple[_Parts, Floats]]]
    ) -> tuple[Floats, list[str]]:
        """Smooth departures of friction, copper loss and the shaft's power [N, b], with causes."""
        bent, causes = [], []
        for own, bends, share in (
            (('friction', 'viscous'), self._bends, 1.0),
            (('copper',), self._bends_by_load, 1.0),
            (('shaft',), self._bends_by_torque, _SHAFT),
        ):
            found = [each for kind in own for each in kinds.get(kind, ())]
            if found:
                watts = sum(np.tensordot(values, parts.power, 1) for parts, values in found)
                bent.append((share * np.asarray(watts)[..., None] * bends).sum(axis=1))
                causes += [f'departures of {" and ".join(own)}'] * bent[-1].shape[1]
        return np.concatenate(bent, axis=1), causes

    def _parts(self, active: Active | None) -> _Parts:
        """Power of an effect, or of the shaft, and its departures."""
        key = active and active.key
        if key not in self._kept:
            s = self._signals if self._about is None else self._about
            if active is None:
                kind, power = 'shaft', (s.torque * s.velocity)[..., None]
            else:
                kind, power = _kind(active), self._builder.regressors(active, s)
                by = active.effect.acts_on
                if by != 'power':
                    slope = s.motor_velocity + s.torque_cost if by == 'torque' else s.torque
                    power = power * slope[..., None]
            forms = [spread * self._causes[form] for form, spread in DEPARTURES[kind].items()]
            formed = np.stack([(form[..., None] * power).sum(axis=1) for form in forms], axis=1)
            self._kept[key] = _Parts(self._by_term(power), self._by_term(formed))
        return self._kept[key]

    def _by_term(self, watts: Floats) -> Floats:
        """Low-pass watts [T, k, n], to [n, N, k]."""
        return np.ascontiguousarray(np.moveaxis(self._builder.prepared.reduced(watts), 2, 0))

    @property
    def _signals(self) -> Signals:
        return self._builder.prepared.signals

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
    def _bends(self) -> Floats:
        """Random Fourier features of how friction may depart smoothly [N, D, b]."""
        weights = {'speed': 1.0, 'load': 1.0, 'direction': 0.7, 'quadrant': 0.5}
        return self._fourier(weights, 8)

    @cached_property
    def _bends_by_load(self) -> Floats:
        """The same of copper loss, which departs by the load alone [N, D, b]."""
        return self._fourier({'load': 1.0}, 3)

    @cached_property
    def _bends_by_torque(self) -> Floats:
        """The same of a torque sensor, whose line bends by the torque alone [N, D, b]."""
        return self._fourier({'load': 1.0, 'side': 0.7}, 4)

    def _fourier(self, weights: Mapping[str, float], count: int) -> Floats:
        random = np.random.default_rng(5)
        raw = np.stack([weight * self._causes[name] for name, weight in weights.items()], axis=2)
        inputs = self._builder.prepared.reduced(raw)
        parts = [fourier(random, inputs[:, d], count, _LENGTH) for d in range(inputs.shape[1])]
        return np.stack(parts, axis=1)


def _kind(active: Active) -> str:
    return KINDS.get(active.name.partition('@')[0], 'other')
