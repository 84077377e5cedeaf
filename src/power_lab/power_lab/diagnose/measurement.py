"""Errors of the measurement as the posterior has them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.posterior.judged import JudgedEffects
from power_estimator.posterior.priors import NAMED, OFF
from power_estimator.posterior.sensors import SENSORS, spreads
from wattwalk_core.arrays import Floats

from power_lab.diagnose.findings import short

_MATTERS = 0.2  # of the model's error, that ignoring it costs
_FAR = 2.0  # spreads of what such sensors are known for


@dataclass(frozen=True)
class MeasurementTerm:
    """Error of a sensor or meter, for the drive where it costs most, and for all drives."""

    name: str
    value: float
    interval: tuple[float, float]
    watts: float  # rms error if it is ignored
    matters: bool
    far_out: bool  # beyond what such sensors are known for
    drive: str
    at_motor: bool  # the torque comes from the motor's current
    drives: Mapping[str, float]
    recordings: Mapping[str, float] = field(default_factory=dict)

    def json(self) -> dict[str, object]:
        """Return JSON-compatible values, as `diagnose --json` writes them."""
        return {
            'value': self.value,
            'interval': list(self.interval),
            'matters': self.matters,
            'unit': SENSORS[self.name].unit,
            'watts': round(self.watts, 4),
            'drive': self.drive,
            'drives': dict(self.drives),
            'recordings': dict(self.recordings),
        }

    @property
    def sentence(self) -> str:
        """Sentence on the error: drive, size, and the check or calibration that removes it."""
        read = f'{1.0 + self.value:.2f} of what the power says'
        match self.name:
            case 'torque_scale' if self.at_motor:
                check = 'check its constant, and the meter.'
                return f'The torque of {self.drive} reads {read}: {check}'
            case 'torque_scale':
                gear = f', or a gear that loses {-self.value:.0%}' if self.value < 0 else ''
                check = f'a wrong scale{gear}, or the meter; weigh a known mass on it.'
                return f'The torque of {self.drive} reads {read}: {check}'
            case 'power_gain':
                way = 'high' if self.value > 0 else 'low'
                return (
                    f'The power meter of {self.drive} reads {abs(self.value):.0%} {way} for its '
                    'torque: calibrate it against a reference, or weigh a known mass.'
                )
            case 'torque_bias':
                return (
                    f'The torque of {self.drive} has a constant error of {self.value:.2g} N·m: '
                    'the zero of its sensor, or friction in one direction; read it unloaded at '
                    'rest, from both sides.'
                )
        size = f'{self.value:.3g} {SENSORS[self.name].unit}'
        if self.name == 'meter_filter' and self.value > 0:  # half of a time constant squared
            size = f'{np.sqrt(2.0 * self.value):.2g} s'
        error = f'{self.name.replace("_", " ")} of {size}'
        return f'Allowed for in {self.drive}: {error}; to be rid of it, {_CHECKS[self.name]}.'


def measurement_terms(
    found: JudgedEffects, prepared: Prepared, rms_w: float, apart: Mapping[str, Floats]
) -> dict[str, MeasurementTerm]:
    """Errors of the sensors by name, with 95 % intervals.

    rms_w: rms error of the model in W, by which an error is large enough to matter; apart: by
    name, its deviations in each recording from the mean of all [M, R].
    """
    usual, names = spreads(prepared.signals), prepared.names
    lag = prepared.lag.mean(keepdims=True) if prepared.whole else prepared.lag
    out = {}
    for name in found.meters[0].sensors:
        if prepared.steady and name not in _SCALES_AND_OFFSETS:
            continue
        drawn = [one.sensors[name] for one in found.meters]
        costs = np.array([one.costs[name] for one in found.meters])
        worst = int(np.argmax(costs))
        middle = float(np.mean(drawn[worst]))
        low, high = np.quantile(drawn[worst], [0.025, 0.975]).tolist()
        if name in found.scales:
            far = sure = found.scales[name] >= NAMED and abs(middle) > OFF
        else:
            sure = not low <= 0.0 <= high
            far = sure and abs(middle) > _FAR * usual[name]
        matters = bool(sure and costs[worst] >= _MATTERS * rms_w)
        known = lag if name == 'velocity_lag' else np.zeros(len(names))
        out[name] = MeasurementTerm(
            name=name,
            value=short(middle + known[worst]),
            interval=(short(low + known[worst]), short(high + known[worst])),
            watts=float(costs[worst]),
            matters=matters,
            far_out=bool(matters and far),
            drive=names[worst],
            at_motor=bool(prepared.signals.at_motor[0 if prepared.whole else worst]),
            drives={
                drive: short(float(np.mean(own)) + float(shift))
                for drive, own, shift in zip(names, drawn, known, strict=True)
            },
            recordings=_by_recording(prepared, middle + apart[name][worst])
            if name in apart
            else {},
        )
    return out


def _by_recording(prepared: Prepared, values: Floats) -> Mapping[str, float]:
    """Values [R] by recording; a name that comes twice gets its number."""
    out: dict[str, float] = {}
    for number, (name, value) in enumerate(zip(prepared.recordings, values, strict=True)):
        out[f'{name} ({number + 1})' if name in out else name] = short(float(value))
    return out


_SCALES_AND_OFFSETS = ('power_gain', 'torque_scale', 'current_offset', 'torque_bias')
_CHECKS: Mapping[str, str] = {
    'current_offset': 'read the meter with the drive unplugged',
    'offset_drift': 'read the meter with the drive unplugged, before and after',
    'torque_hysteresis': 'load it with known masses, more and more and then less',
    'torque_slip': 'load it with known masses, more and more and then less',
    'velocity_lag': 'compare it with the slope of the position, and turn its filter off',
    'torque_lag': 'compare it with the current at a step of torque, and turn its filter off',
    'time_offset': 'compare the stamps of power and torque at a step of torque',
    'meter_filter': 'turn the averaging of the meter off, or record it faster',
}
