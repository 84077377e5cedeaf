"""A motion as a policy of the supervisor, with what is watched beside a policy's faults."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policy_runner.errors import InputError
from policy_runner.excitation import MotionFile
from policy_runner.inputs import Inputs
from policy_runner.joint_limits import JointLimits
from policy_runner.motion_plan import Mounting, Plan, Ramps
from policy_runner.safety import (
    Fault,
    FaultKind,
    SafetyConfig,
    SafetyMonitor,
    TargetLimiter,
)
from policy_runner.supervisor import Output, State, Supervisor

Floats = NDArray[np.float64]
_OVER = 1.25  # of what may be asked: then what is measured is a fault
_FOLLOWING = 1.5  # rad; a drive at its torque limit is 1 rad behind its target
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


class Exciting:
    """
    Puts some drives through a motion while the others hold where they were at the start.

    `prepare` comes first: it plans from where the joints are. Then it is a Policy; `velocity`
    and `effort` hold what is fed forward, rad/s and N·m [D].
    """

    rate = 200.0
    ramp = 0.0

    def __init__(
        self,
        motion: MotionFile,
        joints: Sequence[str],
        drives: Sequence[str],
        mounting: Mounting,
        limits: Mapping[str, JointLimits],
    ) -> None:
        self.motion = motion
        self.velocity, self.effort = np.zeros(len(joints)), np.zeros(len(joints))
        self.targets = np.zeros(len(joints))
        self._drives = {list(joints).index(drive): drive for drive in drives}
        self._mounting, self._limits = mounting, limits
        self._plans: dict[int, Plan] = {}
        self._began: float | None = None
        self._elapsed = 0.0

    def prepare(self, position: Floats) -> None:
        """Plan from a pose, rad [D]; InputError for a motion that leaves the limits."""
        plans = {
            place: Plan(self.motion, float(position[place]), self._mounting, Ramps())
            for place in self._drives
        }
        for place, plan in plans.items():
            plan.check(self._drives[place], self._limits[self._drives[place]])
        self._plans = plans
        self.reset()
        self.targets = np.array(position, dtype=np.float64)

    def reset(self) -> None:
        """Begin from the first segment."""
        self._began = None
        self._elapsed = 0.0

    def take_over(self) -> float:
        """Begin from the first segment; it takes no commands."""
        self.reset()
        return self.motion.seconds

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Joint targets, rad [D]."""
        if self._began is None:
            self._began = time
        self._elapsed = time - self._began
        for place, plan in self._plans.items():
            target = plan.at(self._elapsed)
            self.targets[place] = target.position
            self.velocity[place], self.effort[place] = target.velocity, target.effort
        return self.targets.copy()

    @property
    def active(self) -> bool:
        """Whether drives are told to move."""
        return self._began is not None

    @property
    def left(self) -> float:
        """Time to the end of the motion, s."""
        return max(self.motion.seconds - self._elapsed, 0.0)

    @property
    def segment(self) -> int:
        """Index of the segment that is executed."""
        return next(iter(self._plans.values())).place(self._elapsed)

    def watched(self) -> Iterator[tuple[int, JointLimits]]:
        """Places of the excited drives, with their limits."""
        for place, drive in self._drives.items():
            yield place, self._limits[drive]


class ExcitationMonitor(SafetyMonitor):
    """The safety monitor, which also knows speed, torque and how far a drive lags behind."""

    def __init__(
        self,
        config: SafetyConfig,
        exciting: Exciting,
        joints: Sequence[str],
        limits: Mapping[str, JointLimits],
    ) -> None:
        ranges = _ranges(joints, limits)
        super().__init__(config, ranges, ranges, joints)
        self._exciting = exciting

    def _input_faults(self, inputs: Inputs, now: float) -> Iterator[Fault]:
        yield from super()._input_faults(inputs, now)
        if not self._exciting.active:
            return
        effort = getattr(inputs, 'effort', np.zeros(0))
        for place, limits in self._exciting.watched():
            name = inputs.joint_names[place]
            speed = abs(inputs.velocity[place])
            if speed > _OVER * limits.speed:
                yield Fault(FaultKind.JOINT_LIMIT, _told(name, speed, limits.speed, 'rad/s'))
            torque = abs(effort[place]) if len(effort) else 0.0
            if not torque <= _OVER * limits.torque:
                yield Fault(FaultKind.JOINT_LIMIT, _told(name, torque, limits.torque, 'N·m'))
            lag = abs(self._exciting.targets[place] - inputs.position[place])
            if lag > _FOLLOWING:
                yield Fault(
                    FaultKind.TARGET_RANGE,
                    f'{name} is {lag:.2f} rad from its target, limit {_FOLLOWING} rad',
                )


@dataclass(frozen=True)
class Command:
    """What to send: position, rad, velocity, rad/s, and effort, N·m [D]; no position damps."""

    position: Floats | None
    velocity: Floats
    effort: Floats | None = None


class ExcitationRun:
    """
    Runs a motion on the joints of a robot, under the supervisor that also runs policies.

    limits: by joint, at least for the drives. InputError for a drive that is no joint of the
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
    ) -> None:
        for drive in drives:
            if drive not in joints:
                raise InputError(f'no drive {drive!r} in joint_states; it has {", ".join(joints)}')
            if drive not in limits:
                raise InputError(f'no limits are known for {drive}; give them with --limits FILE')
        count, ranges = len(joints), _ranges(joints, limits)
        self.joints = tuple(joints)
        self.inputs = JointInputs(
            joint_names=self.joints, position=np.zeros(count), velocity=np.zeros(count)
        )
        self._motion, self._drives = motion, tuple(drives)
        self._exciting = Exciting(motion, joints, drives, mounting, limits)
        self._monitor = ExcitationMonitor(config, self._exciting, joints, limits)
        self._supervisor = Supervisor(
            self._exciting,
            config,
            inputs=self.inputs,
            monitor=self._monitor,
            limiter=TargetLimiter(config.target_rate, ranges),
        )
        self._planned = self._done = False

    @property
    def active(self) -> bool:
        """Whether the motion is under way."""
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
        """What it does, or why it damps, for people."""
        if self._done:
            return 'done'
        if not self.active:
            fault = self._supervisor.fault
            return 'ready, waits for start' if fault is None else str(fault)
        place, count = self._exciting.segment, len(self._motion.segments)
        return f'segment {place + 1} of {count}: {self._motion.segments[place]}'

    @property
    def progress(self) -> str:
        """The reason with the time that is left, or what to do once it is done."""
        if self.active:
            return f'{self.reason}; {self._exciting.left:.0f} s left'
        if not self._done:
            return self.reason
        motion = self._motion
        again = ' and '.join(f'{voltage:g} V' for voltage in motion.supply)
        return (
            'done; '
            + (f'the motion asks to be repeated at {again} of supply; ' if again else '')
            + 'end the recorder, then: ros2 run power_lab diagnose '
            + f'bags/{motion.name} --model base.yaml'
        )

    @property
    def introduction(self) -> str:
        """What is about to happen, and the commands for it."""
        return (
            f'{self._motion.name}: {self._motion.seconds:.0f} s of {", ".join(self._drives)}; '
            f'record it: ros2 run power_daq record -o bags/{self._motion.name}; '
            'begin (unless --start): ros2 service call /start std_srvs/srv/Trigger'
        )

    def count_publishers(self, count: int) -> None:
        """Take the number of nodes that publish joint_commands, this one included."""
        if count > 1:
            self.inputs.complaints['joint_commands'] = (
                f'{count} nodes publish joint_commands; stop all but this one'
            )
        else:
            self.inputs.complaints.pop('joint_commands', None)

    def figures(self, now: float) -> dict[str, str]:
        """What diagnostics show beside the reason."""
        shown = self._supervisor.figures(now)
        kept = ('faults', 'joint_states age [ms]')
        left = f'{self._exciting.left:.1f}'
        return {'motion': self._motion.name, 'left [s]': left, **{key: shown[key] for key in kept}}

    def start(self, now: float) -> tuple[bool, str]:
        """Begin, if that is safe; tells whether it does, and why not."""
        if self.active:
            return True, self.reason
        fault = self._monitor.inputs(self.inputs, now)
        if fault is not None:
            return False, str(fault)
        try:
            self._exciting.prepare(self.inputs.position)
        except InputError as error:
            return False, str(error)
        started, told = self._supervisor.start(now)
        return started, f'{self._motion.seconds:.0f} s to go' if started else told

    def stop(self, now: float) -> tuple[bool, str]:
        """Damp and end."""
        return self._supervisor.stop(now)

    def emergency_stop(self, now: float) -> tuple[bool, str]:
        """Damp and end as after a fault."""
        return self._supervisor.emergency_stop(now)

    def update(self, now: float) -> Command | None:
        """
        Take one step at time now, s; None while there is nothing to send.

        InputError if the motion leaves the limits from where the joints are at first.
        """
        if not self._planned and self._monitor.inputs(self.inputs, now) is None:
            self._exciting.prepare(self.inputs.position)
            self._planned = True
        output = self._supervisor.update(now)
        if self.active and self._exciting.active and self._exciting.left == 0.0:
            self._done = True
            self._supervisor.stop(now)
            output = Output(None)
        if output is None:
            return None
        if output.targets is None:
            return Command(None, np.zeros(len(self.joints)))
        return Command(output.targets, self._exciting.velocity, self._exciting.effort)


def _ranges(joints: Sequence[str], limits: Mapping[str, JointLimits]) -> Floats:
    found = [limits.get(joint, _NO_LIMITS) for joint in joints]
    return np.array([(entry.low, entry.high) for entry in found])


def _told(name: str, value: float, limit: float, unit: str) -> str:
    return f'{name} at {value:.2f} {unit}, limit {limit:g} {unit} and a quarter'
