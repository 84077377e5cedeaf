"""
Import maps (`format: import/1`): where the signals of a log are and what units they have.

DESIGN: a map names columns of the log, never code. Ready maps lie in `maps/` and go by name.
"""

from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from wattwalk_core.errors import InputError
from wattwalk_core.quoting import quoted
from wattwalk_core.schema import Quantity, parse, schema
from wattwalk_core.yaml_file import read_yaml

FORMAT: Final = 'import/1'
MAPS: Final = Path(__file__).parent / 'maps'
JOINT: Final = ('position', 'velocity', 'torque')
ELECTRICAL: Final = ('voltage', 'current', 'power', 'temperature')
QUANTITIES: Final = (*JOINT, 'command', *ELECTRICAL)
_LONGEST: Final = 200  # characters of the name of a map
_Scale = Annotated[float, Quantity(-1e12, 1e12)]


@schema
class Signal:
    """
    One quantity: a column of the log (`source`, `from` in the file) or a constant `value`.

    A value of the log is converted from `unit`; or multiplied by `scale`, `offset` added, with
    `from_unit` as a note of what it was. `positive` is the sign of power that the robot draws.
    `at` says which torque it is: measured at the joint, or computed from the motor's current. An
    `optional` signal may be absent from the log.
    """

    source: str = ''
    value: _Scale | None = None
    unit: str = ''
    scale: _Scale | None = None
    offset: _Scale | None = None
    from_unit: str = ''
    positive: Literal['drawn', 'fed'] = 'drawn'
    at: Literal['joint', 'motor', ''] = ''
    optional: bool = False

    def __post_init__(self) -> None:
        if bool(self.source) == (self.value is not None):
            raise InputError('a signal has either from or value')


@schema
class DriveMap:
    """The signals of one drive; those that were not recorded are left out."""

    position: Signal | None = None
    velocity: Signal | None = None
    torque: Signal | None = None
    command: Signal | None = None
    voltage: Signal | None = None
    current: Signal | None = None
    power: Signal | None = None
    temperature: Signal | None = None

    def signals(self) -> dict[str, Signal]:
        """Return the signals that the map has, by quantity."""
        return {name: s for name in QUANTITIES if (s := getattr(self, name)) is not None}


@schema
class SupplyMap:
    """The supply of the whole robot."""

    voltage: Signal | None = None
    current: Signal | None = None
    power: Signal | None = None

    def signals(self) -> dict[str, Signal]:
        """Return the signals that the map has, by quantity."""
        names = ('voltage', 'current', 'power')
        return {name: s for name in names if (s := getattr(self, name)) is not None}


@schema
class TimeMap:
    """
    A column of times, or the constant rate [Hz] of a log that has none.

    Without a unit, the one in the column's head counts, or else s.
    """

    column: str = ''
    unit: str = ''
    rate: Annotated[float, Quantity(0.01, 1e6, 'Hz')] | None = None

    def __post_init__(self) -> None:
        if bool(self.column) == (self.rate is not None):
            raise InputError('time has either column or rate')


@schema
class ImportMap:
    """Signals to take out of a log. `stamp` is for bags: the message's header or its log time."""

    format: Literal['import/1']
    drives: dict[str, DriveMap]
    time: TimeMap | None = None
    stamp: Literal['header', 'log'] = 'header'
    supply: SupplyMap = field(default_factory=SupplyMap)
    card: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.drives:
            raise InputError('drives: expected at least one drive')
        for name in self.drives:
            if not name or not name.isprintable() or len(name) > 200:
                raise InputError(f'drives: {name!r:.60} is no name of a drive')


def names() -> tuple[str, ...]:
    """Return the names of the ready maps."""
    return tuple(sorted(path.stem for path in MAPS.glob('*.yaml')))


def load_map(given: str) -> ImportMap:
    """Read a map from a file, or a ready one by name; InputError that names file and entry."""
    path = Path(given)
    if given in names():
        path = MAPS / f'{given}.yaml'
    elif not path.suffix and len(given) < _LONGEST and not path.exists():
        raise InputError(f'no map {quoted(given)}: give a file, or one of {", ".join(names())}')
    return parse_map(read_yaml(path, 'map'), f'map {path}')


def parse_map(content: Any, where: str) -> ImportMap:
    """Check the content of a map; InputError that begins with `where`."""
    return parse(ImportMap, _renamed(content), where)


def _renamed(content: Any) -> Any:
    """Rename `from`, a keyword of Python, and take `time: {stamp: …}` of bags apart."""
    if not isinstance(content, dict):
        return content
    result = {
        key: _signals(value) if key in ('drives', 'supply') else value
        for key, value in content.items()
    }
    time = result.get('time')
    if isinstance(time, dict) and 'stamp' in time:
        result['stamp'] = time['stamp']
        result['time'] = {key: item for key, item in time.items() if key != 'stamp'} or None
    return result


def _signals(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    return {('source' if key == 'from' else key): _signals(item) for key, item in value.items()}
