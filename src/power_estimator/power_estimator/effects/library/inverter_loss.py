"""Losses of the power stage."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term, share_of_top
from power_estimator.effects.signals.state import Signals

NOMINAL = 48.0
"""V, the bus at which both terms are alike."""


class InverterLoss(Effect):
    """Conduction loss and switching loss of the transistors."""

    name = 'inverter_loss'
    physics = 'the switches cost in proportion to the current, and to the bus voltage they switch'
    formula = 'a·|motor_torque| + s·|motor_torque|·V/48'
    follows = frozenset({'motor_torque'})
    per_drive = True
    terms = (Term('a', 'W/(N·m)', 0.0, 5.0), Term('s', 'W/(N·m)', 0.0, 5.0))
    near = ('copper_loss',)
    discrepancy_limit = 0.2
    excitation = Excitation(
        'static loads at standstill from small to large',
        mode='torque',
        speeds=(0.0,),
        loads=(-40.0, -20.0, -10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0, 20.0, 40.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Magnitude of the motor torque, and the same times the voltage."""
        size = np.abs(signals.motor_torque)
        return np.stack([size, size * signals.voltage / NOMINAL], axis=-1)

    def torque_slope(self, signals: Signals, coefficients: Floats) -> Floats:
        """The summed coefficients with the torque's sign."""
        both = coefficients[..., 0] + coefficients[..., 1] * signals.voltage / NOMINAL
        return both * np.tanh(signals.motor_torque / (0.5 * signals.scale.torque))

    def discrepancy(self, signals: Signals, **shape: float) -> Floats:
        """Voltage drop that rises with the load."""
        return np.abs(signals.motor_torque) * share_of_top(signals.motor_torque)
