"""Latest measurements and commands with their times, the inputs of a policy."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.arrays import Floats

NEVER = -np.inf


@dataclass
class Inputs:
    """Latest measurements, each with its time of arrival, s on the clock of the node.

    A message whose stamp is not newer than the one before is not fresh. Malformed
    messages leave a complaint until a sound one of the same topic arrives.
    """

    joint_names: tuple[str, ...] = JOINT_NAMES
    joint_time: float = NEVER
    position: Floats = field(default_factory=lambda: np.zeros(12))  # rad
    velocity: Floats = field(default_factory=lambda: np.zeros(12))  # rad/s
    effort: Floats = field(default_factory=lambda: np.zeros(0))  # N·m, empty if not measured
    imu_time: float = NEVER
    gravity: Floats = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))  # unit vector
    spin: Floats = field(default_factory=lambda: np.zeros(3))  # rad/s
    acceleration: Floats | None = None  # m/s², as an IMU feels it, None where it is not reported
    odom_time: float = NEVER
    base_velocity: Floats = field(default_factory=lambda: np.zeros(3))  # m/s
    command_time: float = NEVER
    command: Floats = field(default_factory=lambda: np.zeros(3))  # m/s, m/s, rad/s
    complaints: dict[str, str] = field(default_factory=dict)
    needed: tuple[str, ...] = ('joint_states', 'imu')  # topics that must keep coming
    _stamps: dict[str, int] = field(default_factory=dict)
    _order: tuple[tuple[str, ...], NDArray[np.intp]] | None = None

    def on_joints(
        self,
        stamp: int,
        names: Sequence[str],
        position: Any,
        velocity: Any,
        now: float,
        effort: Any = (),
    ) -> None:
        """Take joint_states: stamp in ns, rad, rad/s and N·m in the order of names."""
        key = tuple(names)
        if self._order is None or self._order[0] != key:
            missing = [name for name in self.joint_names if name not in key]
            if missing:
                self.complaints['joint_states'] = f'joint_states lacks {missing[0]}'
                return
            columns = np.array([key.index(name) for name in self.joint_names])
            self._order = (key, columns)
        columns = self._order[1]
        if len(position) != len(key) or len(velocity) != len(key):
            self.complaints['joint_states'] = (
                f'joint_states has {len(key)} names, {len(position)} positions '
                f'and {len(velocity)} velocities'
            )
            return
        self.complaints.pop('joint_states', None)
        self.position = np.asarray(position, dtype=np.float64)[columns]
        self.velocity = np.asarray(velocity, dtype=np.float64)[columns]
        known = len(effort) == len(key)
        self.effort = np.asarray(effort, dtype=np.float64)[columns] if known else np.zeros(0)
        if self._is_newer('joint_states', stamp):
            self.joint_time = now

    def on_imu(
        self,
        stamp: int,
        orientation: Sequence[float],
        spin: Sequence[float],
        now: float,
        acceleration: Sequence[float] | None = None,
    ) -> None:
        """Take imu: quaternion x, y, z, w of the base and its angular velocity, rad/s.

        acceleration: m/s², with gravity. A robot that feels none at all does not report it.
        """
        x, y, z, w = orientation
        norm = x * x + y * y + z * z + w * w
        if not 0.9 < norm < 1.1:
            self.complaints['imu'] = (
                f'imu orientation ({x:.3g}, {y:.3g}, {z:.3g}, {w:.3g}) is no unit quaternion'
            )
            return
        self.complaints.pop('imu', None)
        self.gravity = np.array(
            [2 * (w * y - x * z), -2 * (y * z + w * x), 2 * (x * x + y * y) - norm]
        )
        self.gravity /= np.linalg.norm(self.gravity)
        self.spin = np.array(spin, dtype=np.float64)
        felt = np.zeros(3) if acceleration is None else np.array(acceleration, dtype=np.float64)
        known = bool(np.isfinite(felt).all()) and bool(felt.any())
        self.acceleration = felt if known else None
        if self._is_newer('imu', stamp):
            self.imu_time = now

    def on_odom(self, stamp: int, velocity: Sequence[float], now: float) -> None:
        """Take odom: linear velocity in the base's frame, m/s."""
        self.base_velocity = np.array(velocity, dtype=np.float64)
        if self._is_newer('odom', stamp):
            self.odom_time = now

    def on_command(self, command: Sequence[float], now: float) -> None:
        """Take cmd_vel: vx, vy in m/s and yaw rate in rad/s."""
        self.command = np.array(command, dtype=np.float64)
        self.command_time = now

    def _is_newer(self, topic: str, stamp: int) -> bool:
        newer = stamp > self._stamps.get(topic, -1)
        self._stamps[topic] = stamp
        return newer
