"""One stretch of a motion file, and how it is read."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final

from wattwalk_core.errors import InputError

from drive_bench.motion.waves import SHAPES

MODES: Final = ('rest', 'velocity', 'position', 'torque')
UNITS: Final[Mapping[str, str]] = {'position': 'rad', 'velocity': 'rad/s', 'torque': 'N·m'}
_NUMBERS: Final = (
    *('seconds', 'speed', 'load', 'torque', 'low', 'high', 'frequency', 'amplitude'),
    *('lowest', 'until_warmer', 'hottest'),
)
_LONGEST: Final = 36_000.0  # s
_HOTTEST: Final = 90.0  # °C
_HOTTEST_EVER: Final = 120.0  # °C


@dataclass(frozen=True)
class Segment:
    """
    One stretch of a motion.

    rest holds still without load. velocity turns at speed (rad/s) under load (N·m). position
    swings by amplitude (rad) at frequency (Hz) about the angle of load. torque holds torque
    (N·m), or changes between high and low at frequency.

    With a shape the drive itself is in the mode, and the shape has amplitude in the mode's unit;
    a chirp rises from lowest to frequency. saturate: the drive cannot follow, and shall not be
    expected to; its speed may be more than the limit, its torque not. until_warmer: it ends early
    once the winding is so many K warmer than at the start, or as warm as hottest (°C, at most
    120).
    """

    mode: str
    seconds: float
    speed: float = 0.0
    load: float = 0.0
    torque: float = 0.0
    low: float = 0.0
    high: float = 0.0
    frequency: float = 0.0
    amplitude: float = 0.0
    shape: str = ''
    lowest: float = 0.0
    saturate: bool = False
    until_warmer: float = 0.0
    hottest: float = _HOTTEST

    @property
    def free(self) -> bool:
        """Whether the drive leaves position mode."""
        return bool(self.shape) and self.mode in ('velocity', 'torque')

    @property
    def waves(self) -> bool:
        """Whether it has an amplitude."""
        return bool(self.shape) or self.swings

    @property
    def turns(self) -> bool:
        """Whether the joint turns all the time at one speed, whatever the mode is called."""
        return not self.shape and self.speed != 0.0 and self.mode in ('velocity', 'torque')

    @property
    def swings(self) -> bool:
        """Whether the joint swings in a sine."""
        sine = self.shape in ('', 'sine')
        return sine and self.mode == 'position' and self.amplitude * self.frequency != 0.0

    @property
    def alternates(self) -> bool:
        """Whether the torque changes between high and low."""
        return not self.shape and self.mode == 'torque' and self.frequency > 0.0

    @property
    def held(self) -> float:
        """Torque that is held at the middle of the motion, N·m."""
        if self.mode == 'rest' or self.free:
            return 0.0
        return self.torque if self.mode == 'torque' else self.load

    @property
    def fastest(self) -> float:
        """Largest speed asked for, rad/s; infinite for a jump of position."""
        if self.free:
            return abs(self.amplitude) if self.mode == 'velocity' else 0.0
        if self.mode == 'position' and self.shape == 'square':
            return math.inf if self.amplitude else 0.0
        swings = self.swings or self.shape == 'chirp'
        swing = 2.0 * math.pi * abs(self.frequency * self.amplitude) if swings else 0.0
        return max(abs(self.speed) if self.turns else 0.0, swing)

    @property
    def strongest(self) -> float:
        """Largest torque asked for, N·m."""
        commanded = self.amplitude if self.free and self.mode == 'torque' else 0.0
        return max(map(abs, (self.load, self.torque, self.low, self.high, commanded)))

    def times(self, pull: float) -> 'Segment':
        """The segment with all its torques multiplied."""
        names = ['load', 'torque', 'low', 'high']
        names += ['amplitude'] if self.free and self.mode == 'torque' else []
        return replace(self, **{name: pull * getattr(self, name) for name in names})

    def content(self) -> dict[str, object]:
        """As a file holds it, without what is not said."""
        given = {
            item.name: getattr(self, item.name)
            for item in fields(self)
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


def finite(value: object, where: str) -> float:
    """A number of a file; InputError for anything else."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not math.isfinite(value):  # type: ignore[arg-type]
        raise InputError(f'{where} = {value!r} is not a number that a segment has')
    return float(value)  # type: ignore[arg-type]


def segment_of(content: object, where: str) -> Segment:
    """A segment from keys and values; InputError that names the entry that is wrong."""
    if not isinstance(content, Mapping) or content.get('mode') not in MODES:
        raise InputError(f'{where}: mode must be one of {", ".join(MODES)}, in {content!r}')
    mode, shape, saturate = (content.get(key) for key in ('mode', 'shape', 'saturate'))
    numbers = {}
    for key, value in content.items():
        if key in ('mode', 'shape', 'saturate'):
            continue
        number = finite(value, f'{where}: {key}')
        if key not in _NUMBERS:
            raise InputError(f'{where}: {key} = {value!r} is not a number that a segment has')
        numbers[str(key)] = number
    if not 0.0 < numbers.get('seconds', 0.0) <= _LONGEST:
        raise InputError(
            f'{where}: seconds must lie above 0, up to {_LONGEST:g}, in {dict(content)!r}'
        )
    for key, most, unit in (
        ('frequency', 100.0, 'Hz'),
        ('lowest', 100.0, 'Hz'),
        ('until_warmer', 200.0, 'K'),
        ('hottest', _HOTTEST_EVER, '°C'),
    ):
        if not 0.0 <= numbers.get(key, 0.0) <= most:
            raise InputError(f'{where}: {key} is {numbers[key]:g}; it must be 0..{most:g} {unit}')
    if 'hottest' in numbers and not numbers.get('until_warmer'):
        raise InputError(f'{where}: hottest goes with until_warmer only; give that, too')
    if numbers.get('until_warmer') and (
        shape not in (None, 'sine', 'hold') or numbers.get('speed') or numbers.get('low')
    ):
        raise InputError(f'{where}: until_warmer goes with rest, holds and sines only')
    if saturate not in (None, True, False):
        raise InputError(f'{where}: saturate is {saturate!r}; it must be true or false')
    if shape is not None:
        _check_shape(str(mode), shape, numbers, where)
    return Segment(str(mode), shape=str(shape or ''), saturate=bool(saturate), **numbers)


def _check_shape(mode: str, shape: object, numbers: Mapping[str, float], where: str) -> None:
    known = SHAPES if mode in ('velocity', 'torque') else SHAPES[:-1]
    if mode == 'rest' or shape not in known:
        raise InputError(
            f'{where}: shape is {shape!r}; in mode {mode} there is '
            f'{"none" if mode == "rest" else ", ".join(known)}'
        )
    frequency = numbers.get('frequency', 0.0)
    if shape in ('sine', 'square', 'chirp') and not frequency > 0.0:
        raise InputError(f'{where}: a {shape} needs a frequency above 0 Hz')
    if shape == 'chirp' and not 0.0 < numbers.get('lowest', 0.0) <= frequency:
        raise InputError(
            f'{where}: lowest is {numbers.get("lowest", 0.0):g}; a chirp rises to frequency from '
            f'lowest, above 0 and up to {frequency:g} Hz'
        )
