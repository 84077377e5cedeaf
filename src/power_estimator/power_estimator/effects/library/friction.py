"""Friction of gear and bearings, and torque ripple."""

from functools import partial

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.effect import (
    Effect,
    Excitation,
    Term,
    in_proportion,
    log_speed,
    smooth_sign,
)
from power_estimator.effects.signals.state import Signals

_STRIBECK_SPEEDS = tuple({'speed': speed} for speed in (0.1, 0.2, 0.35, 0.6, 1.0, 1.6))


def _sign(signals: Signals) -> Floats:
    return smooth_sign(signals.sliding, signals.scale.standstill)


def _fading_sign(signals: Signals, *, speed: float = 0.35, **_: float) -> Floats:
    """The sign of the speed, fading out above the Stribeck speed."""
    return (np.exp(-np.square(signals.sliding / speed)) * _sign(signals))[..., None]


def _load(signals: Signals, *, motor: float = 0.0, **_: float) -> Floats:
    """Magnitude of the load, the joint's or the motor's, with the sign of the speed."""
    load = signals.torque + motor * (signals.motor_torque - signals.torque)
    return (np.abs(load) * _sign(signals))[..., None]


def _ripple(signals: Signals, *, order: float = 12.0, **_: float) -> Floats:
    """Sine and cosine of the position times the order."""
    angle = order * signals.position
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1)


_friction = partial(Effect, acts_on='torque', needs_joint_torque=True, per_drive=True)


def _shows_a_period(signals: Signals, order: float = np.inf, **_: float) -> bool:
    """A part of a period is any other function of the position."""
    at = signals.position
    return bool(np.isfinite(at).all()) and bool(np.ptp(at, axis=0).max() >= 2 * np.pi / order)


VISCOUS_FRICTION = _friction(
    name='viscous_friction',
    physics='grease drags in proportion to speed, and the motor carries that torque as well',
    formula='B·w² + 2·k·torque·B·w',
    terms=(Term('B', 'N·m·s/rad', 0.0, 100.0),),
    scaling={'friction': (1.0,)},
    regressors=lambda signals, **_: signals.motor_velocity[..., None],
    # Another exponent than 1, as of grease that thins with speed.
    discrepancy=lambda signals, **_: signals.motor_velocity * log_speed(signals.motor_velocity),
    discrepancy_limit=0.12,
    near=('iron_loss', 'coulomb_friction'),
    excitation=Excitation(
        'a ladder of constant speeds in both directions, unloaded and loaded',
        speeds=(0.3, 0.8, 1.5, 2.5, 4.0, -0.3, -0.8, -1.5, -2.5, -4.0),
        loads=(0.0, 15.0),
    ),
)
COULOMB_FRICTION = _friction(
    name='coulomb_friction',
    physics='dry friction: the same torque at every speed, against the motion',
    formula='Tc·(|w| + 2·k·torque·sgn w)',
    terms=(Term('Tc', 'N·m', 0.0, 80.0),),
    scaling={'friction': (1.0,)},
    regressors=lambda signals, **_: _sign(signals)[..., None],
    # A slow rise or fall with speed.
    discrepancy=lambda signals, **_: _sign(signals) * log_speed(signals.motor_velocity),
    discrepancy_limit=0.12,
    near=('viscous_friction', 'iron_loss', 'stribeck_friction'),
    excitation=VISCOUS_FRICTION.excitation,
)
STRIBECK_FRICTION = _friction(
    name='stribeck_friction',
    physics='surfaces touch at low speed until the lubricant carries them',
    formula='Ts·exp(−(w/speed)²)·(|w| + 2·k·torque·sgn w)',
    terms=(Term('Ts', 'N·m', 0.0, 80.0),),
    scaling={'friction': (1.0,)},
    regressors=_fading_sign,
    part_of='coulomb_friction',  # what is left of it at speed
    shapes=_STRIBECK_SPEEDS,
    scaled=in_proportion(_STRIBECK_SPEEDS, lambda scale: scale.speed),
    near=('coulomb_friction',),
    excitation=Excitation(
        'a ladder of slow constant speeds in both directions, loaded so that copper shows it',
        speeds=(0.05, 0.1, 0.2, 0.4, 0.8, 2.0, -0.05, -0.1, -0.2, -0.4, -0.8, -2.0),
        loads=(0.0, 20.0),
    ),
)
LOAD_FRICTION = _friction(
    name='load_friction',
    physics='gear friction in proportion to the load: the efficiency of the gear',
    formula='c·|torque·w| + 2·k·c·torque·|torque|·sgn w',
    terms=(Term('c', '1', 0.0, 1.0),),
    scaling={'friction': (1.0,)},
    regressors=_load,
    # Worse when driving than when driven, or the other way round.
    discrepancy=lambda signals, **_: signals.torque,
    discrepancy_limit=0.2,
    follows=frozenset({'motor_torque'}),
    shapes=({'motor': 0.0}, {'motor': 1.0}),
    near=('regeneration_efficiency', 'shaft'),
    excitation=Excitation(
        'three loads, driving and back-driving, at two speeds',
        speeds=(1.0, 3.0, -1.0, -3.0),
        loads=(-25.0, 0.0, 25.0),
    ),
)
COGGING = _friction(
    name='cogging',
    physics='magnets and teeth pull the rotor to and fro, a fixed number of times per turn',
    formula='A·sin(order·q + phase)·w + 2·k·torque·A·sin(order·q + phase)',
    terms=(Term('A·cos(phase)', 'N·m', -20.0, 20.0), Term('A·sin(phase)', 'N·m', -20.0, 20.0)),
    scaling={'gear_ratio': None},
    regressors=_ripple,
    recorded=_shows_a_period,
    needs_time=True,  # over a turn it takes nothing
    shapes=tuple({'order': float(order)} for order in (6, 7, 12, 14, 21, 24, 36, 42, 50, 100)),
    near=('rotor_inertia',),
    excitation=Excitation(
        'slow constant speeds, so that the ripple is slower than the meter',
        speeds=(0.05, 0.1, 0.2, -0.05, -0.1, -0.2),
        loads=(0.0, 20.0),
        seconds=15.0,
    ),
)
