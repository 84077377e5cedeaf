"""Segments of a motion."""

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from math import inf, log, pi, sin
from typing import Annotated, Final, Literal

from wattwalk_core.errors import InputError
from wattwalk_core.schema import Quantity, schema

SHAPES: Final = ('sine', 'square', 'chirp', 'ladder', 'hold')
_LADDER: Final = (0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0, 0.0)
_RUNG: Final = 2.0  # s


class Oscillation:
    """Sine of `frequency` (Hz), or an exponential chirp from `lowest` to it within `seconds`.

    Values are −1 to 1. It fades in over its first period and out over its last, unless abrupt.
    """

    def __init__(self, frequency: float, seconds: float, lowest: float, abrupt: bool) -> None:
        self._frequency, self._seconds, self._lowest = frequency, seconds, lowest
        self._abrupt = abrupt
        self._all = self.turns(seconds)

    def turns(self, time: float) -> float:
        """Return the number of periods up to a time, s."""
        if not self._lowest or self._lowest == self._frequency:
            return self._frequency * time
        rate = self._frequency / self._lowest
        return self._lowest * self._seconds * (rate ** (time / self._seconds) - 1.0) / log(rate)

    def at(self, time: float) -> float:
        """Return the value, −1 to 1, at a time, s."""
        turns = self.turns(time)
        share = 1.0 if self._abrupt else max(0.0, min(1.0, turns, self._all - turns))
        return share * sin(2.0 * pi * turns)


class LevelSequence:
    """Levels of -1 to 1, each held for `rung` seconds: square, ladder or hold."""

    def __init__(self, shape: str, frequency: float) -> None:
        self.levels = {'square': (1.0, -1.0), 'ladder': _LADDER, 'hold': (1.0,)}[shape]
        rungs = {'square': 0.5 / frequency if frequency else inf, 'ladder': _RUNG}
        self.rung = rungs.get(shape, inf)

    def at(self, time: float) -> tuple[float, float, float]:
        """Return the previous level (0 before the first), the present one and its age, s."""
        count = int(time / self.rung)
        before = self.levels[(count - 1) % len(self.levels)] if count else 0.0
        within = time - count * self.rung if count else time
        return before, self.levels[count % len(self.levels)], within

    @property
    def widest(self) -> float:
        """Largest change from one level to the next."""
        after = (*self.levels, self.levels[0])
        return max(abs(b - a) for a, b in zip((0.0, *self.levels), after, strict=True))


UNITS: Final[Mapping[str, str]] = {'position': 'rad', 'velocity': 'rad/s', 'torque': 'N·m'}

_Torque = Annotated[float, Quantity(-1e4, 1e4, 'N·m')]
_Frequency = Annotated[float, Quantity(0.0, 100.0, 'Hz')]


@schema
class Segment:
    """One segment of a motion.

    rest holds still without load. velocity turns at speed (rad/s) under load (N·m). position
    swings by amplitude (rad) at frequency (Hz) about the angle of load. torque holds torque
    (N·m), or alternates between high and low at frequency.

    With a shape the drive itself is in the mode, and the shape has amplitude in the mode's unit;
    a chirp rises from lowest to frequency. saturate: the drive cannot follow, and is not expected
    to; its speed may exceed the limit, its torque may not. until_warmer: the segment ends early
    once the winding is so many K warmer than at the start, or as hot as hottest (°C).
    """

    mode: Literal['rest', 'velocity', 'position', 'torque']
    seconds: Annotated[float, Quantity(1e-3, 36_000.0, 's')]
    speed: Annotated[float, Quantity(-1e3, 1e3, 'rad/s')] = 0.0
    load: _Torque = 0.0
    torque: _Torque = 0.0
    low: _Torque = 0.0
    high: _Torque = 0.0
    frequency: _Frequency = 0.0
    amplitude: Annotated[float, Quantity(-1e4, 1e4)] = 0.0
    shape: Literal['', 'sine', 'square', 'chirp', 'ladder', 'hold'] = ''
    lowest: _Frequency = 0.0
    saturate: bool = False
    until_warmer: Annotated[float, Quantity(0.0, 200.0, 'K')] = 0.0
    hottest: Annotated[float, Quantity(0.0, 120.0, '°C')] = 90.0

    def __post_init__(self) -> None:
        if self.hottest != 90.0 and not self.until_warmer:
            raise InputError('hottest goes with until_warmer only; give that, too')
        steady = self.shape in ('', 'sine', 'hold') and not self.speed and not self.low
        if self.until_warmer and not steady:
            raise InputError('until_warmer goes with rest, holds and sines only')
        known = {'rest': (), 'position': SHAPES[:-1]}.get(self.mode, SHAPES)
        if self.shape and self.shape not in known:
            raise InputError(
                f'shape is {self.shape!r}; in mode {self.mode} there is '
                f'{", ".join(known) or "none"}'
            )
        if self.shape in ('sine', 'square', 'chirp') and not self.frequency > 0.0:
            raise InputError(f'a {self.shape} needs a frequency above 0 Hz')
        if self.shape == 'chirp' and not 0.0 < self.lowest <= self.frequency:
            raise InputError(
                f'lowest is {self.lowest:g}; a chirp rises to frequency from lowest, above 0 and '
                f'up to {self.frequency:g} Hz'
            )

    @property
    def free(self) -> bool:
        """True if the drive leaves position mode."""
        return bool(self.shape) and self.mode in ('velocity', 'torque')

    @property
    def waves(self) -> bool:
        """True if the segment uses its amplitude."""
        return bool(self.shape) or self.swings

    @property
    def turns(self) -> bool:
        """True if the joint turns at constant speed."""
        return not self.shape and self.speed != 0.0 and self.mode in ('velocity', 'torque')

    @property
    def swings(self) -> bool:
        """True if the joint swings in a sine."""
        sine = self.shape in ('', 'sine')
        return sine and self.mode == 'position' and self.amplitude * self.frequency != 0.0

    @property
    def alternates(self) -> bool:
        """True if the torque alternates between high and low."""
        return not self.shape and self.mode == 'torque' and self.frequency > 0.0

    @property
    def held(self) -> float:
        """Torque at the middle of the motion, N·m."""
        if self.mode == 'rest' or self.free:
            return 0.0
        return self.torque if self.mode == 'torque' else self.load

    @property
    def fastest(self) -> float:
        """Largest commanded speed, rad/s; infinite for a step of position."""
        if self.free:
            return abs(self.amplitude) if self.mode == 'velocity' else 0.0
        if self.mode == 'position' and self.shape == 'square':
            return math.inf if self.amplitude else 0.0
        swings = self.swings or self.shape == 'chirp'
        swing = 2.0 * math.pi * abs(self.frequency * self.amplitude) if swings else 0.0
        return max(abs(self.speed) if self.turns else 0.0, swing)

    @property
    def strongest(self) -> float:
        """Largest commanded torque, N·m."""
        commanded = self.amplitude if self.free and self.mode == 'torque' else 0.0
        return max(map(abs, (self.load, self.torque, self.low, self.high, commanded)))

    def times(self, pull: float) -> 'Segment':
        """Return the segment with all torques multiplied by a factor."""
        names = ['load', 'torque', 'low', 'high']
        names += ['amplitude'] if self.free and self.mode == 'torque' else []
        return replace(self, **{name: pull * getattr(self, name) for name in names})  # type: ignore[type-var]

    def content(self) -> dict[str, object]:
        """Return keys and values as a file holds them, without defaults."""
        given = {
            item.name: getattr(self, item.name)
            for item in fields(self)  # type: ignore[arg-type]
            if item.name not in ('mode', 'seconds') and getattr(self, item.name) != item.default
        }
        return {'mode': self.mode, **given, 'seconds': self.seconds}

    def __str__(self) -> str:
        if self.shape and not (self.shape == 'sine' and self.mode == 'position'):
            text = f'{self.shape} of {self.amplitude:g} {UNITS[self.mode]}'
            text += f', {self.frequency:g} Hz' if self.frequency else ''
            text += f', {self.mode} mode'
        elif self.turns:
            text = f'{self.speed:+g} rad/s' + (f', {self.load:g} N·m' if self.load else '')
        elif self.swings:
            text = f'sine of {self.amplitude:g} rad, {self.frequency:g} Hz'
        elif self.alternates:
            text = f'{self.low:g} and {self.high:g} N·m in turn, {self.frequency:g} Hz'
        elif self.mode == 'rest':
            text = 'rest'
        else:
            text = f'hold {self.held:g} N·m'
        text += f', until {self.until_warmer:g} K warmer' if self.until_warmer else ''
        return f'{text}, {"at most " if self.until_warmer else ""}{self.seconds:g} s'
