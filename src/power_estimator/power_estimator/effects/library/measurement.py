"""Errors of the measurement, fitted beside every model as they resemble physical effects."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term, share_of_top
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.effects.signals.state import Signals


class PowerGain(Effect):
    """Gain error of the power meter."""

    name = 'power_gain'
    physics = (
        'voltage or current is scaled wrongly; shows on the shaft, whose coefficient is known'
    )
    formula = 'g·torque·w'
    per_drive = True
    terms = (Term('g', '1', -0.04, 0.04, prior=0.02),)
    kind = 'measurement'
    near = ('shaft', 'load_friction')
    excitation = Excitation('calibrate the meter against a reference')

    def factors(self, scale: DriveScale) -> Floats:
        """Wider where the torque is computed from a current by a constant."""
        return scale.gain[:, None]

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Mechanical power."""
        return (signals.torque * signals.velocity)[..., None]


class CurrentOffset(Effect):
    """Offset of the current sensor."""

    name = 'current_offset'
    physics = 'a zero error of the current sensor times the bus voltage'
    formula = 'I0·V'
    per_drive = True
    terms = (Term('I0', 'A', -0.03, 0.03, prior=0.01),)
    kind = 'measurement'
    near = ('idle',)
    excitation = Excitation('record with the drives switched off: what is left is the offset')

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """The bus voltage."""
        return signals.voltage[..., None]


class TorqueBias(Effect):
    """Offset of the torque sensor."""

    name = 'torque_bias'
    physics = 'a zero error of the torque sensor'
    formula = 'b·(w + 2·k·torque)'
    per_drive = True
    terms = (Term('b', 'N·m', -0.5, 0.5, prior=0.25),)
    kind = 'measurement'
    acts_on = 'torque'
    excitation = Excitation(
        'the same slow motion in both directions without load', speeds=(0.3, -0.3, 1.0, -1.0)
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """One."""
        return np.ones_like(signals.torque)[..., None]


class OffsetDrift(Effect):
    """Drift of the current sensor's offset."""

    name = 'offset_drift'
    physics = 'the zero of the current sensor moves while it warms'
    formula = 'D·V·(time since the middle of the recording in minutes)'
    per_drive = True
    terms = (Term('D', 'A/min', -0.02, 0.02, prior=0.005),)
    kind = 'measurement'
    near = ('winding_heating',)
    excitation = Excitation('rest without load at the start and at the end of the recording')

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Voltage times the time from the recording's middle."""
        minutes = np.zeros_like(signals.time)
        for rows in signals.by_recording():
            times = signals.time[rows]
            minutes[rows] = (times - 0.5 * (times[0] + times[-1])) / 60.0
        return (minutes[:, None] * signals.voltage)[..., None]


class TorqueNonlinearity(Effect):
    """Non-linearity of the torque sensor: a gain that changes with the load."""

    name = 'torque_bend'
    physics = 'a torque sensor that is not quite linear'
    formula = 'n·torque·w·|torque|/(highest torque)'
    per_drive = True
    terms = (Term('n', '1', -0.03, 0.03, prior=0.01),)
    kind = 'measurement'
    near = ('power_gain', 'load_friction')
    excitation = Excitation('calibrate the torque sensor against weights')

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Mechanical power times the share of the highest torque."""
        power = signals.torque * signals.velocity
        return (power * share_of_top(signals.torque))[..., None]


class VelocityLag(Effect):
    """Delay of the velocity by its filter."""

    name = 'velocity_lag'
    physics = 'the velocity passes a filter that the torque does not pass'
    formula = 'delta·torque·dw/dt'
    per_drive = True
    terms = (Term('delta', 's', -0.003, 0.003, prior=0.0015),)
    kind = 'measurement'
    near = ('rotor_inertia', 'time_offset')
    excitation = Excitation('none needed: position and velocity together show it')

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Torque times acceleration."""
        return (signals.torque * signals.acceleration)[..., None]


class TimeOffset(Effect):
    """Time offset of the power against the joint signals."""

    name = 'time_offset'
    physics = 'power and joint signals are stamped by clocks that differ'
    formula = 'delta·dP/dt; the fit shifts the power itself'
    follows = frozenset({'drawn'})
    per_drive = True
    terms = (Term('delta', 's', -0.006, 0.022),)
    kind = 'measurement'
    near = ('rotor_inertia', 'spring', 'velocity_lag')
    excitation = Excitation(
        'steps of torque near standstill',
        mode='torque',
        speeds=(0.0,),
        loads=(-20.0, 20.0),
        frequency=1.0,
        seconds=20.0,
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Minus the rate of the estimated power."""
        return -np.gradient(signals.drawn, 1.0 / signals.rate, axis=0)[..., None]
