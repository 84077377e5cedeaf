"""Losses of the alternating field in the stator."""

import numpy as np

from power_estimator.effects.effect import (
    Effect,
    Excitation,
    Floats,
    Term,
    log_speed,
    smooth_sign,
)
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.effects.signals.state import Signals

_LARGEST = 50.0  # times the bound that tells iron loss from friction


class IronLoss(Effect):
    """
    Hysteresis and eddy currents.

    In some machines the current that feeds them also heats the winding (carried = 1, as when they
    brake the rotor). They then differ from friction in size only, hence the bounds.
    """

    name = 'iron_loss'
    physics = 'the rotating field magnetises the stator back and forth (h) and drives eddies (e)'
    formula = 'h·|w| + e·w²; with carried = 1 also 2·k·torque·(h·sgn w + e·w)'
    follows = frozenset({'motor_torque'})
    per_drive = True
    terms = (Term('h', 'W·s/rad', 0.0, 1.0), Term('e', 'W·s²/rad²', 0.0, 0.4))
    near = ('viscous_friction', 'coulomb_friction')
    shapes = ({'carried': 0.0}, {'carried': 1.0})
    discrepancy_limit = 0.3
    excitation = Excitation(
        'a ladder of constant speeds, unloaded and loaded: friction grows dearer under load, '
        'iron loss need not',
        speeds=(0.3, 0.8, 1.5, 2.5, 4.0, 6.0, -0.3, -0.8, -1.5, -2.5, -4.0, -6.0),
        loads=(-25.0, 0.0, 25.0),
    )

    def regressors(self, signals: Signals, *, carried: float = 0.0, **_: float) -> Floats:
        """Speed and speed squared, with the copper loss of their torque."""
        speed = np.abs(signals.motor_velocity)
        cost = carried * signals.torque_cost * ~signals.at_motor
        return np.stack(
            [
                speed + cost * smooth_sign(signals.motor_velocity, signals.scale.standstill),
                np.square(speed) + cost * signals.motor_velocity,
            ],
            axis=-1,
        )

    def discrepancy(self, signals: Signals, **shape: float) -> Floats:
        """Exponents between 1 and 2."""
        return np.abs(signals.motor_velocity) * log_speed(signals.motor_velocity)

    def usable(self, signals: Signals, *, carried: float = 0.0, **_: float) -> bool:
        """The torque of the motor has in it what the current of iron loss adds."""
        return carried == 0.0 or not bool(signals.at_motor.all())

    def factors(self, scale: DriveScale) -> Floats:
        """
        Up to a friction's size where the bound of the reference drive tells nothing.

        That is where the torque is the motor's, so that friction is no rival, and where the drive
        is of another size: bare and fast motors lose much more in their iron.
        """
        other = (scale.gain > 1.0) | (scale.torque != 1.0) | (scale.speed != 1.0)
        wide = np.where(other, _LARGEST, 1.0)
        return super().factors(scale) * wide[:, None]
