"""Coefficients of effects in the terms of a drive's owner, beside the textbook's values."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from power_estimator.effects.fit.design import Active
from power_estimator.effects.library.winding import COPPER
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import Prepared


@dataclass(frozen=True)
class DriveAtWork:
    """Operating point of a drive, by which coefficients convert to terms of a data sheet."""

    load: float  # N·m, rms; NaN where unknown
    speed: float  # rad/s, rms; NaN where unknown
    copper: float  # W/(N·m)², 0 where the model has no copper loss
    torque_constant: float  # N·m/A, NaN where unknown

    @classmethod
    def of(cls, prepared: Prepared, drive: int, copper: float) -> 'DriveAtWork':
        """Take rms load and speed from the signals of a drive (index); copper: W/(N·m)²."""
        signals = prepared.signals
        load, speed = (
            float(np.sqrt(np.mean(np.square(x[:, drive]))))
            for x in (signals.torque, signals.velocity)
        )
        return cls(load, speed, copper, float(prepared.torque_constant[drive]))


def fitted_in_owners_terms(model: EffectModel) -> list[str]:
    """Coefficients of a model's groups as a data sheet has them, a line each."""
    lines = []
    for group in model.groups:
        copper = next(iter(group.coefficients.get('copper_loss', ())), None)
        constant = np.nan if group.torque_constant is None else group.torque_constant
        drive = DriveAtWork(np.nan, np.nan, 0.0 if copper is None else copper.value, constant)
        lines += [
            f'{group.type.name}: {text}'
            for active in model.structure.free
            for term, one in zip(active.effect.terms, group.coefficients[active.name], strict=True)
            if (text := in_owners_terms(active, term.symbol, one.value, one.interval, drive))
        ]
    return lines


def in_owners_terms(
    active: Active, symbol: str, value: float, interval: tuple[float, float], drive: DriveAtWork
) -> str:
    """A coefficient and its interval as a data sheet has it; '' where there is no such term."""
    read = _READ.get((active.name, symbol))
    found = None if read is None else read(active, drive)
    if found is None or not np.isfinite(found[1](value)):
        return ''
    text, convert = found
    low, high = sorted(convert(bound) for bound in interval)
    return text.format(f'{_digits(convert(value))} ({_digits(low)} … {_digits(high)})')


def _digits(value: float) -> str:
    return f'{value:.0f}' if 100.0 <= abs(value) < 1e5 else f'{value:.3g}'


_Reading = tuple[str, Callable[[float], float]]
_Read = Callable[[Active, DriveAtWork], _Reading | None]


def _times(factor: float, text: str) -> _Reading:
    return text, lambda value: factor * value


def _copper(_active: Active, drive: DriveAtWork) -> _Reading:
    if np.isfinite(drive.torque_constant):
        return _times(drive.torque_constant**2, '{} W/A² in the winding')
    return _times(drive.load**2, f'{{}} W at {drive.load:.3g} N·m')


def _heating(active: Active, drive: DriveAtWork) -> _Reading | None:
    if active.parameters.get('time_constant') or drive.copper <= 0.0:
        return None  # growth with a temperature that nobody measured
    text = f'the winding gains {{}} %/K; copper: {100 * COPPER:.2g}'
    return _times(100 * COPPER / drive.copper, text)


def _by_current(_active: Active, drive: DriveAtWork) -> _Reading:
    if np.isfinite(drive.torque_constant):
        return _times(drive.torque_constant, '{} W/A of motor current')
    return _times(drive.load, f'{{}} W at {drive.load:.3g} N·m')


_READ: dict[tuple[str, str], _Read] = {
    ('copper_loss', 'k'): _copper,
    ('winding_heating', 'c'): _heating,
    ('saturation', 'c'): lambda _, drive: _times(drive.load**4, f'{{}} W at {drive.load:.3g} N·m'),
    ('motor_saturation', 's'): lambda _, drive: _times(
        100.0 * drive.load**2, f'{{}} % of the torque at {drive.load:.3g} N·m'
    ),
    ('magnet_heating', 'alpha'): lambda *_: _times(100.0, 'the magnets lose {} %/K'),
    ('inverter_loss', 'a'): _by_current,
    ('inverter_loss', 's'): _by_current,
    ('iron_loss', 'h'): lambda _, drive: _times(drive.speed, f'{{}} W at {drive.speed:.3g} rad/s'),
    ('iron_loss', 'e'): lambda _, drive: _times(
        drive.speed**2, f'{{}} W at {drive.speed:.3g} rad/s'
    ),
    ('line_resistance', 'Rl'): lambda *_: _times(1000.0, '{} mΩ in the supply line'),
    ('load_friction', 'c'): lambda *_: _times(100.0, 'the gear takes {} % of the load'),
    ('regeneration_efficiency', '1 − eta'): lambda *_: _times(
        100.0, '{} % of what flows back is lost'
    ),
    ('regeneration_limit', 'b'): lambda *_: _times(100.0, '{} % of what flows back is blocked'),
    ('spring', '1/ks'): lambda *_: (
        '{} N·m/rad',
        lambda value: 1.0 / value if value > 0.0 else np.inf,
    ),
}
