"""The card of a recording: what was measured, on what, and under which conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self

import yaml
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

FILE = 'card.yaml'
DRIVE_TYPES = ('HAA', 'HFE', 'KFE')
_TEXTS = ('robot', 'unit', 'controller', 'terrain', 'notes', 'software', 'calibration', 'created')


def drive_type(name: str) -> str:
    """`HAA`, `HFE` or `KFE` for a drive named `LF_HAA` and so on; else the whole name."""
    suffix = name.rsplit('_', 1)[-1].upper()
    return suffix if suffix in DRIVE_TYPES else name


@dataclass(frozen=True)
class Card:
    """
    `card.yaml` in the folder of a recording.

    Texts may stay empty. `drives` are those whose electrical power was measured. `created` is a
    date in ISO 8601 and `seed` belongs to a simulation. Keys this class does not know are kept in
    `other`. Raises InputError for values of another kind.
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
    other: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in _TEXTS:
            if not isinstance(getattr(self, name), str):
                raise InputError(f'card: {name} is {getattr(self, name)!r}; expected text')
        if isinstance(self.drives, str) or not all(isinstance(d, str) and d for d in self.drives):
            raise InputError(f'card: drives is {self.drives!r}; expected a list of names')
        if len(set(self.drives)) != len(self.drives):
            raise InputError(f'card: drives names one drive twice: {", ".join(self.drives)}')
        if self.seed is not None and (
            isinstance(self.seed, bool) or not isinstance(self.seed, int)
        ):
            raise InputError(f'card: seed is {self.seed!r}; expected a whole number')
        object.__setattr__(self, 'drives', tuple(self.drives))

    @property
    def drive_types(self) -> Mapping[str, str]:
        """The type of each measured drive, by its name."""
        return {name: drive_type(name) for name in self.drives}

    @classmethod
    def load(cls, path: Path) -> Self:
        """
        Read a card from its file or from the folder of its recording.

        Raises InputError if there is none, if it does not parse, or for values of another kind.
        """
        file = path / FILE if path.is_dir() else path
        try:
            content = yaml.safe_load(file.read_text(encoding='utf-8'))
        except OSError as error:
            raise InputError(f'cannot read {file}: {error.strerror}') from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            line = ' '.join(str(error).split())
            raise InputError(f'{file} is not YAML: {line}') from error
        if content is None:
            content = {}
        if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
            raise InputError(f'{file} holds {content!r:.60}; expected keys and values')
        try:
            return cls.of(content)
        except InputError as error:
            raise InputError(f'{file}: {error}') from error

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Self:
        """A card from keys and values as in the file."""
        known = {f.name for f in fields(cls)} - {'other'}
        values = {key: content[key] for key in content if key in known}
        values |= {key: str(values[key]) for key in _TEXTS if _is_plain(values.get(key))}
        if isinstance(values.get('drives'), Sequence) and not isinstance(values['drives'], str):
            values['drives'] = tuple(values['drives'])
        other = {key: content[key] for key in content if key not in known}
        return cls(
            **{key: value for key, value in values.items() if value is not None}, other=other
        )

    def with_drives(self, measured: Sequence[str]) -> Self:
        """The card with the drives that were measured, unless it names some already."""
        return self if self.drives else replace(self, drives=tuple(measured))

    def with_calibration(self, applied: str) -> Self:
        """The card with the calibration that was applied, unless it names one already."""
        return self if self.calibration else replace(self, calibration=applied)

    def save(self, bag_dir: Path) -> Path:
        """Write card.yaml into a recording's folder, whole or not at all; return its path."""
        content = {f.name: getattr(self, f.name) for f in fields(self) if f.name != 'other'}
        content['drives'] = list(self.drives)
        text = yaml.safe_dump({**content, **self.other}, sort_keys=False, allow_unicode=True)
        write_whole(Path(bag_dir) / FILE, text)
        return Path(bag_dir) / FILE


def _is_plain(value: object) -> bool:
    """Whether YAML read a number or date where text was meant, as in `unit: 3`."""
    return value is not None and not isinstance(value, (str, Sequence, Mapping, bool))
