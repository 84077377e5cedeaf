"""Power of a drive in steady motion, over torque and speed."""

from dataclasses import dataclass, replace

import numpy as np
from power_estimator.effects import Signals
from power_estimator.effects.fit.design import Structure, evaluate
from wattwalk_core.arrays import Floats


@dataclass(frozen=True)
class Steady:
    """A model of one drive at the voltage and temperature of a recording's middle."""

    drive: int
    structure: Structure
    coefficients: Floats  # [1, m]
    signals: Signals  # of that drive, D = 1

    def power(self, speed: Floats, torque: Floats) -> Floats:
        """W at speeds in rad/s and torques in N·m [G]; what remembers its past is left out."""
        count, nothing = len(speed), np.zeros((len(speed), 1))
        own = self.signals
        steady = replace(
            own,
            time=np.arange(count) / own.rate,
            segment=np.zeros(count, np.int32),
            recording=np.zeros(count, np.int32),
            position=nothing,
            velocity=speed[:, None],
            motor_velocity=speed[:, None],
            acceleration=nothing,
            motor_acceleration=nothing,
            torque=torque[:, None],
            motor_torque=torque[:, None],
            torque_rate=nothing,
            torque_cost=nothing,
            electronics=nothing,
            drawn=(torque * speed)[:, None],
            voltage=np.full((count, 1), np.median(own.voltage)),
            temperature=np.full((count, 1), np.median(own.temperature)),
            past=None,
        )
        kept = [
            0.0 if active.effect.remembers else 1.0
            for active in self.structure.free
            for _ in active.effect.terms
        ]
        return evaluate(self.structure, self.coefficients * kept, steady)[:, 0]
