"""Heat in the winding."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term, share_of_top
from power_estimator.effects.signals.state import Signals


class CopperLoss(Effect):
    """Resistive loss of winding, cables and switches: all grow with the current squared."""

    name = 'copper_loss'
    physics = 'the current that makes the torque heats the winding and whatever is in line with it'
    formula = 'k·motor_torque², motor_torque = torque + friction + J·acceleration'
    follows = frozenset({'motor_torque'})
    per_drive = True
    terms = (Term('k', 'W/(N·m)²', 0.0, 1.0),)
    ties = ('inverter_resistance',)
    near = ('line_resistance', 'winding_heating')
    discrepancy_limit = 0.12
    excitation = Excitation(
        'static loads at standstill',
        mode='torque',
        speeds=(0.0,),
        loads=(-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0),
    )

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Motor torque squared."""
        return np.square(signals.motor_torque)[..., None]

    def torque_slope(self, signals: Signals, coefficients: Floats) -> Floats:
        """2·k·motor_torque."""
        return 2.0 * coefficients[..., 0] * signals.motor_torque

    def discrepancy(self, signals: Signals, **shape: float) -> Floats:
        """A torque constant that saturates under load."""
        return np.square(signals.motor_torque) * np.square(share_of_top(signals.motor_torque))
