"""What is watched while drives are put through a motion, beside what a policy is watched for."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.inputs import Inputs
from policy_runner.supervisor.safety import Fault, FaultKind, SafetyConfig, SafetyMonitor

from drive_bench.motion.joint_limits import JointLimits
from drive_bench.run.motion_player import Exciting

Floats = NDArray[np.float64]
_OVER = 1.25  # of what may be asked: then what is measured is a fault
_OVER_AT_ITS_BEST = 1.75  # where the drive is told more than it can: it runs as fast as it can
_FOLLOWING = 1.5  # rad; a drive at its torque limit is 1 rad behind its target
_AHEAD = 0.1  # s; without a position loop a joint must be stopped before its limit
_NO_LIMITS = JointLimits(speed=np.inf, torque=np.inf)


@dataclass
class JointInputs(Inputs):
    """Measurements of the joints of any robot; only joint_states has to keep coming."""

    needed: tuple[str, ...] = ('joint_states',)
    effort: Floats = field(default_factory=lambda: np.zeros(0))  # N·m, zeros where not measured

    def on_joint_states(
        self,
        stamp: int,
        names: Sequence[str],
        position: Any,
        velocity: Any,
        effort: Any,
        now: float,
    ) -> None:
        """Take joint_states: stamp in ns, rad, rad/s and N·m in the order of names."""
        self.on_joints(stamp, names, position, velocity, now)
        if 'joint_states' not in self.complaints and len(effort) == len(names):
            places = [list(names).index(name) for name in self.joint_names]
            self.effort = np.asarray(effort, dtype=np.float64)[places]

    @property
    def there(self) -> list[bool]:
        """Whether each joint reads anything but zeros, as drives do that are missing on a bus."""
        effort = self.effort if len(self.effort) else np.zeros(len(self.joint_names))
        read = np.stack((self.position, self.velocity, effort))
        found: list[bool] = np.any(read, axis=0).tolist()
        return found


class ExcitationMonitor(SafetyMonitor):
    """
    The safety monitor, which also knows speed, torque, warmth and how far a drive lags.

    interlock: why it must not go on although the drives are well, such as a recorder that ended.
    """

    def __init__(
        self,
        config: SafetyConfig,
        exciting: Exciting,
        joints: Sequence[str],
        limits: Mapping[str, JointLimits],
    ) -> None:
        ranges = ranges_of(joints, limits)
        super().__init__(config, ranges, ranges, joints)
        self._exciting = exciting
        self.interlock = ''

    def _input_faults(self, inputs: Inputs, now: float) -> Iterator[Fault]:
        yield from super()._input_faults(inputs, now)
        if self.interlock:
            yield Fault(FaultKind.RECORDING, self.interlock)
        for drive in self._exciting.heeded:
            unknown = self._exciting.windings.fault(drive, now)
            if unknown is not None:
                yield unknown
        if not self._exciting.active:
            return
        if self._exciting.blocked:
            yield Fault(FaultKind.TARGET_RANGE, self._exciting.blocked)
        over = _OVER_AT_ITS_BEST if self._exciting.slack else _OVER
        effort = getattr(inputs, 'effort', np.zeros(0))
        for place, limits in self._exciting.watched():
            name = inputs.joint_names[place]
            speed = abs(inputs.velocity[place])
            if speed > over * limits.speed:
                yield Fault(
                    FaultKind.JOINT_LIMIT, _told(name, speed, over * limits.speed, 'rad/s')
                )
            torque = abs(effort[place]) if len(effort) else 0.0
            if not torque <= _OVER * limits.torque:
                yield Fault(
                    FaultKind.JOINT_LIMIT, _told(name, torque, _OVER * limits.torque, 'N·m')
                )
            yield from self._position_faults(place, name, limits, inputs)

    def _position_faults(
        self, place: int, name: str, limits: JointLimits, inputs: Inputs
    ) -> Iterator[Fault]:
        position = float(inputs.position[place])
        if self._exciting.mode != 'position':
            soon = position + _AHEAD * float(inputs.velocity[place])
            if not limits.low <= soon <= limits.high:
                yield Fault(
                    FaultKind.JOINT_LIMIT,
                    f'{name} at {position:.2f} rad is about to pass its limits '
                    f'{limits.low:.2f}..{limits.high:.2f} rad in {self._exciting.mode} mode',
                )
            return
        most = _FOLLOWING + self._exciting.slack
        lag = abs(self._exciting.targets[place] - position)
        if lag > most:
            yield Fault(
                FaultKind.TARGET_RANGE,
                f'{name} is {lag:.2f} rad from its target, limit {most:g} rad',
            )


def ranges_of(joints: Sequence[str], limits: Mapping[str, JointLimits]) -> Floats:
    """Lowest and highest angle of joints, rad [D, 2]; infinite where none are known."""
    found = [limits.get(joint, _NO_LIMITS) for joint in joints]
    return np.array([(entry.low, entry.high) for entry in found])


def _told(name: str, value: float, most: float, unit: str) -> Fault:
    return Fault(
        FaultKind.JOINT_LIMIT,
        f'{name} at {value:.2f} {unit}, at most {most:g} {unit} while it is moved',
    )
