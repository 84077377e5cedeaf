"""Command rate limiting and adaptive gait phase."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

DEAD_ZONE: Final = 0.1  # m/s, rad/s; norm of a velocity command below which it means standing

COMMAND_RATE_LIMIT: Final = (1.0, 1.0, 2.0)
"""Default rate limit of velocity commands: m/s², m/s², rad/s²."""

CADENCE_ADAPTATION: Final = (3.0, 0.25, 0.6)
"""
Default cadence adaptation: highest stride frequency, Hz, and the capture-point errors, m/s, at
which the cadence begins to rise and reaches that frequency.
"""

TILT_SPEED: Final = 2.26  # m/s, √(gravity × height of the body): speed equivalent to a tilt of 1
_ERROR_FILTER: Final = 0.04  # s, time constant on velocity error and tilt


def check_cadence_adaptation(adaptation: Sequence[float], frequency: float) -> None:
    """Raise InputError unless it is empty or fits a stride frequency at rest, Hz."""
    if not adaptation:
        return
    if len(adaptation) == 3:
        fastest, onset, full = adaptation
        if frequency <= fastest <= 5.0 and 0.0 < onset < full <= 10.0:
            return
    raise InputError(
        f'cadence_adaptation is {list(adaptation)}; expected a frequency of '
        f'{frequency}..5 Hz and two speeds of 0..10 m/s, the first below the second'
    )


def capture_point_error(velocity_error: Floats, tilt: Floats) -> Floats:
    """Return the capture-point error as a speed, m/s [...].

    velocity_error: against the command, m/s [..., 2]; tilt: x and y of the unit vector of gravity
    in the base's frame [..., 2]. A linear inverted pendulum tilted by a small angle falls as one
    that moves at √(g × height) × tilt. The two are added in squares, so that a tilt against the
    velocity error does not compensate it: a robot that stands on a slope of 0.11 (6°) counts as
    one that falls.
    """
    squares = np.square(velocity_error).sum(axis=-1) + np.square(TILT_SPEED * tilt).sum(axis=-1)
    return np.asarray(np.sqrt(squares))


def urgency(adaptation: Sequence[float] | Floats, error: Floats) -> Floats:
    """Return the share of the cadence adaptation, 0..1 [...], at capture-point errors, m/s."""
    _, onset, full = adaptation
    return ramp(error, onset, full)


def ramp(values: Floats, low: float, high: float) -> Floats:
    """Return how far values [...] are on the way from low to high, 0..1 [...]."""
    share = (values - low) / (high - low)
    return np.asarray(np.minimum(np.maximum(share, 0.0), 1.0))


def cadence(frequency: Floats | float, per_speed: Floats | float, command: Floats) -> Floats:
    """Return stride frequencies without disturbance, Hz [N], at velocity commands [N, 3].

    frequency: at rest, Hz. per_speed: added with the size of vx, vy, Hz·s/m: the stride that costs
    least is faster at speed (docs/explanation/policies.md).
    """
    return np.asarray(frequency + per_speed * np.hypot(command[:, 0], command[:, 1]))


def stride_frequency(
    frequency: Floats | float, adaptation: Sequence[float], error: Floats
) -> Floats:
    """Return stride frequencies, Hz [...], at capture-point errors, m/s [...].

    frequency: without disturbance, Hz [...] or one for all. A body falls away from its feet
    exponentially, so an earlier foothold helps most.
    """
    faster = np.maximum(adaptation[0] - frequency, 0.0)
    return np.asarray(frequency + urgency(adaptation, error) * faster)


class CommandRateLimiter:
    """Rate-limited velocity commands of N robots.

    limits: m/s², m/s², rad/s²; empty for none. `values` holds the limited commands [N, 3].
    """

    def __init__(self, limits: Sequence[float], count: int = 1) -> None:
        self._limits = np.array(limits or (np.inf,) * 3)
        self._limited = bool(np.isfinite(self._limits).all())
        self.values = np.zeros((count, 3))  # m/s, m/s, rad/s

    def advance(self, seconds: float | Floats, commands: Floats) -> Floats:
        """Advance towards commands [N, 3] and return the limited commands [N, 3].

        seconds: one for all, or [N, 1].
        """
        if self._limited:
            most = self._limits * seconds
            away = commands - self.values
            self.values = self.values + np.minimum(np.maximum(away, -most), most)
        else:
            self.values = np.array(commands, np.float64)
        return self.values


class GaitPhase:
    """Gait phase of N robots, an input of learned policies.

    It advances while a velocity command asks for motion and, with cadence adaptation, while a
    standing robot has a capture-point error; it restarts at 0. Without a phase, a policy may come
    to rest in a pose from which it never takes a step.
    """

    def __init__(
        self,
        frequency: float,
        adaptation: Sequence[float] = (),
        count: int = 1,
        *,
        per_speed: float = 0.0,
    ) -> None:
        """frequency, per_speed: see `cadence`; adaptation: see CADENCE_ADAPTATION."""
        self._frequency = frequency
        self._per_speed = per_speed
        self._adaptation = tuple(adaptation)
        self._error = np.zeros((count, 4))  # of the velocity, m/s, and tilt
        self.phase = np.zeros(count)  # share of a stride [N]
        self.walking = np.zeros(count, bool)

    def start(self, ids: NDArray[np.intp]) -> None:
        """Reset the robots of these indices."""
        self._error[ids] = 0.0
        self.walking[ids] = False

    def advance(
        self, seconds: float, limited: Floats, commands: Floats, velocity: Floats, gravity: Floats
    ) -> None:
        """Advance the phases.

        limited, commands: velocity commands after and before rate limiting, m/s, m/s and rad/s
        [N, 3]; a command that reverses crosses zero only in the limited one, so both count.
        velocity: of the bases, m/s, and gravity: unit vector, as measured, in the base's frame
        [N, 3].
        """
        asked = np.linalg.norm(limited, axis=1) >= DEAD_ZONE
        asked |= np.linalg.norm(commands, axis=1) >= DEAD_ZONE
        frequency = cadence(self._frequency, self._per_speed, limited)
        if self._adaptation:
            error = np.concatenate([limited[:, :2] - velocity[:, :2], gravity[:, :2]], axis=1)
            self._error = self._error + min(1.0, seconds / _ERROR_FILTER) * (error - self._error)
            away = capture_point_error(self._error[:, :2], self._error[:, 2:])
            frequency = stride_frequency(frequency, self._adaptation, away)
            asked |= away > np.where(self.walking, 0.5, 1.0) * self._adaptation[1]
        on = asked & self.walking
        self.phase = np.where(on, (self.phase + frequency * seconds) % 1.0, 0.0)
        self.walking = asked

    def values(self) -> Floats:
        """Return sine and cosine of the phase [N, 2], zeros for robots that stand."""
        angle = 2.0 * np.pi * self.phase
        return np.column_stack([np.sin(angle), np.cos(angle)]) * self.walking[:, None]
