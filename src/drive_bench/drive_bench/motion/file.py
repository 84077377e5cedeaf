"""Motion files: segments of a drive's motion (`format: motion/1`)."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final, Literal

from wattwalk_core.anymal import GRAVITY
from wattwalk_core.errors import InputError
from wattwalk_core.schema import Quantity, parse, schema
from wattwalk_core.yaml_file import read_yaml

from drive_bench.motion.segments import Segment

FORMAT: Final = 'motion/1'


@schema
class MotionContent:
    """Content of a motion file: segments, or segments by mode, the first mode being the default.

    loads: whether torques are in N·m or shares of the load's pull (its torque at a right angle).
    reason, seconds: the motion's purpose and length, as `power_lab diagnose` writes them.
    """

    format: Literal['motion/1']
    segments: tuple[Segment, ...] = ()
    modes: dict[Literal['position', 'velocity', 'torque'], tuple[Segment, ...]] = field(
        default_factory=dict
    )
    drives: tuple[str, ...] = ()
    repeat_at_supply_voltage: tuple[Annotated[float, Quantity(1.0, 1000.0, 'V')], ...] = ()
    loads: Literal['absolute', 'share'] = 'absolute'
    about: str = ''
    reason: str = ''
    seconds: float = 0.0

    def __post_init__(self) -> None:
        if not all(self.modes.values() if self.modes else [self.segments]):
            raise InputError('a motion needs segments: a list with at least one entry')


@dataclass(frozen=True)
class MotionFile:
    """Sequence of segments, with the drives and supply voltages (V) to use.

    mode: the one of the file's `modes` that the segments are of, empty if it has none.
    shares: torques and loads are shares of the pendulum's pull, see `with_pull`.
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
        """Duration of all segments, s."""
        return sum(segment.seconds for segment in self.segments)

    @property
    def strongest(self) -> float:
        """Largest torque or load of all segments, N·m."""
        return max(segment.strongest for segment in self.segments)

    @property
    def free(self) -> bool:
        """True if a drive leaves position mode."""
        return any(segment.free for segment in self.segments)

    @property
    def warms(self) -> bool:
        """True if a segment ends at a winding temperature."""
        return any(segment.until_warmer for segment in self.segments)

    def with_pull(self, pull: float) -> 'MotionFile':
        """Return the motion with its shares times `pull`, N·m, as torques; itself without shares.

        InputError for shares if `pull` is not above 0.
        """
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
        """Return the motion with another amplitude (unit of the mode), frequency (Hz), length (s).

        Segments that have a shape or swing are changed; InputError if there is none.
        """
        given = {'amplitude': amplitude, 'frequency': frequency, 'seconds': seconds}
        wanted = {key: value for key, value in given.items() if value is not None}
        if not wanted:
            return self
        if not any(segment.waves for segment in self.segments):
            raise InputError(f'{self.name} has no segment with an {", ".join(wanted)} to change')
        contents = [
            {**segment.content(), **(wanted if segment.waves else {})} for segment in self.segments
        ]
        return replace(self, segments=parse(tuple[Segment, ...], contents, self.name))

    @classmethod
    def load(cls, path: Path, mode: str | None = None) -> 'MotionFile':
        """Read a file; InputError names the entry that is wrong.

        mode: which of the file's `modes` to take; the first if None.
        """
        return cls.of(read_yaml(path, 'motion'), f'motion {path}', path.stem, mode)

    @classmethod
    def of(cls, content: object, where: str, name: str, mode: str | None = None) -> 'MotionFile':
        """Parse the content of a motion file, as read from YAML.

        where: start of each error message. name: of the motion. mode: which of the content's
        `modes` to take; the first if None. InputError for an unknown mode or wrong content.
        """
        read = parse(MotionContent, content, where)
        modes = {str(key): segments for key, segments in read.modes.items()}
        if mode is not None and mode not in modes:
            there = f'has no mode {mode!r}; it has {", ".join(modes)}'
            only = f'has one way only; leave --mode {mode} out'
            raise InputError(f'{where} {there if modes else only}')
        chosen = mode or next(iter(modes), '')
        return cls(
            name,
            read.drives,
            modes[chosen] if chosen else read.segments,
            read.repeat_at_supply_voltage,
            read.about,
            chosen,
            read.loads == 'share',
        )


_FOLDER: Final = Path(__file__).parent / 'motions'
MOTIONS: Final = tuple(sorted(path.stem for path in _FOLDER.glob('*.yaml')))
"""Names of the shipped motions."""


def find_motion(wanted: str, mode: str | None = None) -> MotionFile:
    """Load a motion by shipped name or file; mode and InputError as of `MotionFile.load`."""
    if wanted in MOTIONS:
        return MotionFile.load(_FOLDER / f'{wanted}.yaml', mode)
    path = Path(wanted)
    if not path.exists():
        raise InputError(f'no motion {wanted!r}; there are {", ".join(MOTIONS)}, or give a file')
    return MotionFile.load(path, mode)


def listing() -> str:
    """Return a line for each shipped motion: name, modes, description."""
    lines = []
    for name in MOTIONS:
        content = read_yaml(_FOLDER / f'{name}.yaml', 'motion')
        modes = ', '.join(content.get('modes', {})) or 'one way'
        lines.append(f'  {name:10}{modes:28}{content.get("about", "")}')
    return '\n'.join(lines)


_NUMBER: Final = r'\d+\.?\d*|\.\d+'
_LOAD: Final = re.compile(rf'(?P<mass>{_NUMBER}) ?kg ?@ ?(?P<length>{_NUMBER}) ?m')


@dataclass(frozen=True)
class Load:
    """Weight on an arm: mass (kg) at a length (m) from the joint."""

    mass: float
    length: float

    @property
    def pull(self) -> float:
        """Torque of gravity at a right angle, N·m."""
        return GRAVITY * self.mass * self.length

    def __str__(self) -> str:
        return f'{self.mass:g}kg@{self.length:g}m'

    @classmethod
    def of(cls, text: str) -> 'Load':
        """Parse text such as 4kg@0.3m; InputError for anything else."""
        found = _LOAD.fullmatch(text.strip())
        load = cls(float(found['mass']), float(found['length'])) if found else None
        if load is None or not (0.0 < load.mass <= 100.0 and 0.0 < load.length <= 3.0):
            raise InputError(f'--load is {text!r}; give such as 4kg@0.3m, up to 100 kg and 3 m')
        return load
