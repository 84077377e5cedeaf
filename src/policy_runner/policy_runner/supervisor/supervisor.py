"""State machine of running a policy: idle, standing up, running, damping."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from policy_runner.policies.by_name import Policy
from policy_runner.policies.inputs import Inputs
from policy_runner.supervisor.safety import (
    Fault,
    FaultKind,
    SafetyConfig,
    SafetyMonitor,
    TargetLimiter,
)

SETTLE: Final = 2.5  # s to brake under the old policy from 1.5 m/s at 1 m/s², and to stand
FADE: Final = 0.4  # s to go over from the targets of one to those of the other


class Handover:
    """Change of policy: zero velocity commands for SETTLE s, then a fade between joint targets.

    It begins at time `now`, s; until it is done no velocity commands are taken.
    """

    def __init__(self, old: Policy, new: Policy, now: float) -> None:
        self.new = new
        self._old = old
        self._began = now
        self._taken_over: float | None = None
        self._waiting = 0.0

    def done(self, now: float) -> bool:
        """Return True once the new policy alone is in command."""
        taken = self._taken_over
        return taken is not None and now - taken >= max(FADE, self._waiting)

    def step(self, now: float, inputs: Inputs, velocity: Floats | None) -> Floats:
        """Return joint targets, rad [12]; now: s; velocity: of the base, m/s [3], or None."""
        still = np.zeros(3)
        if self._taken_over is None and now - self._began >= SETTLE:
            self._taken_over = now
            self._waiting = self.new.take_over()
        if self._taken_over is None:
            return self._old.step(now, still, inputs, velocity)
        share = (now - self._taken_over) / FADE
        targets = self.new.step(now, still, inputs, velocity)
        if share >= 1.0:
            return targets
        return (1.0 - share) * self._old.step(now, still, inputs, velocity) + share * targets


class State(Enum):
    """State of the runner; idle sends nothing, damping sends zero velocity."""

    IDLE = 'idle'
    STANDING_UP = 'standing up'
    RUNNING = 'running'
    DAMPING = 'damping'


@dataclass(frozen=True)
class SupervisorOutput:
    """Command to the drives: targets, rad [D], or damping if None."""

    targets: Floats | None


class Supervisor:
    """Supervisor that runs a policy and damps from the first fault on.

    restart_after: s of sound inputs after which it starts again by itself, 0 for never; an
    emergency stop always waits for stop() and then start(). source: velocity commands by time
    walked, s, in place of those of the inputs. inputs, monitor and limiter: for other joints than
    the twelve of the robot.
    """

    def __init__(
        self,
        policy: Policy,
        config: SafetyConfig | None = None,
        *,
        restart_after: float = 0.0,
        source: Callable[[float], Floats] | None = None,
        inputs: Inputs | None = None,
        monitor: SafetyMonitor | None = None,
        limiter: TargetLimiter | None = None,
    ) -> None:
        if not restart_after >= 0.0:
            raise ValueError(f'restart_after is {restart_after!r} s; it must be 0 or more')
        self.state = State.IDLE
        self.fault: Fault | None = None
        self.inputs = inputs or Inputs()
        self.faults = 0
        self._policy = policy
        self._config = config = config or SafetyConfig()
        self._monitor = monitor or SafetyMonitor(config)
        self._limiter = limiter or TargetLimiter(config.target_rate)
        self._restart_after = restart_after
        self._source = source
        self._since = 0.0
        self._sound_since: float | None = None
        self._last = 0.0
        self._walked = 0.0
        self._updated = -np.inf
        self._excused = False
        self._handover: Handover | None = None

    @property
    def reason(self) -> str:
        """Reason for the state, in words."""
        return str(self.fault) if self.fault is not None else self.state.value

    def start(self, now: float) -> tuple[bool, str]:
        """Stand up and run if the inputs are sound; return whether it does, and why. now: s."""
        if self.state in (State.STANDING_UP, State.RUNNING):
            return True, f'already {self.state.value}'
        if self.fault is not None and self.fault.kind is FaultKind.EMERGENCY_STOP:
            return False, 'emergency stop holds; call stop first to release it'
        fault = self._monitor.inputs(self.inputs, now)
        if fault is not None:
            return False, str(fault)
        self.fault = None
        self.state = State.STANDING_UP
        self._since = self._last = now
        self._policy.reset()
        self._limiter.reset(self.inputs.position)
        return True, 'standing up'

    def stop(self, now: float) -> tuple[bool, str]:
        """Damp, and release an emergency stop; return True and the state."""
        self._damp(Fault(FaultKind.STOP, 'asked for'), now)
        return True, self.state.value

    def emergency_stop(self, now: float) -> tuple[bool, str]:
        """Damp until stop() and start() are called; return True and the state."""
        self._damp(Fault(FaultKind.EMERGENCY_STOP, 'asked for'), now)
        return True, 'damping'

    def change(self, policy: Policy, now: float) -> tuple[bool, str]:
        """Run another policy from now on, or the next start; return whether, and the procedure.

        A robot that walks comes to a stand first, and takes no commands until the new one runs.
        """
        if self._handover is not None:
            return False, 'a change of policy is under way; try again in some seconds'
        if self.state in (State.STANDING_UP, State.RUNNING):
            standing_up = self.state is State.STANDING_UP
            begins = max(now, self._since + self._policy.ramp) if standing_up else now
            self._handover = Handover(self._policy, policy, begins)
            return True, 'the robot comes to a stand, then the policy changes'
        self._policy = policy
        return True, 'the policy is changed'

    def update(self, now: float) -> SupervisorOutput | None:
        """Take one step at time now, s; None while there is nothing to send.

        A step that itself comes late, after a stall of this process, cannot tell lost input from
        messages that wait to be read: staleness is then judged by the next one.
        """
        fault = self._monitor.inputs(self.inputs, now)
        late = now - self._updated > 0.5 * self._config.stale_after
        self._updated = now
        if fault is None:
            self._excused = False
        elif fault.kind is FaultKind.STALE and late and not self._excused:
            self._excused = True
            return None
        if self.state in (State.STANDING_UP, State.RUNNING):
            if fault is None:
                return self._run(now)
            self._damp(fault, now)
        elif self.state is State.DAMPING:
            self._consider_restart(fault, now)
        return SupervisorOutput(None) if self.state is State.DAMPING else None

    def command(self, now: float) -> Floats:
        """Return the velocity command in force: vx, vy in m/s, yaw rate in rad/s [3]."""
        if self.state is not State.RUNNING or self._handover is not None:
            return np.zeros(3)
        if self._source is not None:
            return self._source(self._walked)
        if now - self.inputs.command_time > self._config.command_timeout:
            return np.zeros(3)
        return self.inputs.command

    def figures(self, now: float) -> dict[str, str]:
        """Return the values for diagnostics, by name."""
        inputs = self.inputs
        return {
            'state': self.state.value,
            'faults': str(self.faults),
            'joint_states age [ms]': f'{(now - inputs.joint_time) * 1e3:.1f}',
            'imu age [ms]': f'{(now - inputs.imu_time) * 1e3:.1f}',
            'odom age [ms]': f'{(now - inputs.odom_time) * 1e3:.1f}',
            'velocity command': ' '.join(f'{value:.2f}' for value in self.command(now)),
        }

    def _run(self, now: float) -> SupervisorOutput:
        if self.state is State.STANDING_UP and now - self._since >= self._policy.ramp:
            self.state = State.RUNNING
            self._since = now
        fresh = now - self.inputs.odom_time <= self._config.stale_after
        velocity = self.inputs.base_velocity
        known = velocity if fresh and np.isfinite(velocity).all() else None
        targets = self._act(now, known)
        fault = self._monitor.targets(targets)
        if fault is not None:
            self._damp(fault, now)
            return SupervisorOutput(None)
        dt = max(now - self._last, 0.0)
        limited = self._limiter(targets, dt)
        if self.state is State.RUNNING:
            self._walked += dt
        self._last = now
        return SupervisorOutput(limited)

    def _act(self, now: float, velocity: Floats | None) -> Floats:
        handover = self._handover
        if handover is None:
            return self._policy.step(now, self.command(now), self.inputs, velocity)
        targets = handover.step(now, self.inputs, velocity)
        if handover.done(now):
            self._policy, self._handover = handover.new, None
        return targets

    def _damp(self, fault: Fault, now: float) -> None:
        if self._handover is not None:
            self._policy, self._handover = self._handover.new, None
        if fault.kind is FaultKind.STOP and self.state is State.IDLE:
            return
        self.state = State.DAMPING
        self.fault = fault
        self.faults += fault.kind is not FaultKind.STOP
        self._sound_since = None
        self._since = now

    def _consider_restart(self, fault: Fault | None, now: float) -> None:
        stops = FaultKind.STOP, FaultKind.EMERGENCY_STOP
        asked = self.fault is not None and self.fault.kind in stops
        if fault is not None or asked or self._restart_after == 0.0:
            self._sound_since = None
        elif self._sound_since is None:
            self._sound_since = now
        elif now - self._sound_since >= self._restart_after:
            self.start(now)


_KEPT: Final = 3000  # steps; a minute at 50 Hz
_LATE: Final = 1.5  # periods


class LoopTiming:
    """Counter of missed periods, with the durations of recent steps.

    period: s between steps. A step that begins over 1.5 periods after the last one has missed the
    periods between.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._durations: deque[float] = deque(maxlen=_KEPT)
        self._last: float | None = None
        self.missed = 0
        self.steps = 0

    def begin(self, now: float) -> None:
        """Record the beginning of a step, s."""
        if self._last is not None and now - self._last > _LATE * self._period:
            self.missed += round((now - self._last) / self._period) - 1
        self._last = now

    def end(self, now: float) -> None:
        """Record the end of a step, s: its command is sent."""
        if self._last is not None:
            self._durations.append(now - self._last)
            self.steps += 1

    def change(self, period: float) -> None:
        """Set another period, s."""
        self._period, self._last = period, None

    def figures(self) -> dict[str, str]:
        """Return values for diagnostics, by name."""
        if not self._durations:
            return {'steps': '0'}
        median, high = 1e3 * np.quantile(self._durations, [0.5, 0.99])
        return {
            'steps': str(self.steps),
            'periods missed': str(self.missed),
            'observation to command, median [ms]': f'{median:.2f}',
            'observation to command, p99 [ms]': f'{high:.2f}',
        }
