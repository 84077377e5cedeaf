"""Motion under the supervisor that also runs policies: start, monitoring, damping."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from policy_runner.policies.inputs import Inputs
from policy_runner.supervisor.safety import (
    Fault,
    FaultKind,
    SafetyConfig,
    SafetyMonitor,
    TargetLimiter,
)
from policy_runner.supervisor.supervisor import State, Supervisor, SupervisorOutput
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from drive_bench.motion.file import MotionFile
from drive_bench.motion.fitting import fitted
from drive_bench.motion.joint_limits import JointLimits
from drive_bench.motion.segment_path import Mounting
from drive_bench.run.motion_policy import MotionPolicy

_OVER = 1.25  # measured over permitted value at which it is a fault
_OVER_SATURATED = 1.75  # where a segment saturates the drive, which then runs at its own limit
_POSITION_ERROR = 1.5  # rad; a drive at its torque limit is 1 rad behind its target
_AHEAD = 0.1  # s; without a position loop a joint must be stopped before its limit
_NO_LIMITS = JointLimits(speed=np.inf, torque=np.inf)


def present(inputs: Inputs) -> list[bool]:
    """Return for each joint whether its drive is present; missing ones report zeros only."""
    effort = inputs.effort if len(inputs.effort) else np.zeros(len(inputs.joint_names))
    found: list[bool] = np.any((inputs.position, inputs.velocity, effort), axis=0).tolist()
    return found


class MotionMonitor(SafetyMonitor):
    """Safety monitor that also checks speed, torque, temperature and position error of drives.

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
        policy = self._policy
        for drive in policy.needing_temperature:
            unknown = policy.windings.fault(drive, now)
            if unknown is not None:
                yield unknown
        if not policy.active:
            return
        if policy.blocked:
            yield Fault(FaultKind.TARGET_RANGE, policy.blocked)
        over = _OVER_SATURATED if policy.slack else _OVER
        for place, limits in policy.moving():
            name = inputs.joint_names[place]
            torque = inputs.effort[place] if len(inputs.effort) else 0.0
            for value, most, unit in (
                (abs(inputs.velocity[place]), over * limits.speed, 'rad/s'),
                (abs(torque), _OVER * limits.torque, 'N·m'),
            ):
                if not value <= most:
                    told = f'at {value:.2f} {unit}, at most {most:g} {unit} while it is moved'
                    yield Fault(FaultKind.JOINT_LIMIT, f'{name} {told}')
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
            told = f'{name} is {lag:.2f} rad from its target, limit {most:g} rad'
            yield Fault(FaultKind.TARGET_RANGE, told)


def ranges_of(joints: Sequence[str], limits: Mapping[str, JointLimits]) -> Floats:
    """Return lowest and highest angles, rad [D, 2]; infinite where unknown."""
    found = [limits.get(joint, _NO_LIMITS) for joint in joints]
    return np.array([(entry.low, entry.high) for entry in found])


@dataclass(frozen=True)
class Command:
    """Command of the named joints: position, rad, velocity, rad/s, and effort, N·m.

    Zero velocity alone damps; joints that are not named damp, too.
    """

    names: tuple[str, ...]
    position: Floats | None
    velocity: Floats | None
    effort: Floats | None = None


class MotionRun:
    """Motion of `drives` among the joints of a robot, under the supervisor for policies.

    limits: by joint, at least for the drives. damp_others: damp the other joints instead of
    holding them, which allows velocity and torque mode. fit: adapt a motion that leaves the limits
    (changes are in `notes`) instead of refusing it. InputError for a drive that is no joint of the
    robot or has no limits.
    """

    def __init__(
        self,
        motion: MotionFile,
        joints: Sequence[str],
        drives: Sequence[str],
        mounting: Mounting,
        limits: Mapping[str, JointLimits],
        config: SafetyConfig,
        *,
        damp_others: bool = False,
        fit: bool = False,
    ) -> None:
        for drive in drives:
            if drive not in joints:
                raise InputError(f'no drive {drive!r} in joint_states; it has {", ".join(joints)}')
            if drive not in limits:
                raise InputError(f'no limits are known for {drive}; give them with --limits FILE')
        count, ranges = len(joints), ranges_of(joints, limits)
        self.joints = tuple(joints)
        self.inputs = Inputs(
            self.joints,
            position=np.zeros(count),
            velocity=np.zeros(count),
            needed=('joint_states',),
        )
        self.motion, self.drives = motion, tuple(drives)
        self.policy = MotionPolicy(motion, joints, drives, mounting, limits)
        self.monitor = MotionMonitor(config, self.policy, joints, limits)
        self._supervisor = Supervisor(
            self.policy,
            config,
            inputs=self.inputs,
            monitor=self.monitor,
            limiter=TargetLimiter(config.target_rate, ranges),
        )
        self._torque_limits = np.array(
            [limits[joint].torque if joint in limits else 0.0 for joint in joints]
        )
        self._damp_others, self._fit = damp_others, fit
        self._mounting, self.limits = mounting, limits
        self.notes: tuple[str, ...] = ()
        self._planned = self._done = False

    @property
    def active(self) -> bool:
        """True while the motion is under way."""
        return self._supervisor.state in (State.STANDING_UP, State.RUNNING)

    @property
    def code(self) -> int | None:
        """Exit code once it is over: 0 done, 1 fault or emergency stop, 130 stopped."""
        fault = self._supervisor.fault
        if fault is None:
            return None
        if self._done:
            return 0
        return 130 if fault.kind is FaultKind.STOP else 1

    @property
    def reason(self) -> str:
        """The present segment, or the reason for damping."""
        if self._done:
            return 'done'
        if not self.active:
            fault = self._supervisor.fault
            return 'ready, waits for start' if fault is None else str(fault)
        place, count = self.policy.segment, len(self.motion.segments)
        if place == count:
            return 'return to where it carries no load'
        return f'segment {place + 1} of {count}: {self.motion.segments[place]}'

    def introduction(self, recorded: bool) -> str:
        """Return name, length and drives of the motion; unrecorded, with what to do next."""
        text = f'{self.motion.name}: {self.motion.seconds:.0f} s of {", ".join(self.drives)}'
        if recorded:
            return text
        return (
            f'{text}; record it: ros2 run power_daq record -o bags/{self.motion.name}; '
            'begin (unless --start): ros2 service call /drive_bench/start std_srvs/srv/Trigger'
        )

    def progress(self, recorded: bool) -> str:
        """Return `reason` with the time left; after an unrecorded end, what to do next."""
        if self.active:
            return f'{self.reason}; {self.policy.left:.0f} s left'
        if recorded or not self._done:
            return self.reason
        again = f'{self.repetition}; ' if self.repetition else ''
        return (
            f'done; {again}end the recorder, then: ros2 run power_lab diagnose '
            f'bags/{self.motion.name} --model base.yaml'
        )

    @property
    def repetition(self) -> str:
        """Supply voltages at which the motion is to be repeated, in words; '' for none."""
        again = ' and '.join(f'{voltage:g} V' for voltage in self.motion.supply)
        return f'the motion asks to be repeated at {again} of supply' if again else ''

    def count_publishers(self, count: int) -> None:
        """Set the number of nodes that publish joint_commands; more than this one is a fault."""
        if count > 1:
            told = f'{count} nodes publish joint_commands; stop all but this one'
            self.inputs.complaints['joint_commands'] = told
        else:
            self.inputs.complaints.pop('joint_commands', None)

    def figures(self, now: float) -> dict[str, str]:
        """Return values for diagnostics, by name."""
        shown = self._supervisor.figures(now)
        kept = ('faults', 'joint_states age [ms]')
        left = f'{self.policy.left:.1f}'
        return {'motion': self.motion.name, 'left [s]': left, **{key: shown[key] for key in kept}}

    def unsound(self, now: float) -> str:
        """Return the reason why the motion could not begin at `now`, s; '' if it could."""
        fault = self.monitor.inputs(self.inputs, now)
        return '' if fault is None else str(fault)

    def plan(self) -> None:
        """Plan from the measured pose.

        InputError if the motion leaves the limits, or is under way, since it would begin anew.
        """
        if self.active:
            raise InputError(f'{self.motion.name} is under way; stop it before planning it anew')
        if self.motion.free and not self._damp_others:
            there = zip(self.joints, present(self.inputs), strict=True)
            others = [name for name, found in there if found and name not in self.drives]
            if others:
                raise InputError(
                    f'{", ".join(others)} could not hold while {self.drives[0]} is not in '
                    'position mode; take the drive alone, or allow them to be damped '
                    '(--damp-others)'
                )
        for drive in self.drives if self._fit else ():
            start = float(self.inputs.position[self.joints.index(drive)])
            self.motion, notes = fitted(self.motion, start, self._mounting, self.limits[drive])
            self.notes += notes
        self.policy.motion = self.motion
        self.policy.prepare(self.inputs.position)
        self._planned = True

    def start(self, now: float) -> tuple[bool, str]:
        """Begin if it is safe; return whether it began, and the time left or the reason."""
        if self.active:
            return True, self.reason
        if why := self.unsound(now):
            return False, why
        try:
            self.plan()
        except InputError as error:
            return False, str(error)
        started, told = self._supervisor.start(now)
        return started, f'{self.policy.left:.0f} s to go' if started else told

    def stop(self, now: float) -> tuple[bool, str]:
        """Damp all joints and end the motion; return success and a message."""
        return self._supervisor.stop(now)

    def emergency_stop(self, now: float) -> tuple[bool, str]:
        """Damp all joints as after a fault; return success and a message."""
        return self._supervisor.emergency_stop(now)

    def update(self, now: float) -> Command | None:
        """Take one step at time now, s; None while there is nothing to send.

        InputError if the motion leaves the limits from the initial pose.
        """
        if not self._planned and self.monitor.inputs(self.inputs, now) is None:
            self.plan()
        output = self._supervisor.update(now)
        if self.active and self.policy.active and self.policy.left == 0.0:
            self._done = True
            self._supervisor.stop(now)
            output = SupervisorOutput(None)
        if output is None:
            return None
        if output.targets is None:
            return self.damping
        policy = self.policy
        effort = np.clip(policy.effort, -self._torque_limits, self._torque_limits)
        if policy.mode == 'position':
            return Command(self.joints, output.targets, policy.velocity, effort)
        places = [place for place, _ in policy.moving()]
        names = tuple(self.joints[place] for place in places)
        if policy.mode == 'velocity':
            return Command(names, None, policy.velocity[places])
        return Command(names, None, None, effort[places])

    @property
    def damping(self) -> Command:
        """The command that damps all joints."""
        return Command(self.joints, None, np.zeros(len(self.joints)))
