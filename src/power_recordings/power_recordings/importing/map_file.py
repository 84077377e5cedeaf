"""Import maps (`format: import/1`): where the signals of a log are and what units they have.

DESIGN: a map names columns of the log, never code. Ready maps lie in `maps/` and go by name.
"""

from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from wattwalk_core.errors import InputError, quoted
from wattwalk_core.schema import Quantity, parse, schema
from wattwalk_core.yaml_file import read_yaml

FORMAT: Final = 'import/1'
MAPS: Final = Path(__file__).parent / 'maps'
JOINT: Final = ('position', 'velocity', 'torque')
ELECTRICAL: Final = ('voltage', 'current', 'power', 'efficiency', 'loss', 'temperature')
QUANTITIES: Final = (*JOINT, 'motor_current', 'command', *ELECTRICAL)
GEARED: Final = ('position', 'velocity', 'command')
_LONGEST: Final = 200  # characters of the name of a map
_Scale = Annotated[float, Quantity(-1e12, 1e12)]


@schema
class Signal:
    """One quantity: a column of the log (`source`, `from` in the file) or a constant `value`.

    Or a `sum` of products of columns, as `[[vq, iq], [vd, id]]`; `computed` marks a power that is
    such a formula of a firmware and no meter's reading. A value of the log is converted from
    `unit`; or multiplied by `scale`, `offset` added, with `from_unit` as a note of what it was.
    `positive` is the sign of power that the robot draws. `at` says which torque it is: measured at
    the joint, or computed from the motor's current; a position or velocity at the motor is divided
    by the drive's gear ratio. An `optional` signal may be absent from the log.
    """

    source: str = ''
    value: _Scale | None = None
    sum: tuple[tuple[str, ...], ...] = ()
    unit: str = ''
    scale: _Scale | None = None
    offset: _Scale | None = None
    from_unit: str = ''
    positive: Literal['drawn', 'fed'] = 'drawn'
    at: Literal['joint', 'motor', ''] = ''
    computed: bool = False
    optional: bool = False

    def __post_init__(self) -> None:
        if bool(self.source) + bool(self.sum) + (self.value is not None) != 1:
            raise InputError('a signal has either from, sum or value')
        if not all(self.terms) or not all(self.columns):
            raise InputError('sum: expected lists of columns, such as [[vq, iq], [vd, id]]')

    @property
    def terms(self) -> tuple[tuple[str, ...], ...]:
        """Columns of each product; the signal is the sum of the products. Empty for a constant."""
        return self.sum or (((self.source,),) if self.source else ())

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of all products."""
        return tuple(column for term in self.terms for column in term)

    def filled(self, text: str) -> Self:
        """Return the signal with `text` in place of each `*` in its column names."""
        terms = tuple(tuple(name.replace('*', text) for name in term) for term in self.sum)
        return replace(self, source=self.source.replace('*', text), sum=terms)


class SignalsByQuantity:
    """Base class of parts of a map whose fields are signals, named as their quantities."""

    def signals(self) -> dict[str, Signal]:
        """Return the signals that the map has, by quantity."""
        return {name: s for name in QUANTITIES if (s := getattr(self, name, None)) is not None}


@schema
class DriveMap(SignalsByQuantity):
    """The signals of one drive; those that were not recorded are left out.

    gear_ratio: turns of the motor per turn of the joint; signals are at the joint unless
    `at: motor`. motor_current is that of the quadrature axis. Given an efficiency, or a loss in W,
    power is computed from it and torque × speed.
    """

    position: Signal | None = None
    velocity: Signal | None = None
    torque: Signal | None = None
    motor_current: Signal | None = None
    command: Signal | None = None
    voltage: Signal | None = None
    current: Signal | None = None
    power: Signal | None = None
    efficiency: Signal | None = None
    loss: Signal | None = None
    temperature: Signal | None = None
    gear_ratio: Annotated[float, Quantity(1e-3, 1e5)] | None = None


@schema
class SupplyMap(SignalsByQuantity):
    """The supply of the whole robot."""

    voltage: Signal | None = None
    current: Signal | None = None
    power: Signal | None = None


@schema
class TimeColumn:
    """One of several columns whose times are added, such as seconds and nanoseconds."""

    source: str
    unit: str = ''


@schema
class TimeMap:
    """A column of times, several that are added, or the constant rate [Hz] of a log that has none.

    The unit defaults to the one in the column's head, else s. The rows of a `steady` log are
    operating points in any order.
    """

    column: str = ''
    unit: str = ''
    columns: tuple[TimeColumn, ...] = ()
    steady: bool = False
    rate: Annotated[float, Quantity(0.01, 1e6, 'Hz')] | None = None

    def __post_init__(self) -> None:
        if bool(self.column) + bool(self.columns) + self.steady + (self.rate is not None) != 1:
            raise InputError('time has either column, columns, rate or steady')

    @property
    def parts(self) -> tuple[TimeColumn, ...]:
        """Columns whose times are added; empty for a log without times."""
        return self.columns or ((TimeColumn(self.column, self.unit),) if self.column else ())


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
    """Return the names of the ready maps, sorted, without `.yaml`."""
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
    """Build a map from its parsed YAML; an InputError for wrong content begins with `where`."""
    return parse(ImportMap, _renamed(content), where)


def _renamed(content: Any) -> Any:
    """Rename `from`, a keyword of Python, and take `time: {stamp: …}` of bags apart."""
    if not isinstance(content, dict):
        return content
    result = {
        key: _signals(value) if key in ('drives', 'supply', 'time') else value
        for key, value in content.items()
    }
    time = result.get('time')
    if isinstance(time, dict) and 'stamp' in time:
        result['stamp'] = time['stamp']
        result['time'] = {key: item for key, item in time.items() if key != 'stamp'} or None
    return result


def _signals(value: Any) -> Any:
    if isinstance(value, list):
        return [_signals(item) for item in value]
    if not isinstance(value, dict):
        return value
    return {('source' if key == 'from' else key): _signals(item) for key, item in value.items()}
