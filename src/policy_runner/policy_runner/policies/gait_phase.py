"""What a walker goes by: commands that come gradually, and a clock that hurries."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

Floats = NDArray[np.float64]

DEAD_ZONE: Final = 0.1  # m/s, rad/s; norm of a velocity command below which it means standing

COMMAND_SLEW: Final = (1.0, 1.0, 2.0)
"""The fastest that walkers here are shown a velocity command to change: m/s², m/s², rad/s²."""

HURRY: Final = (3.0, 0.25, 0.6)
"""How the clock of the policies that are trained here hurries: Hz, m/s, m/s, see `haste`."""

_LEAN: Final = 2.26  # m/s, √(gravity × height of the body): a tilt is as bad as such a speed
_SENSED: Final = 0.04  # s, time constant on velocity error and tilt that the clock hurries by


def check_hurry(hurry: Sequence[float], frequency: float) -> None:
    """InputError unless it is empty, or three numbers that `haste` can go by."""
    if not hurry:
        return
    if len(hurry) == 3:
        fastest, above, full = hurry
        if frequency <= fastest <= 5.0 and 0.0 < above < full <= 10.0:
            return
    raise InputError(
        f'hurry is {list(hurry)}; it must be a frequency in {frequency}..5 Hz and two '
        'speeds, the first less than the second, in 0..10 m/s'
    )


def off_balance(velocity_error: Floats, tilt: Floats) -> Floats:
    """
    How fast bodies leave their feet, m/s [...].

    velocity_error: against the command, m/s [..., 2]; tilt: gravity's part along the base's x
    and y, as a unit vector [..., 2]. A tilted body falls as one that has √(g × height) × tilt of
    speed (the capture point of a linear inverted pendulum). Both are taken for the worst, as if
    at right angles: that a body leans against its speed does not count in its favour. So a robot
    that stands on a slope of 0.11 (6°) is taken for one that falls.
    """
    squares = np.square(velocity_error).sum(axis=-1) + np.square(_LEAN * tilt).sum(axis=-1)
    return np.asarray(np.sqrt(squares))


def haste(hurry: Sequence[float], away: Floats) -> Floats:
    """
    How much robots hurry that are out of balance by so much, m/s [...]: 0 not at all, 1 fully.

    hurry: the fastest rate of strides, Hz; how much from which on strides get faster, m/s; and
    at how much they are as fast as that, m/s.
    """
    _, above, full = hurry
    return np.asarray(np.clip((away - above) / (full - above), 0.0, 1.0))


def stride_rate(frequency: float, hurry: Sequence[float], away: Floats) -> Floats:
    """
    Strides per second of robots that are out of balance by so much, m/s [...], see `haste`.

    A body falls away from its feet exponentially, so what helps most is to put the next foot
    down sooner.
    """
    return np.asarray(frequency + haste(hurry, away) * (hurry[0] - frequency))


class CommandSlew:
    """
    Velocity commands as N robots are shown them: changing no faster than `command_slew` says.

    A command that jumps from 1 m/s one way to 1 m/s the other asks for what no legs can do.
    """

    def __init__(self, limits: Sequence[float], count: int = 1) -> None:
        self._limits = np.array(limits or (np.inf,) * 3)
        self.values = np.zeros((count, 3))  # m/s, m/s, rad/s

    def advance(self, seconds: float, commands: Floats) -> Floats:
        """Go towards commands [N, 3] for a time; what is shown then [N, 3]."""
        if np.isfinite(self._limits).all():
            most = self._limits * seconds
            self.values = self.values + np.clip(commands - self.values, -most, most)
        else:
            self.values = np.array(commands, np.float64)
        return self.values


class GaitPhase:
    """
    The phase of N robots' strides, which a policy's own steps go by.

    It runs while a velocity command asks for motion and, with `hurry`, while a robot that is to
    stand is out of balance; it begins anew at 0. Without it, a policy may come to rest in a pose
    from which it never takes a step.
    """

    def __init__(self, frequency: float, hurry: Sequence[float] = (), count: int = 1) -> None:
        self._frequency = frequency
        self._hurry = tuple(hurry)
        self._error = np.zeros((count, 4))  # of the velocity, m/s, and tilt
        self.phase = np.zeros(count)  # share of a stride [N]
        self.walking = np.zeros(count, bool)

    def start(self, ids: NDArray[np.intp]) -> None:
        """Forget the past of some robots."""
        self._error[ids] = 0.0
        self.walking[ids] = False

    def advance(
        self, seconds: float, shown: Floats, commands: Floats, velocity: Floats, gravity: Floats
    ) -> None:
        """
        Go on, under commands in m/s, m/s and rad/s [N, 3], as they are shown and as they are.

        velocity: of the bases, m/s, and gravity: unit vector, both as they are sensed, in the
        base's frame [N, 3]. A command that crosses zero on its way from one side to the other
        asks for motion all the time.
        """
        asked = np.linalg.norm(shown, axis=1) >= DEAD_ZONE
        asked |= np.linalg.norm(commands, axis=1) >= DEAD_ZONE
        rate = np.full(len(asked), self._frequency)
        if self._hurry:
            error = np.concatenate([shown[:, :2] - velocity[:, :2], gravity[:, :2]], axis=1)
            self._error = self._error + min(1.0, seconds / _SENSED) * (error - self._error)
            away = off_balance(self._error[:, :2], self._error[:, 2:])
            rate = stride_rate(self._frequency, self._hurry, away)
            asked |= away > np.where(self.walking, 0.5, 1.0) * self._hurry[1]
        on = asked & self.walking
        self.phase = np.where(on, (self.phase + rate * seconds) % 1.0, 0.0)
        self.walking = asked

    def values(self) -> Floats:
        """Sine and cosine of the phase, zeros for who is to stand [N, 2]."""
        angle = 2.0 * np.pi * self.phase
        return np.column_stack([np.sin(angle), np.cos(angle)]) * self.walking[:, None]
