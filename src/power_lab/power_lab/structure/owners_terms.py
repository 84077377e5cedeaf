"""Coefficients of effects in the terms of a drive's owner, beside the textbook's values."""

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

    def read(number: float) -> float:
        if active.name == 'spring':
            return 1.0 / number if number > 0.0 else np.inf
        return factor * number

    text, factor = _text_and_factor(active, symbol, drive)
    if not text or not np.isfinite(read(value)):
        return ''
    low, high = sorted(map(read, interval))
    return text.format(f'{_digits(read(value))} ({_digits(low)} … {_digits(high)})')


def _digits(value: float) -> str:
    return f'{value:.0f}' if 100.0 <= abs(value) < 1e5 else f'{value:.3g}'


def _text_and_factor(active: Active, symbol: str, drive: DriveAtWork) -> tuple[str, float]:
    """Text of a coefficient, '' for none, and the factor to its unit; a spring's is inverted."""
    constant, load, speed = drive.torque_constant, drive.load, drive.speed
    at_load, at_speed = f'{{}} W at {load:.3g} N·m', f'{{}} W at {speed:.3g} rad/s'
    by_current = bool(np.isfinite(constant))
    match active.name, symbol:
        case 'copper_loss', 'k':
            return ('{} W/A² in the winding', constant**2) if by_current else (at_load, load**2)
        case 'inverter_loss', 'a' | 's':
            return ('{} W/A of motor current', constant) if by_current else (at_load, load)
        case 'winding_heating', 'c':
            if active.parameters.get('time_constant') or drive.copper <= 0.0:
                return '', np.nan  # growth with a temperature that nobody measured
            text = f'the winding gains {{}} %/K; copper: {100 * COPPER:.2g}'
            return text, 100 * COPPER / drive.copper
        case 'saturation', 'c':
            return at_load, load**4
        case 'motor_saturation', 's':
            return f'{{}} % of the torque at {load:.3g} N·m', 100.0 * load**2
        case 'magnet_heating', 'alpha':
            return 'the magnets lose {} %/K', 100.0
        case 'iron_loss', 'h':
            return at_speed, speed
        case 'iron_loss', 'e':
            return at_speed, speed**2
        case 'line_resistance', 'Rl':
            return '{} mΩ in the supply line', 1000.0
        case 'load_friction', 'c':
            return 'the gear takes {} % of the load', 100.0
        case 'regeneration_efficiency', '1 − eta':
            return '{} % of what flows back is lost', 100.0
        case 'regeneration_limit', 'b':
            return '{} % of what flows back is blocked', 100.0
        case 'spring', '1/ks':
            return '{} N·m/rad', 1.0
    return '', np.nan
