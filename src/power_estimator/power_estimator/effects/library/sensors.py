"""Errors of the measurement, fitted beside every model as they resemble physical effects."""

from functools import partial

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.effect import Effect, Excitation, Term, share_of_top
from power_estimator.effects.signals.state import Signals


def _drift(signals: Signals, **_: float) -> Floats:
    """Voltage times the time from the recording's middle in minutes."""
    minutes = np.zeros_like(signals.time)
    for rows in signals.by_recording():
        times = signals.time[rows]
        minutes[rows] = (times - 0.5 * (times[0] + times[-1])) / 60.0
    return (minutes[:, None] * signals.voltage)[..., None]


def _bend(signals: Signals, **_: float) -> Floats:
    """Mechanical power times the share of the highest torque."""
    power = signals.torque * signals.velocity
    return (power * share_of_top(signals.torque))[..., None]


_measurement_error = partial(Effect, kind='measurement', per_drive=True)
POWER_GAIN = _measurement_error(
    name='power_gain',
    physics='voltage or current is scaled wrongly; shows on the shaft, whose coefficient is known',
    formula='g·torque·w',
    terms=(Term('g', '1', -0.04, 0.04, prior=0.02),),
    regressors=lambda signals, **_: (signals.torque * signals.velocity)[..., None],
    # Wider where the torque is computed from a current by a constant.
    sizes=lambda scale: scale.gain[:, None],
    near=('shaft', 'load_friction'),
    excitation=Excitation('calibrate the meter against a reference'),
)
CURRENT_OFFSET = _measurement_error(
    name='current_offset',
    physics='a zero error of the current sensor times the bus voltage',
    formula='I0·V',
    terms=(Term('I0', 'A', -0.03, 0.03, prior=0.01),),
    regressors=lambda signals, **_: signals.voltage[..., None],
    near=('idle',),
    excitation=Excitation('record with the drives switched off: what is left is the offset'),
)
TORQUE_BIAS = _measurement_error(
    name='torque_bias',
    physics='a zero error of the torque sensor',
    formula='b·(w + 2·k·torque)',
    terms=(Term('b', 'N·m', -0.5, 0.5, prior=0.25),),
    regressors=lambda signals, **_: np.broadcast_to(1.0, (*signals.torque.shape, 1)),
    acts_on='torque',
    excitation=Excitation(
        'the same slow motion in both directions without load', speeds=(0.3, -0.3, 1.0, -1.0)
    ),
)
OFFSET_DRIFT = _measurement_error(
    name='offset_drift',
    physics='the zero of the current sensor moves while it warms',
    formula='D·V·(time since the middle of the recording in minutes)',
    terms=(Term('D', 'A/min', -0.02, 0.02, prior=0.005),),
    regressors=_drift,
    needs_time=True,
    near=('winding_heating',),
    excitation=Excitation('rest without load at the start and at the end of the recording'),
)
TORQUE_BEND = _measurement_error(
    name='torque_bend',
    physics='a torque sensor that is not quite linear',
    formula='n·torque·w·|torque|/(highest torque)',
    terms=(Term('n', '1', -0.03, 0.03, prior=0.01),),
    regressors=_bend,
    near=('power_gain', 'load_friction'),
    excitation=Excitation('calibrate the torque sensor against weights'),
)
VELOCITY_LAG = _measurement_error(
    name='velocity_lag',
    physics='the velocity passes a filter that the torque does not pass',
    formula='delta·torque·dw/dt',
    terms=(Term('delta', 's', -0.003, 0.003, prior=0.0015),),
    regressors=lambda signals, **_: (signals.torque * signals.acceleration)[..., None],
    needs_time=True,
    near=('rotor_inertia', 'time_offset'),
    excitation=Excitation('none needed: position and velocity together show it'),
)
TIME_OFFSET = _measurement_error(
    name='time_offset',
    physics='power and joint signals are stamped by clocks that differ',
    formula='delta·dP/dt; the fit shifts the power itself',
    terms=(Term('delta', 's', -0.006, 0.022),),
    regressors=lambda signals, **_: (
        -np.gradient(signals.drawn, 1 / signals.rate, axis=0)[..., None]
    ),
    follows=frozenset({'drawn'}),
    needs_time=True,
    near=('rotor_inertia', 'spring', 'velocity_lag'),
    excitation=Excitation(
        'steps of torque near standstill',
        mode='torque',
        speeds=(0.0,),
        loads=(-20.0, 20.0),
        frequency=1.0,
        seconds=20.0,
    ),
)
