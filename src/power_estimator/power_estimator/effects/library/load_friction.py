"""Friction that grows with the load on the gear."""

import numpy as np

from power_estimator.effects.effect import Effect, Excitation, Floats, Term, smooth_sign
from power_estimator.effects.signals.state import Signals


class LoadFriction(Effect):
    """Friction between the gear's teeth in proportion to the load."""

    name = 'load_friction'
    physics = 'gear friction in proportion to the load: the efficiency of the gear'
    formula = 'c·|torque·w| + 2·k·c·torque·|torque|·sgn w'
    per_drive = True
    terms = (Term('c', '1', 0.0, 1.0),)
    acts_on = 'torque'
    needs_joint_torque = True
    follows = frozenset({'motor_torque'})
    shapes = ({'motor': 0.0}, {'motor': 1.0})
    near = ('regeneration_efficiency', 'shaft')
    discrepancy_limit = 0.2
    excitation = Excitation(
        'three loads, driving and back-driving, at two speeds',
        speeds=(1.0, 3.0, -1.0, -3.0),
        loads=(-25.0, 0.0, 25.0),
    )

    def regressors(self, signals: Signals, *, motor: float = 0.0, **_: float) -> Floats:
        """Magnitude of the load, the joint's or the motor's, with the sign of the speed."""
        load = signals.torque + motor * (signals.motor_torque - signals.torque)
        return (np.abs(load) * smooth_sign(signals.motor_velocity, signals.scale.standstill))[
            ..., None
        ]

    def discrepancy(self, signals: Signals, **shape: float) -> Floats:
        """Worse when driving than when driven, or the other way round."""
        return signals.torque
