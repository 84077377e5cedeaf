"""The card of a recording: robot, measured drives and conditions of the measurement."""

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import asdict, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from wattwalk_core.errors import InputError, quoted
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Length, parse, schema
from wattwalk_core.yaml_file import dump_yaml, parse_yaml, read_yaml

FILE = 'card.yaml'
NOTE = 'note'  # key of a report on `diagnostics` whose value a recorder keeps in the card
DRIVE_TYPES = ('HAA', 'HFE', 'KFE')
_TEXTS = ('robot', 'unit', 'controller', 'terrain', 'notes', 'software', 'calibration', 'created')
_COMPUTED: Literal['computed'] = 'computed'
_PLAIN = (int, float, datetime.date)  # what YAML reads where text was meant, as in `unit: 3`


@schema
class CardNote:
    """A note that was taken during a recording, with its ROS time in ISO 8601."""

    time: str
    text: str


@schema
class Card:
    """Content of `card.yaml` in the folder of a recording.

    Texts may stay empty. `drives` are those whose electrical power was measured. `created` is a
    date in ISO 8601; `seed` is that of a simulation. `torque` says for each drive whether its
    torque is that at the joint or that of the motor, computed from its current; `torque_unit` is A
    where the current itself stands for it. `power` is `computed` for drives whose power is a
    firmware's formula and not a meter's reading. `gear_ratio` is that between motor and joint.
    The rows of a `steady` recording are operating points in any order. `marks` were noted while
    it was recorded. Unknown keys are kept in `other`.
    """

    robot: str = ''
    unit: str = ''
    drives: tuple[str, ...] = ()
    controller: str = ''
    calibration: str = ''
    terrain: str = ''
    notes: str = ''
    software: str = ''
    seed: int | None = None
    created: str = ''
    torque: Mapping[str, Literal['joint', 'motor']] = field(default_factory=dict)
    torque_unit: Mapping[str, Literal['N*m', 'A']] = field(default_factory=dict)
    power: Mapping[str, Literal['metered', 'computed']] = field(default_factory=dict)
    gear_ratio: Mapping[str, float] = field(default_factory=dict)
    steady: bool = False
    marks: Annotated[tuple[CardNote, ...], Length(0)] = ()
    other: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.drives:
            if not name or self.drives.count(name) > 1:
                raise InputError(f'drives: {quoted(name)} is empty or there twice')

    @property
    def drive_types(self) -> Mapping[str, str]:
        """Type of each measured drive: `HAA`, `HFE` or `KFE` of `LF_HAA`, else the whole name."""
        ends = {name: name.rsplit('_', 1)[-1].upper() for name in self.drives}
        return {name: end if end in DRIVE_TYPES else name for name, end in ends.items()}

    @property
    def imported(self) -> Mapping[str, Any]:
        """Notes of an import: from, map, columns, units, scales, positive, velocity, formulas."""
        found = self.other.get('imported')
        return found if isinstance(found, Mapping) else {}

    def column(self, drive: str, quantity: str) -> str:
        """Return ` (column 'NAME')` with an imported signal's name in the log; '' if unknown."""
        name = (self._noted('columns', drive) or {}).get(quantity)
        return f' (column {quoted(name)})' if isinstance(name, str) else ''

    def lacks(self, drive: str, quantity: str) -> bool:
        """Return whether the recording was imported without a column for a drive's quantity."""
        columns = self._noted('columns', drive)
        derived = quantity == 'velocity' and drive in self.derived_velocity
        return columns is not None and quantity not in columns and not derived

    def unit_of(self, drive: str, quantity: str) -> str:
        """Return the unit of an imported signal in the log, '' if unknown, `other` of no name.

        drive: '' for the supply; of a quantity that the supply does not have, for all drives.
        """
        found = self._all('units', drive, quantity)
        return str(found.pop()) if len(found) == 1 else 'other' if found else ''

    def scaled(self, drive: str, quantity: str, factor: float) -> str:
        """Return the line of an import map that multiplies a signal once more; '': of all."""
        found = self._all('scales', drive, quantity)
        given = found.pop() if len(found) == 1 else 1.0
        size = factor * given if isinstance(given, float) else factor
        return f'{quantity}: {{scale: {size:.4g}}}'

    def metered(self, drive: str) -> str:
        """Return what a drive's power is known by: `current`, `power`, or '' of an efficiency.

        drive: '' for the supply.
        """
        noted = self._noted('positive', drive)
        known = ('current', 'power')
        return 'current' if noted is None else next((q for q in known if q in noted), '')

    def turned_meter(self, drive: str) -> str:
        """Return the line of an import map that turns the sign of a drive's meter; '': of all."""
        quantity = self.metered(drive) or 'current'
        sign = (self._noted('positive', drive) or {}).get(quantity)
        line = f'{quantity}: {{positive: {"drawn" if sign == "fed" else "fed"}}}'
        return line if drive else f'supply: {{{line}}}'

    def _by_drive(self, what: str) -> Mapping[str, Any]:
        found = self.imported.get(what)
        return found if isinstance(found, Mapping) else {}

    def _all(self, what: str, drive: str, quantity: str) -> set[Any]:
        drives = [drive] if drive else self._by_drive(what)
        noted = [self._noted(what, name) or {} for name in drives]
        return {own[quantity] for own in noted if quantity in own}

    def _noted(self, what: str, drive: str) -> Mapping[str, Any] | None:
        named = self._by_drive(what).get(drive)
        return named if isinstance(named, Mapping) else None

    def formula(self, drive: str) -> str:
        """Return the formula by which a drive's power was computed; '' where none is known."""
        return str(self._by_drive('formulas').get(drive, ''))

    @property
    def derived_velocity(self) -> tuple[str, ...]:
        """Drives whose velocity an import computed by differentiating their position."""
        return tuple(map(str, self._by_drive('velocity')))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a card from its file or from the folder of its recording.

        Raises InputError if there is none, it is not plain YAML, or a value has a wrong type.
        """
        file = path / FILE if path.is_dir() else path
        return cls.of(read_yaml(file, 'card'), f'card {file}')

    @classmethod
    def parse(cls, text: str, where: str) -> Self:
        """Read a card from YAML; errors are as of `load` and begin with `where`."""
        return cls.of(parse_yaml(text, where), where)

    @classmethod
    def of_source(
        cls, torque: Mapping[str, str], torque_unit: Mapping[str, str], derived: Sequence[str] = ()
    ) -> Self:
        """Build the card of one data source, such as a CAN bus, from facts on its drives.

        torque (`joint` or `motor`) and torque_unit (`A` or `N*m`) are by drive; derived: drives
        whose velocity is differentiated from their position.
        """
        card = cls.of({'torque': dict(torque), 'torque_unit': dict(torque_unit)})
        return card.with_derived_velocity(derived)

    @classmethod
    def of(cls, content: Mapping[str, Any] | None, where: str = 'card') -> Self:
        """Build a card from the content of its file; None gives an empty card.

        Numbers and dates become text where text is expected. Raises InputError, which begins with
        `where`, for a value of a wrong type.
        """
        content = {} if content is None else content
        if not isinstance(content, Mapping):
            return parse(cls, content, where)
        names = {f.name for f in fields(cls)} - {'other'}  # type: ignore[arg-type]
        known = {key: content[key] for key in names & content.keys() if content[key] is not None}
        for key in known.keys() & set(_TEXTS):
            if isinstance(known[key], _PLAIN) and not isinstance(known[key], bool):
                known[key] = str(known[key])
        other = {key: value for key, value in content.items() if key not in names}
        return replace(parse(cls, known, where), other=other)

    def with_formulas(self, formulas: Mapping[str, str]) -> Self:
        """Return a card with new power formulas by drive, and these drives' power as `computed`.

        The formulas replace all former ones; without any, the card is returned unchanged.
        """
        if not formulas:
            return self
        power = {**self.power, **dict.fromkeys(formulas, _COMPUTED)}
        imported = {**self.imported, 'formulas': dict(formulas)}
        return replace(self, power=power, other={**self.other, 'imported': imported})

    def with_derived_velocity(self, drives: Sequence[str]) -> Self:
        """Return a card with drives whose velocity is differentiated; unchanged if imported."""
        if not drives or 'imported' in self.other:
            return self
        velocity = {'velocity': dict.fromkeys(drives, 'rate of position')}
        return replace(self, other={**self.other, 'imported': velocity})

    def with_mark(self, stamp_ns: int, text: str) -> Self:
        """Return a card with one more mark: `text` at ROS time stamp_ns [ns]."""
        when = datetime.datetime.fromtimestamp(stamp_ns / 1e9, datetime.UTC)
        mark = CardNote(when.isoformat(timespec='milliseconds'), text)
        return replace(self, marks=(*self.marks, mark))

    def text(self) -> str:
        """Return the card as YAML."""
        content = {f.name: getattr(self, f.name) for f in fields(self) if f.name != 'other'}
        content |= {'drives': list(self.drives), 'marks': [asdict(mark) for mark in self.marks]}
        for name in ('torque', 'torque_unit', 'marks'):
            if not content[name]:
                del content[name]
        return dump_yaml({**content, **self.other})

    def save(self, bag_dir: Path) -> Path:
        """Write card.yaml into a recording's folder, whole or not at all, and return its path."""
        write_whole(Path(bag_dir) / FILE, self.text())
        return Path(bag_dir) / FILE
