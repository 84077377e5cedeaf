"""Signals that effects are computed from."""

import itertools
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from power_estimator.effects.signals.scale import DriveScale

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Signals:
    """
    Signals of D drives at the rate at which products are formed, [T, D] unless said otherwise.

    motor_*, torque_cost and drawn are the model's own estimates so far: the
    motor's motion behind a spring, its torque including friction and rotor inertia, the slope of
    the losses by that torque, and the power drawn at the drive's input. They let an effect depend
    on what the other effects add.
    """

    rate: float  # Hz
    names: tuple[str, ...]  # D drives
    time: Floats  # s [T]
    segment: NDArray[np.int32]  # [T], stretches without gaps
    recording: NDArray[np.int32]  # [T]
    position: Floats  # rad
    velocity: Floats  # rad/s, lag of the sensor's filter removed
    acceleration: Floats  # rad/s²
    torque: Floats  # N·m at the joint
    torque_rate: Floats  # N·m/s
    voltage: Floats  # V
    temperature: Floats  # °C winding, NaN where not measured
    motor_velocity: Floats  # rad/s, of the motor in turns of the joint
    motor_acceleration: Floats  # rad/s²
    motor_torque: Floats  # N·m
    torque_cost: Floats  # W/(N·m), what more motor torque costs in losses
    electronics: Floats  # W, of the idle draw
    drawn: Floats  # W
    scale: DriveScale  # of the drives
    at_motor: NDArray[np.bool_]  # [D], torque is the motor's: friction and inertia are in it

    def drive(self, index: int) -> 'Signals':
        """The signals of one drive, D = 1."""
        columns = {
            f.name: getattr(self, f.name)[:, index : index + 1]
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray) and getattr(self, f.name).ndim == 2
        }
        return replace(
            self,
            names=(self.names[index],),
            scale=self.scale.take([index]),
            at_motor=self.at_motor[[index]],
            **columns,
        )

    def stretches(self) -> list[slice]:
        """The gap-free stretches, in order."""
        borders = np.flatnonzero(np.diff(self.segment)) + 1
        edges = [0, *borders.tolist(), len(self.time)]
        return [slice(start, stop) for start, stop in itertools.pairwise(edges) if stop > start]
