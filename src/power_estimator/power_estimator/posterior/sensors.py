"""Errors of the measurement as columns, scaled to what such sensors are known for."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects import Signals
from power_estimator.effects.signals.prepared import rate_of


@dataclass(frozen=True)
class Sensor:
    """One error: its unit, and its spread for the reference drive."""

    unit: str
    spread: float


SENSORS: Final[Mapping[str, Sensor]] = {
    'power_gain': Sensor('1', 0.06),
    'torque_scale': Sensor('1', 0.1),
    'current_offset': Sensor('A', 0.02),  # the zero of a Hall sensor of some 20 A
    'offset_drift': Sensor('A/min', 0.003),
    'torque_bias': Sensor('N·m', 0.25),
    'torque_hysteresis': Sensor('N·m', 0.5),
    'torque_slip': Sensor('N·m', 0.5),
    'torque_play': Sensor('N·m', 0.5),
    'velocity_lag': Sensor('s', 0.0015),
    'torque_lag': Sensor('s', 0.0015),
    'time_offset': Sensor('s', 0.001),
    'meter_filter': Sensor('s²', 5e-6),
    'unmetered_load': Sensor('W', 50.0),  # the computers of a legged robot
}
SCALES: Final = ('power_gain', 'torque_scale')
UNMOVED: Final = ('current_offset', 'offset_drift', 'velocity_lag')
"""Errors that have nothing to do with what a model takes the power to be."""
AT_MOTOR: Final = 0.2
"""Torque by a current and a constant is off by a fifth, a torque sensor by a tenth."""
_SLIPS: Final[Mapping[str, float]] = {'torque_slip': 0.05, 'torque_play': 0.15}
"""
Half of the way, in rms torques, over which a sensor's hysteresis turns round.

Sums of such plays make the loops of sensors (Krasnosel'skii and Pokrovskii 1983). With one alone,
loops of another width were named heating of a winding.
"""
LOOPS: Final = tuple(_SLIPS)
"""Parts of one hysteresis: their sum is stated, by the name of the first."""


def spreads(signals: Signals) -> Mapping[str, float]:
    """Prior spread of each error for these drives, in its unit."""
    out = {
        name: one.spread * float(signals.scale.factor(one.unit, of_sensor=True).max())
        for name, one in SENSORS.items()
    }
    if signals.at_motor.all():
        out['torque_scale'] = AT_MOTOR
    # A rate of few samples a second moves lags by a part of its period.
    lag = max(out['torque_lag'], 0.3 / signals.rate)
    out['velocity_lag'] = out['torque_lag'] = lag
    out['meter_filter'] = max(out['meter_filter'], lag**2)
    return out


@dataclass(frozen=True)
class SensorErrors:
    """Watts of one spread of each error, as far as no estimate of the power moves them."""

    signals: Signals
    spread: Floats  # of each of SENSORS, in its unit
    hysteresis: Floats  # −1 to 1 [T, D]
    slips: Mapping[str, Floats]  # the same by name, of a sensor's plays

    @classmethod
    def of(cls, signals: Signals) -> 'SensorErrors':
        """Take the errors' spreads and forms from the signals of a meter's drives."""
        fast = np.sqrt(np.mean(signals.torque_rate**2, axis=0)) + 1e-9
        moves = float(not signals.steady)  # operating points are in no order
        size = np.sqrt(np.mean(signals.torque**2, axis=0)) + 1e-12
        return cls(
            signals,
            np.array([*spreads(signals).values()]),
            np.tanh(3.0 * signals.torque_rate / fast),
            {name: moves * slip(signals.torque, share * size) for name, share in _SLIPS.items()},
        )

    def watts(self, power: Floats, slope: Floats, blocked: Floats) -> list[Floats]:
        """Errors [T, D] in the order of SENSORS, in one spread.

        power: W [T, D]; slope: of the power by the torque, W/(N·m) [T, D]; blocked: each drive's
        share of what the supply does not take back [T, D], 0 at other times.
        """
        s = self.signals
        moves = float(not s.steady)
        minutes = moves * (s.time - s.time.mean())[:, None] / 60.0
        voltage = s.voltage / s.voltage.shape[1]
        whole = [slice(0, len(power))]
        rate = moves * rate_of(power, whole, s.rate)
        errors = {
            'power_gain': power,
            'torque_scale': s.torque * slope,
            'current_offset': voltage,
            'offset_drift': voltage * minutes,
            'torque_bias': slope,
            'torque_hysteresis': slope * self.hysteresis,
            **{name: slope * own for name, own in self.slips.items()},
            'velocity_lag': s.torque * s.acceleration,
            'torque_lag': slope * s.torque_rate,
            'time_offset': -rate,
            # A low-pass whose delay is out: T²/2 times the second rate.
            'meter_filter': rate_of(rate, whole, s.rate),
            # It takes what drives return, and only the rest is blocked.
            'unmetered_load': -blocked,
        }
        return [
            np.broadcast_to(spread * errors[name], s.torque.shape)
            for name, spread in zip(SENSORS, self.spread, strict=True)
        ]


def slip(values: Floats, reach: Floats) -> Floats:
    """Play, −1 to 1 [T, D], that follows values [T, D] between its ends, apart by 2·reach [D].

    s[t] = clip(s[t − 1] + d values / reach, −1, 1). Such steps compose to steps of their kind, so
    that all are found by doubling.
    """
    add = np.diff(values, axis=0, prepend=values[:1]) / reach
    low, high = np.full_like(add, -1.0), np.full_like(add, 1.0)
    ahead = 1
    while ahead < len(add):
        first = add[:-ahead], low[:-ahead], high[:-ahead]
        then = add[ahead:], low[ahead:], high[ahead:]
        ends = [np.clip(end + then[0], then[1], then[2]) for end in first[1:]]
        total = first[0] + then[0]
        add, low, high = (
            np.concatenate([old[:ahead], new])
            for old, new in zip((add, low, high), (total, *ends), strict=True)
        )
        ahead *= 2
    return np.asarray(np.clip(add, low, high))
