"""Safety monitor of a motion: speed, torque, position error and winding temperature."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from policy_runner.policies.inputs import Inputs
from policy_runner.supervisor.safety import Fault, FaultKind, SafetyConfig, SafetyMonitor
from wattwalk_core.arrays import Floats

from drive_bench.motion.joint_limits import JointLimits
from drive_bench.run.motion_policy import MotionPolicy

_OVER = 1.25  # measured over permitted value at which it is a fault
_OVER_SATURATED = 1.75  # where a segment saturates the drive, which then runs at its own limit
_POSITION_ERROR = 1.5  # rad; a drive at its torque limit is 1 rad behind its target
_AHEAD = 0.1  # s; without a position loop a joint must be stopped before its limit
_NO_LIMITS = JointLimits(speed=np.inf, torque=np.inf)


def present(inputs: Inputs) -> list[bool]:
    """Return the presence of each joint: drives missing on a bus read zeros only."""
    effort = inputs.effort if len(inputs.effort) else np.zeros(len(inputs.joint_names))
    found: list[bool] = np.any((inputs.position, inputs.velocity, effort), axis=0).tolist()
    return found


class MotionMonitor(SafetyMonitor):
    """
    Safety monitor that also checks speed, torque, temperature and position error of drives.

    interlock: a reason to damp although the drives are sound, such as a recorder that ended.
    """

    def __init__(
        self,
        config: SafetyConfig,
        policy: MotionPolicy,
        joints: Sequence[str],
        limits: Mapping[str, JointLimits],
    ) -> None:
        ranges = ranges_of(joints, limits)
        super().__init__(config, ranges, ranges, joints)
        self._policy = policy
        self.interlock = ''

    def _input_faults(self, inputs: Inputs, now: float) -> Iterator[Fault]:
        yield from super()._input_faults(inputs, now)
        if self.interlock:
            yield Fault(FaultKind.RECORDING, self.interlock)
        for drive in self._policy.needing_temperature:
            unknown = self._policy.windings.fault(drive, now)
            if unknown is not None:
                yield unknown
        if not self._policy.active:
            return
        if self._policy.blocked:
            yield Fault(FaultKind.TARGET_RANGE, self._policy.blocked)
        over = _OVER_SATURATED if self._policy.slack else _OVER
        effort = inputs.effort
        for place, limits in self._policy.moving():
            name = inputs.joint_names[place]
            speed = abs(inputs.velocity[place])
            if speed > over * limits.speed:
                yield _exceeded(name, speed, over * limits.speed, 'rad/s')
            torque = abs(effort[place]) if len(effort) else 0.0
            if not torque <= _OVER * limits.torque:
                yield _exceeded(name, torque, _OVER * limits.torque, 'N·m')
            yield from self._position_faults(place, name, limits, inputs)

    def _position_faults(
        self, place: int, name: str, limits: JointLimits, inputs: Inputs
    ) -> Iterator[Fault]:
        position = float(inputs.position[place])
        if self._policy.mode != 'position':
            soon = position + _AHEAD * float(inputs.velocity[place])
            if not limits.low <= soon <= limits.high:
                yield Fault(
                    FaultKind.JOINT_LIMIT,
                    f'{name} at {position:.2f} rad is about to pass its limits '
                    f'{limits.low:.2f}..{limits.high:.2f} rad in {self._policy.mode} mode',
                )
            return
        most = _POSITION_ERROR + self._policy.slack
        lag = abs(self._policy.targets[place] - position)
        if lag > most:
            yield Fault(
                FaultKind.TARGET_RANGE,
                f'{name} is {lag:.2f} rad from its target, limit {most:g} rad',
            )


def ranges_of(joints: Sequence[str], limits: Mapping[str, JointLimits]) -> Floats:
    """Return lowest and highest angles, rad [D, 2]; infinite where unknown."""
    found = [limits.get(joint, _NO_LIMITS) for joint in joints]
    return np.array([(entry.low, entry.high) for entry in found])


def _exceeded(name: str, value: float, most: float, unit: str) -> Fault:
    return Fault(
        FaultKind.JOINT_LIMIT,
        f'{name} at {value:.2f} {unit}, at most {most:g} {unit} while it is moved',
    )
