"""Motion files: what a drive is to be put through, segment by segment (`format: motion/1`)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import yaml

from policy_runner.errors import InputError

FORMAT: Final = 'motion/1'
MODES: Final = ('rest', 'velocity', 'position', 'torque')
_NUMBERS: Final = (
    'seconds',
    'speed',
    'load',
    'torque',
    'low',
    'high',
    'frequency',
    'amplitude',
)
_LONGEST: Final = 36_000.0  # s


@dataclass(frozen=True)
class Segment:
    """
    One stretch of a motion.

    rest holds still without load. velocity turns at speed (rad/s) under load (N·m). position
    swings by amplitude (rad) at frequency (Hz) about the angle of load. torque holds torque
    (N·m), or changes between high and low at frequency.
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

    @property
    def turns(self) -> bool:
        """Whether the joint turns all the time at one speed, whatever the mode is called."""
        return self.speed != 0.0 and self.mode in ('velocity', 'torque')

    @property
    def swings(self) -> bool:
        """Whether the joint swings in a sine."""
        return self.mode == 'position' and self.amplitude * self.frequency != 0.0

    @property
    def alternates(self) -> bool:
        """Whether the torque changes between high and low."""
        return self.mode == 'torque' and self.frequency > 0.0

    @property
    def held(self) -> float:
        """Torque that is held at the middle of the motion, N·m."""
        if self.mode == 'rest':
            return 0.0
        return self.torque if self.mode == 'torque' else self.load

    @property
    def fastest(self) -> float:
        """Largest speed asked for, rad/s."""
        swing = 2.0 * math.pi * abs(self.frequency * self.amplitude) if self.swings else 0.0
        return max(abs(self.speed) if self.turns else 0.0, swing)

    @property
    def strongest(self) -> float:
        """Largest torque asked for, N·m."""
        return max(map(abs, (self.load, self.torque, self.low, self.high)))

    def __str__(self) -> str:
        if self.turns:
            text = f'{self.speed:+g} rad/s' + (f', {self.load:g} N·m' if self.load else '')
        elif self.swings:
            text = f'sine of {self.amplitude:g} rad, {self.frequency:g} Hz'
        elif self.alternates:
            text = f'{self.low:g} and {self.high:g} N·m in turn, {self.frequency:g} Hz'
        elif self.mode == 'rest':
            text = 'rest'
        else:
            text = f'hold {self.held:g} N·m'
        return f'{text}, {self.seconds:g} s'


@dataclass(frozen=True)
class MotionFile:
    """Segments to execute one after the other, with the drives and supply voltages (V) asked."""

    name: str
    drives: tuple[str, ...]
    segments: tuple[Segment, ...]
    supply: tuple[float, ...] = ()

    @property
    def seconds(self) -> float:
        """Length of all segments."""
        return sum(segment.seconds for segment in self.segments)

    @property
    def strongest(self) -> float:
        """Largest torque or load of all segments, N·m."""
        return max(segment.strongest for segment in self.segments)

    @classmethod
    def load(cls, path: Path) -> 'MotionFile':
        """Read a file; InputError for one that is no motion, with the entry that is wrong."""
        content = _content(path)
        segments = content.get('segments')
        if not isinstance(segments, list) or not segments:
            raise InputError(f'{path}: a motion needs segments: a list with at least one entry')
        return cls(
            path.stem,
            tuple(map(str, _entries(content, 'drives', path))),
            tuple(_segment(s, f'{path}: segment {i}') for i, s in enumerate(segments, 1)),
            tuple(
                _number(v, f'{path}: repeat_at_supply_voltage')
                for v in _entries(content, 'repeat_at_supply_voltage', path)
            ),
        )


def read_yaml(path: Path) -> object:
    """Content of a YAML file, read and never run; InputError where that cannot be."""
    try:
        return yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise InputError(f'{path}: cannot be read ({error.strerror})') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: not YAML ({str(error).splitlines()[0]})') from error


def _content(path: Path) -> Mapping[str, object]:
    content = read_yaml(path)
    if not isinstance(content, Mapping) or content.get('format') != FORMAT:
        raise InputError(f'{path}: no motion; it must say format: {FORMAT}')
    return content


def _entries(content: Mapping[str, object], key: str, path: Path) -> Sequence[object]:
    entries = content.get(key) or []
    if not isinstance(entries, list):
        raise InputError(f'{path}: {key} is {entries!r}; it must be a list')
    return entries


def _number(value: object, where: str) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not math.isfinite(value):  # type: ignore[arg-type]
        raise InputError(f'{where} = {value!r} is not a number that a segment has')
    return float(value)  # type: ignore[arg-type]


def _segment(segment: object, where: str) -> Segment:
    if not isinstance(segment, Mapping) or segment.get('mode') not in MODES:
        raise InputError(f'{where}: mode must be one of {", ".join(MODES)}, in {segment!r}')
    numbers = {}
    for key, value in segment.items():
        if key == 'mode':
            continue
        number = _number(value, f'{where}: {key}')
        if key not in _NUMBERS:
            raise InputError(f'{where}: {key} = {value!r} is not a number that a segment has')
        numbers[str(key)] = number
    if not 0.0 < numbers.get('seconds', 0.0) <= _LONGEST:
        raise InputError(
            f'{where}: seconds must lie above 0, up to {_LONGEST:g}, in {dict(segment)!r}'
        )
    if not 0.0 <= numbers.get('frequency', 0.0) <= 100.0:
        raise InputError(f'{where}: frequency is {numbers["frequency"]:g}; it must be 0..100 Hz')
    return Segment(str(segment['mode']), **numbers)
