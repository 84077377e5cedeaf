"""Motion files: what a drive is to be put through, segment by segment (`format: motion/1`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import yaml
from wattwalk_core.errors import InputError

from drive_bench.motion.segments import MODES, Segment, finite, segment_of

FORMAT: Final = 'motion/1'


@dataclass(frozen=True)
class MotionFile:
    """
    Segments to execute one after the other, with the drives and supply voltages (V) asked.

    mode: the one of the file's `modes` that the segments are of, empty if it has one way only.
    shares: torques and loads are shares of what the pendulum pulls, see `with_pull`.
    """

    name: str
    drives: tuple[str, ...]
    segments: tuple[Segment, ...]
    supply: tuple[float, ...] = ()
    about: str = ''
    mode: str = ''
    shares: bool = False

    @property
    def seconds(self) -> float:
        """Length of all segments."""
        return sum(segment.seconds for segment in self.segments)

    @property
    def strongest(self) -> float:
        """Largest torque or load of all segments, N·m."""
        return max(segment.strongest for segment in self.segments)

    @property
    def free(self) -> bool:
        """Whether a drive is to leave position mode."""
        return any(segment.free for segment in self.segments)

    @property
    def warms(self) -> bool:
        """Whether it depends on the temperature of the winding."""
        return any(segment.until_warmer for segment in self.segments)

    def with_pull(self, pull: float) -> 'MotionFile':
        """The motion in N·m where its torques are shares; pull: of the load, N·m."""
        if not self.shares:
            return self
        if not pull > 0.0:
            raise InputError(
                f'{self.name} holds shares of a load, and there is none; give --load 4kg@0.3m, '
                '--pendulum NM or --locked'
            )
        parts = tuple(segment.times(pull) for segment in self.segments)
        return replace(self, segments=parts, shares=False)

    def changed(
        self,
        amplitude: float | None = None,
        frequency: float | None = None,
        seconds: float | None = None,
    ) -> 'MotionFile':
        """
        The motion with another amplitude (unit of the mode), frequency (Hz) or length (s).

        It goes for the segments that have a shape or swing; InputError if none does.
        """
        given = {'amplitude': amplitude, 'frequency': frequency, 'seconds': seconds}
        wanted = {key: value for key, value in given.items() if value is not None}
        if not wanted:
            return self
        if not any(segment.waves for segment in self.segments):
            raise InputError(f'{self.name} has no segment with an {", ".join(wanted)} to change')
        return replace(
            self,
            segments=tuple(
                segment_of({**segment.content(), **wanted}, f'{self.name}: segment {number}')
                if segment.waves
                else segment
                for number, segment in enumerate(self.segments, 1)
            ),
        )

    def content(self) -> dict[str, object]:
        """As a file holds it."""
        content: dict[str, object] = {'format': FORMAT, 'drives': list(self.drives)}
        if self.supply:
            content['repeat_at_supply_voltage'] = list(self.supply)
        return {**content, 'segments': [segment.content() for segment in self.segments]}

    @classmethod
    def load(cls, path: Path, mode: str | None = None) -> 'MotionFile':
        """
        Read a file; InputError for one that is no motion, with the entry that is wrong.

        mode: which of the file's `modes` to take; the first if None.
        """
        return cls.of(_mapping(path), str(path), path.stem, mode)

    @classmethod
    def of(
        cls, content: Mapping[str, object], where: str, name: str, mode: str | None = None
    ) -> 'MotionFile':
        """A motion from keys and values as in a file; where: to be named in errors."""
        segments, chosen = _choose(content, where, mode)
        if not isinstance(segments, list) or not segments:
            raise InputError(f'{where}: a motion needs segments: a list with at least one entry')
        loads = content.get('loads', 'absolute')
        if loads not in ('absolute', 'share'):
            raise InputError(f'{where}: loads is {loads!r}; it must be absolute or share')
        return cls(
            name,
            tuple(map(str, _entries(content, 'drives', where))),
            tuple(segment_of(s, f'{where}: segment {i}') for i, s in enumerate(segments, 1)),
            tuple(
                finite(v, f'{where}: repeat_at_supply_voltage')
                for v in _entries(content, 'repeat_at_supply_voltage', where)
            ),
            str(content.get('about', '')),
            chosen,
            loads == 'share',
        )


def modes_of(content: Mapping[str, object], where: str) -> Mapping[str, object]:
    """Segments by mode of a file with `modes`; empty for one that has one way only."""
    modes = content.get('modes', {})
    if not isinstance(modes, Mapping) or any(mode not in MODES for mode in modes):
        raise InputError(
            f'{where}: modes is {modes!r:.60}; give segments by position, … or torque'
        )
    return modes


def _choose(content: Mapping[str, object], where: str, mode: str | None) -> tuple[object, str]:
    modes = modes_of(content, where)
    if not modes:
        if mode is not None:
            raise InputError(f'{where} has one way only; leave --mode {mode} out')
        return content.get('segments'), ''
    if mode is not None and mode not in modes:
        raise InputError(f'{where} has no mode {mode!r}; it has {", ".join(modes)}')
    chosen = mode or next(iter(modes))
    return modes[chosen], chosen


def read_yaml(path: Path) -> object:
    """Content of a YAML file, read and never run; InputError where that cannot be."""
    try:
        return yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise InputError(f'{path}: cannot be read ({error.strerror})') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: not YAML ({str(error).splitlines()[0]})') from error


def _mapping(path: Path) -> Mapping[str, object]:
    content = read_yaml(path)
    if not isinstance(content, Mapping) or content.get('format') != FORMAT:
        raise InputError(f'{path}: no motion; it must say format: {FORMAT}')
    return content


def _entries(content: Mapping[str, object], key: str, where: str) -> Sequence[object]:
    entries = content.get(key) or []
    if not isinstance(entries, list):
        raise InputError(f'{where}: {key} is {entries!r}; it must be a list')
    return entries
