"""Velocity commands over time: random or constant."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError
from wattwalk_core.schema import CheckedFields, Quantity

_KINDS = ('stand', 'forward', 'lateral', 'turn', 'mixed')


@dataclass(frozen=True)
class CommandRange(CheckedFields):
    """Range of random commands; InputError for values out of range.

    period: mean time between commands. ramp: duration of the transition between commands.
    weights: of standing, forward, lateral, turning and mixed walking. mixed: shares of the range
    across and of turning in mixed walking.
    """

    forward: Annotated[float, Quantity(0.0, 1.5, 'm/s')] = 0.6
    backward: Annotated[float, Quantity(0.0, 1.5, 'm/s')] = 0.4
    lateral: Annotated[float, Quantity(0.0, 1.0, 'm/s')] = 0.35
    yaw: Annotated[float, Quantity(0.0, 2.0, 'rad/s')] = 0.7
    period: float = 4.0  # s
    ramp: float = 0.6  # s
    weights: tuple[float, float, float, float, float] = (0.12, 0.35, 0.13, 0.15, 0.25)
    mixed: tuple[float, float] = (0.5, 0.7)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.ramp < self.period / 2:
            raise InputError(
                f'ramp is {self.ramp!r} s; it must lie in 0..{self.period / 2} s, half the period'
            )
        if min(self.weights) < 0.0 or sum(self.weights) <= 0.0:
            raise InputError(
                f'weights are {self.weights!r}; they must be 0 or more, and not all 0'
            )

    @classmethod
    def up_to(cls, fastest: Sequence[float]) -> 'CommandRange':
        """Return a range up to vx (both ways), vy in m/s and yaw rate in rad/s [3], also mixed."""
        vx, vy, yaw = fastest
        return cls(forward=vx, backward=vx, lateral=vy, yaw=yaw, mixed=(1.0, 1.0))


def parse_velocity(text: str, option: str = 'velocity') -> tuple[float, float, float]:
    """Return vx, vy in m/s and yaw rate in rad/s of VX,VY,YAW; InputError for anything else."""
    try:
        vx, vy, yaw = (float(part) for part in text.split(','))
    except ValueError:
        raise InputError(f'{option} is {text!r}; expected VX,VY,YAW such as 0,0,0.8') from None
    return vx, vy, yaw


class SteadyCommand:
    """Constant (vx, vy, yaw rate) after a second of standing and a ramp of a second."""

    LIMITS = (1.5, 1.5, 2.0)  # m/s, m/s, rad/s

    def __init__(self, velocity: Sequence[float]) -> None:
        """velocity: vx, vy in m/s, yaw rate in rad/s [3]; InputError beyond LIMITS."""
        good = len(velocity) == 3 and all(
            abs(v) <= limit for v, limit in zip(velocity, self.LIMITS, strict=True)
        )
        if not good:
            raise InputError(
                f'velocity is {",".join(f"{v:g}" for v in velocity)}; expected VX,VY,YAW within '
                '±1.5 m/s, ±1.5 m/s and ±2 rad/s'
            )
        self._velocity = np.array(velocity, dtype=np.float64)

    def __call__(self, time: float) -> Floats:
        """Return the command at `time` s after the start: m/s, m/s, rad/s [3]."""
        return self._velocity * min(max(time - 1.0, 0.0), 1.0)


class RandomCommands:
    """Random (vx, vy, yaw rate) over time, determined by the seed.

    Stretches of forward, sideways, turning and mixed walking follow each other, with stretches
    of standing between; the first second stands.
    """

    def __init__(self, seed: int = 0, span: CommandRange = CommandRange()) -> None:
        self._span = span
        self._random = np.random.default_rng(seed)
        self._ends = [1.0]  # s, at each of which another command begins
        self._values = [np.zeros(3)]

    def __call__(self, time: float) -> Floats:
        """Return the command at `time` s after the start: m/s, m/s, rad/s [3]."""
        while time >= self._ends[-1]:
            length = self._span.period * self._random.uniform(0.6, 1.4)
            self._ends.append(self._ends[-1] + length)
            self._values.append(self._draw())
        index = int(np.searchsorted(self._ends, time, side='right'))
        value = self._values[index]
        if index == 0:
            return value.copy()
        share = min((time - self._ends[index - 1]) / self._span.ramp, 1.0)
        return self._values[index - 1] + share * (value - self._values[index - 1])

    def _draw(self) -> Floats:
        span, random = self._span, self._random
        weights = np.asarray(span.weights) / sum(span.weights)
        kind = _KINDS[int(random.choice(len(_KINDS), p=weights))]
        along = random.uniform(-span.backward, span.forward)
        across = random.uniform(-span.lateral, span.lateral)
        turn = random.uniform(-span.yaw, span.yaw)
        return np.array(
            {
                'stand': (0.0, 0.0, 0.0),
                'forward': (along, 0.0, 0.0),
                'lateral': (0.0, across, 0.0),
                'turn': (0.0, 0.0, turn),
                'mixed': (along, span.mixed[0] * across, span.mixed[1] * turn),
            }[kind]
        )


COMMAND_RATE_LIMIT: Final = (1.0, 1.0, 2.0)
"""Rate limit of the scripted trots: m/s², m/s², rad/s²."""


class CommandRateLimiter:
    """Rate-limited velocity commands of N robots.

    limits: m/s², m/s², rad/s²; empty for none. `values` holds the limited commands [N, 3].
    """

    def __init__(self, limits: Sequence[float], count: int = 1) -> None:
        self._limits = np.array(limits or (np.inf,) * 3)
        self._limited = bool(np.isfinite(self._limits).all())
        self.values = np.zeros((count, 3))  # m/s, m/s, rad/s

    def advance(self, seconds: float, commands: Floats) -> Floats:
        """Advance towards commands [N, 3] and return the limited commands [N, 3]."""
        if self._limited:
            most = self._limits * seconds
            away = commands - self.values
            self.values = self.values + np.minimum(np.maximum(away, -most), most)
        else:
            self.values = np.array(commands, np.float64)
        return self.values
