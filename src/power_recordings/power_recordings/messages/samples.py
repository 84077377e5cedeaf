"""Samples of each kind of topic, as arrays."""

from dataclasses import dataclass, fields, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Singles, Stamps


@dataclass(frozen=True)
class Samples:
    """N samples with the ROS time of their measurement in ns, ascending."""

    stamp_ns: Stamps  # [N]

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def rows(self, index: Any) -> Self:
        """Return the samples at `index`: a slice, a mask [N] or integers."""
        arrays = {
            f.name: getattr(self, f.name)[index]
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        return replace(self, **arrays)


@dataclass(frozen=True)
class JointSamples(Samples):
    """Joint states or commands of D joints; NaN where a message leaves a field out."""

    names: tuple[str, ...]
    position: Singles  # rad [N, D]
    velocity: Singles  # rad/s [N, D]
    effort: Singles  # N·m [N, D]


@dataclass(frozen=True)
class DriveSamples(Samples):
    """Electrical samples of D drives."""

    names: tuple[str, ...]
    sequence: NDArray[np.uint64]  # [N], a jump by more than one is a loss
    device_time: NDArray[np.uint64]  # ns of the device's clock [N]
    voltage: Singles  # V [N, D]
    current: Singles  # A [N, D], positive = drawn by the drive
    temperature: Singles  # °C [N, D], winding; NaN if unknown
    status: NDArray[np.uint8]  # [N, D], 0 = good

    @property
    def power(self) -> Singles:
        """Power drawn by each drive, W [N, D]."""
        return self.voltage * self.current

    @property
    def good(self) -> Bools:
        """True where voltage and current are numbers without a flag, [N, D]."""
        return (self.status == 0) & np.isfinite(self.voltage) & np.isfinite(self.current)

    @property
    def after_gap(self) -> Bools:
        """True where the sequence number does not follow on that of the sample before, [N]."""
        return np.diff(self.sequence, prepend=self.sequence[:1] - np.uint64(1)) != 1

    @property
    def lost(self) -> int:
        """Number of samples missing by their sequence numbers."""
        return int((np.diff(self.sequence.astype(np.int64)) - 1).clip(min=0).sum())


UNKNOWN_VOLTAGE: Final = 1.0
"""V of a supply that was imported with its power alone: its current is then that power."""


@dataclass(frozen=True)
class SupplySamples(Samples):
    """N samples of the whole robot's supply."""

    voltage: Singles  # V [N]
    current: Singles  # A [N], negative while drawing (sensor_msgs/BatteryState)

    @property
    def power(self) -> Singles:
        """Power drawn by the robot, W [N]."""
        return -self.voltage * self.current


@dataclass(frozen=True)
class MotorCurrentSamples(Samples):
    """Torque-producing (quadrature-axis) currents of D motors."""

    names: tuple[str, ...]
    current: Singles  # A [N, D]


@dataclass(frozen=True)
class MotorTemperatureSamples(Samples):
    """Winding temperatures of D motors without a meter of their own."""

    names: tuple[str, ...]
    temperature: Singles  # °C [N, D]


@dataclass(frozen=True)
class FootForceSamples(Samples):
    """Normal forces of F feet."""

    names: tuple[str, ...]
    force: Singles  # N [N, F]


@dataclass(frozen=True)
class ImuSamples(Samples):
    """Inertial measurements, in the frame of the sensor."""

    orientation: Singles  # x y z w [N, 4]
    angular_velocity: Singles  # rad/s [N, 3]
    linear_acceleration: Singles  # m/s² [N, 3]


@dataclass(frozen=True)
class OdomSamples(Samples):
    """Odometry: pose in the world, velocities in the base."""

    position: Singles  # m [N, 3]
    orientation: Singles  # x y z w [N, 4]
    linear_velocity: Singles  # m/s [N, 3]
    angular_velocity: Singles  # rad/s [N, 3]


@dataclass(frozen=True)
class CmdVelSamples(Samples):
    """Velocity commands to the robot's base."""

    velocity: Singles  # [N, 3]: vx, vy m/s, yaw rate rad/s


@dataclass(frozen=True)
class EstimateSamples(Samples):
    """Power estimates that the live node published, of D drives and of the robot."""

    names: tuple[str, ...]
    model: tuple[str, ...]  # the models that made them
    power: Singles  # W [N, D]
    total: Singles  # W [N]
    status: NDArray[np.uint8]  # [N], 0 = good
