"""Safety checks of inputs and targets, and limits of targets."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from enum import Enum

import numpy as np
from wattwalk_core.anymal import JOINT_NAMES, LIMITS
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from policy_runner.policies.inputs import Inputs
from policy_runner.policies.trot import TARGET_LIMITS


class FaultKind(Enum):
    """Kinds of faults for which the drives are damped."""

    STALE = 'stale input'
    MALFORMED = 'malformed input'
    NOT_FINITE = 'not finite'
    TILT = 'tilt'
    JOINT_LIMIT = 'joint limit'
    COMMAND_RANGE = 'command out of range'
    TARGET_RANGE = 'target out of range'
    RECORDING = 'recording'
    STOP = 'stop'
    EMERGENCY_STOP = 'emergency stop'


@dataclass(frozen=True)
class Fault:
    """Fault for which the drives are damped; detail: its figures in words."""

    kind: FaultKind
    detail: str

    def __str__(self) -> str:
        return f'{self.kind.value}: {self.detail}'


@dataclass(frozen=True)
class SafetyConfig:
    """Safety limits; InputError for one that is not positive.

    stale_after: age of joint_states and imu, s. command_timeout: age at which a velocity command
    turns into zero, s. tilt: of the base from level, rad. joint_margin: measured angle beyond a
    joint's limit, rad. command_range: |vx|, |vy| in m/s and |yaw| in rad/s beyond which a command
    is nonsense rather than fast. target_excess: rad beyond TARGET_LIMITS at which a policy is
    taken to have failed; less is clipped. target_rate: rad/s that targets are limited to.
    """

    stale_after: float = 0.06
    command_timeout: float = 0.5
    tilt: float = 0.9
    joint_margin: float = 0.15
    command_range: float = 5.0
    target_excess: float = 3.0
    target_rate: float = 40.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not value > 0.0:
                raise InputError(f'{item.name} is {value!r}; it must be more than 0')


class SafetyMonitor:
    """Checks inputs and targets for faults that require damping."""

    def __init__(
        self,
        config: SafetyConfig,
        limits: Floats = LIMITS,
        target_limits: Floats = TARGET_LIMITS,
        names: Sequence[str] = JOINT_NAMES,
    ) -> None:
        """limits, target_limits: of measured angles and of targets, rad [D, 2], by names."""
        self._config = config
        self._low, self._high = limits.T
        self._target_limits, self._names = target_limits, tuple(names)

    def inputs(self, inputs: Inputs, now: float) -> Fault | None:
        """Return the first fault of measurements or commands at time now, s; None without one."""
        return next(self._input_faults(inputs, now), None)

    def _input_faults(self, inputs: Inputs, now: float) -> Iterator[Fault]:
        cfg = self._config
        for complaint in inputs.complaints.values():
            yield Fault(FaultKind.MALFORMED, complaint)
        heard = {'joint_states': inputs.joint_time, 'imu': inputs.imu_time}
        for topic in inputs.needed:
            age = now - heard[topic]
            if age > cfg.stale_after:
                told = f'is {age * 1e3:.0f} ms old' if np.isfinite(age) else 'never came'
                limit = f'limit {cfg.stale_after * 1e3:.0f} ms'
                yield Fault(FaultKind.STALE, f'{topic} {told}, {limit}')
        for name, values in (
            ('joint position', inputs.position),
            ('joint velocity', inputs.velocity),
            ('angular velocity', inputs.spin),
            ('gravity direction', inputs.gravity),
            ('velocity command', inputs.command),
        ):
            if not np.isfinite(values).all():
                yield Fault(FaultKind.NOT_FINITE, f'{name} {values.tolist()}')
        tilt = float(np.arccos(np.clip(-inputs.gravity[2], -1.0, 1.0)))
        if tilt > cfg.tilt:
            yield Fault(FaultKind.TILT, f'{tilt:.2f} rad, limit {cfg.tilt:.2f} rad')
        beyond = np.maximum(self._low - inputs.position, inputs.position - self._high)
        worst = int(np.argmax(beyond))
        if beyond[worst] > cfg.joint_margin:
            yield Fault(
                FaultKind.JOINT_LIMIT,
                f'{inputs.joint_names[worst]} at {inputs.position[worst]:.2f} rad, '
                f'limits {self._low[worst]:.2f}..{self._high[worst]:.2f} rad',
            )
        if np.abs(inputs.command).max() > cfg.command_range:
            yield Fault(
                FaultKind.COMMAND_RANGE,
                f'velocity command {inputs.command.tolist()}, limit ±{cfg.command_range}',
            )

    def targets(self, targets: Floats) -> Fault | None:
        """Return the fault of a policy's targets, rad [D]; None if they may be sent."""
        if np.shape(targets) != self._low.shape or not np.isfinite(targets).all():
            return Fault(FaultKind.NOT_FINITE, f'joint targets {np.asarray(targets).tolist()}')
        low, high = self._target_limits.T
        beyond = np.maximum(low - targets, targets - high)
        worst = int(np.argmax(beyond))
        if beyond[worst] > self._config.target_excess:
            return Fault(
                FaultKind.TARGET_RANGE,
                f'{self._names[worst]} wanted at {targets[worst]:.2f} rad, '
                f'limits {low[worst]:.2f}..{high[worst]:.2f} rad',
            )
        return None


class TargetLimiter:
    """Limits targets in range and in rate of change."""

    def __init__(self, rate: float, limits: Floats = TARGET_LIMITS) -> None:
        """rate: rad/s; limits: rad [D, 2]."""
        self._rate, self._limits = rate, limits
        self._last: Floats | None = None

    def reset(self, position: Floats) -> None:
        """Start from a measured pose, rad [D]."""
        self._last = np.array(position, dtype=np.float64)

    def __call__(self, targets: Floats, dt: float) -> Floats:
        """Return limited targets, rad [D], dt s after the previous ones."""
        limited = np.clip(targets, self._limits[:, 0], self._limits[:, 1])
        if self._last is not None:
            most = self._rate * dt
            limited = np.clip(limited, self._last - most, self._last + most)
        self._last = limited
        return limited
