"""Torque constants that fall with the load, and with the temperature of the magnets."""

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.effect import Effect, Excitation, Term
from power_estimator.effects.library.winding import REFERENCE
from power_estimator.effects.signals.state import Signals

_LOADS = (-40.0, -30.0, -20.0, -10.0, 10.0, 20.0, 30.0, 40.0)
_MOST_PER_KELVIN = 0.005  # ferrite loses 0.002/K, neodymium 0.001/K


def _more_current(signals: Signals, **_: float) -> Floats:
    """Torque to the fourth, of a torque at the joint."""
    return (signals.motor_torque**4 * ~signals.at_motor)[..., None]


def _more_current_slope(signals: Signals, coefficients: Floats) -> Floats:
    """Four times the coefficient times the torque cubed."""
    return 4.0 * coefficients[..., 0] * signals.motor_torque**3 * ~signals.at_motor


def _less_torque(signals: Signals, **_: float) -> Floats:
    """Minus the shaft's power times the torque squared, of a torque by its current."""
    return (-(signals.torque**3) * signals.motor_velocity * signals.at_motor)[..., None]


def _weaker(signals: Signals, **_: float) -> Floats:
    """Minus the shaft's power times the rise in temperature, of a torque by its current."""
    rise = np.nan_to_num(signals.temperature - REFERENCE)
    return (-rise * signals.torque * signals.motor_velocity * signals.at_motor)[..., None]


def _warmed_motor(signals: Signals, **_: float) -> bool:
    """Return whether a torque is known by its current, and its motor's temperature moved."""
    return bool((np.ptp(signals.temperature, axis=0) * signals.at_motor > 1.0).any())


SATURATION = Effect(
    name='saturation',
    physics='iron that saturates asks for more current than in proportion, the larger the load',
    formula='c·motor_torque⁴, of a torque at the joint',
    terms=(Term('c', 'W/(N·m)⁴'),),
    scaling={'gear_ratio': (-4.0,), 'winding_resistance': (1.0,)},
    regressors=_more_current,
    torque_slope=_more_current_slope,
    recorded=lambda signals, **_: not bool(signals.at_motor.all()),
    # Departures of copper loss stand for it: beside it others were named that are not there.
    proposed=lambda _: False,
    part_of='copper_loss',
    follows=frozenset({'motor_torque'}),
    per_drive=True,
    near=('copper_loss', 'line_resistance'),
    excitation=Excitation(
        'static loads at standstill up to the largest', mode='torque', speeds=(0.0,), loads=_LOADS
    ),
)
MOTOR_SATURATION = Effect(
    name='motor_saturation',
    physics='iron that saturates makes less torque than the current says, the larger the load',
    formula='−s·torque³·w, of a torque that is a current times a constant',
    terms=(Term('s', '1/(N·m)²'),),
    scaling={'gear_ratio': (-2.0,)},
    regressors=_less_torque,
    recorded=lambda signals, **_: bool(signals.at_motor.any()),
    per_drive=True,
    near=('copper_loss', 'regeneration_efficiency'),
    excitation=Excitation(
        'the same speeds under loads up to the largest', speeds=(2.0, -2.0), loads=_LOADS
    ),
)
MAGNET_HEATING = Effect(
    name='magnet_heating',
    physics='warm magnets are weaker: a motor makes less torque than its current says',
    formula='−alpha·dT·torque·w, of a torque that is a current times a constant; dT measured',
    terms=(Term('alpha', '1/K', 0.0, _MOST_PER_KELVIN),),
    scaling={},
    regressors=_weaker,
    recorded=_warmed_motor,
    per_drive=True,
    near=('power_gain', 'winding_heating'),
    excitation=Excitation(
        'the same motion under load, cold and after a hot soak',
        speeds=(2.0, 4.0, -2.0, -4.0),
        loads=(-30.0, 30.0),
        seconds=60.0,
    ),
)
