"""Losses of the stator's field and of the power stage."""

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.effect import (
    Effect,
    Excitation,
    Term,
    factors_by_unit,
    in_proportion,
    log_speed,
    share_of_top,
    smooth_sign,
)
from power_estimator.effects.signals.scale import VOLTAGE, DriveScale
from power_estimator.effects.signals.state import Signals

_LARGEST = 50.0  # times the bound that tells iron loss from friction
_IRON = (Term('h', 'W·s/rad', 0.0, 1.0), Term('e', 'W·s²/rad²', 0.0, 0.4))
_BASE_SPEEDS = tuple(
    {'per_volt': speed / VOLTAGE} for speed in (3.0, 4.0, 5.0, 5.5, 6.0, 6.5, 7.0)
)


def _iron(signals: Signals, *, carried: float = 0.0, **_: float) -> Floats:
    """Speed and speed squared, with the copper loss of their torque.

    In some machines the current that feeds these losses also heats the winding (carried = 1, as
    when they brake the rotor). They then differ from friction in size only, hence the bounds.
    """
    speed = np.abs(signals.sliding)
    cost = carried * signals.torque_cost * ~signals.at_motor
    return np.stack(
        [
            speed + cost * smooth_sign(signals.sliding, signals.scale.standstill),
            np.square(speed) + cost * signals.sliding,
        ],
        axis=-1,
    )


def _exponent(signals: Signals, **_: float) -> Floats:
    """Exponents between 1 and 2."""
    return np.abs(signals.motor_velocity) * log_speed(signals.motor_velocity)


def _iron_factors(scale: DriveScale) -> Floats:
    """Up to a friction's size where the bound of the reference drive tells nothing.

    That is where the torque is the motor's, so that friction is no rival, and where the drive
    is of another size: bare and fast motors lose much more in their iron.
    """
    other = (scale.gain > 1.0) | (scale.torque != 1.0) | (scale.speed != 1.0)
    return factors_by_unit(_IRON, scale) * np.where(other, _LARGEST, 1.0)[:, None]


def _switching(signals: Signals, **_: float) -> Floats:
    """Magnitude of the motor torque, and the same times the voltage."""
    size = np.abs(signals.motor_torque)
    return np.stack([size, size * signals.voltage / VOLTAGE], axis=-1)


def _switching_slope(signals: Signals, coefficients: Floats) -> Floats:
    """The summed coefficients with the torque's sign."""
    both = coefficients[..., 0] + coefficients[..., 1] * signals.voltage / VOLTAGE
    return both * np.tanh(signals.motor_torque / (0.5 * signals.scale.torque))


def _voltage_drop(signals: Signals, **_: float) -> Floats:
    """Voltage drop that rises with the load."""
    return np.abs(signals.motor_torque) * share_of_top(signals.motor_torque)


def _overspeed(signals: Signals, *, per_volt: float = 0.125, **_: float) -> Floats:
    """Squared excess over the base speed."""
    excess = np.abs(signals.motor_velocity) - per_volt * signals.voltage
    return np.square(np.maximum(0.0, excess))[..., None]


IRON_LOSS = Effect(
    name='iron_loss',
    physics='the rotating field magnetises the stator back and forth (h) and drives eddies (e)',
    formula='h·|w| + e·w²; with carried = 1 also 2·k·torque·(h·sgn w + e·w)',
    terms=_IRON,
    scaling={'gear_ratio': (1.0, 2.0)},
    regressors=_iron,
    discrepancy=_exponent,
    discrepancy_limit=0.3,
    # The torque of the motor has in it what the current of iron loss adds.
    recorded=lambda signals, carried=0.0, **_: carried == 0.0 or not bool(signals.at_motor.all()),
    sizes=_iron_factors,
    follows=frozenset({'motor_torque'}),
    per_drive=True,
    shapes=({'carried': 0.0}, {'carried': 1.0}),
    near=('viscous_friction', 'coulomb_friction'),
    excitation=Excitation(
        'a ladder of constant speeds, unloaded and loaded: friction grows dearer under load, '
        'iron loss need not',
        speeds=(0.3, 0.8, 1.5, 2.5, 4.0, 6.0, -0.3, -0.8, -1.5, -2.5, -4.0, -6.0),
        loads=(-25.0, 0.0, 25.0),
    ),
)
INVERTER_LOSS = Effect(
    name='inverter_loss',
    physics='the switches cost in proportion to the current, and to the bus voltage they switch',
    formula='a·|motor_torque| + s·|motor_torque|·V/48',
    terms=(Term('a', 'W/(N·m)', 0.0, 5.0), Term('s', 'W/(N·m)', 0.0, 5.0)),
    scaling={'gear_ratio': (-1.0, -1.0)},
    regressors=_switching,
    torque_slope=_switching_slope,
    discrepancy=_voltage_drop,
    discrepancy_limit=0.2,
    follows=frozenset({'motor_torque'}),
    per_drive=True,
    near=('copper_loss',),
    excitation=Excitation(
        'static loads at standstill from small to large',
        mode='torque',
        speeds=(0.0,),
        loads=(-40.0, -20.0, -10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0, 20.0, 40.0),
    ),
)
FIELD_WEAKENING = Effect(
    name='field_weakening',
    physics='above base speed the controller spends current to hold the back-EMF down',
    formula='c·max(0, |w| − per_volt·V)²',
    terms=(Term('c', 'W·s²/rad²', 0.0, 1000.0),),
    scaling={'gear_ratio': None},
    regressors=_overspeed,
    per_drive=True,
    shapes=_BASE_SPEEDS,
    scaled=in_proportion(_BASE_SPEEDS, lambda scale: scale.speed / scale.voltage),
    near=('iron_loss', 'viscous_friction'),
    excitation=Excitation(
        'constant speeds up to the highest, at two bus voltages',
        speeds=(4.0, 5.0, 6.0, 6.5, 7.0, 7.5, -4.0, -5.0, -6.0, -6.5, -7.0, -7.5),
        supply=(44.0, 50.0),
    ),
)
