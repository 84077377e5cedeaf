"""Frozen dataclasses whose numbers carry a unit and an allowed range, read from mappings."""

from collections.abc import Mapping
from dataclasses import MISSING, Field, field, fields
from pathlib import Path
from typing import Any, TypeVar

import yaml
from wattwalk_core.errors import InputError

T = TypeVar('T')


def bounded(default: float, low: float, high: float, unit: str, text: str) -> Any:
    """A field for a number in low..high, in a unit, with a line that says what it is."""
    return field(default=default, metadata={'low': low, 'high': high, 'unit': unit, 'text': text})


def check(item: Any, where: str) -> None:
    """Raise InputError for the first bounded field of a dataclass that is out of its range."""
    for entry in fields(item):
        if 'low' in entry.metadata:
            _check_number(getattr(item, entry.name), entry, f'{where}.{entry.name}')


def _check_number(value: object, entry: Field[Any], where: str) -> None:
    low, high, unit = (entry.metadata[key] for key in ('low', 'high', 'unit'))
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not low <= value <= high:  # type: ignore[operator]
        raise InputError(f'{where} is {value!r}; it must lie in {low:g}..{high:g} {unit}'.rstrip())


def read_named(source: Path | str, shipped: Path, what: str) -> object:
    """
    Content of a YAML file, or of a shipped one by name.

    InputError names what could not be read and what is shipped.
    """
    path = Path(source)
    if not path.suffix and not path.exists():
        path = shipped / f'{source}.yaml'
    try:
        return yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        names = ', '.join(sorted(item.stem for item in shipped.glob('*.yaml')))
        raise InputError(
            f'cannot read {what} {str(source)!r} ({error.strerror}); shipped are {names}'
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f'{what} {str(source)!r} is no YAML: {error}'.split('\n')[0]) from error


def from_mapping(kind: type[T], values: object, where: str) -> T:
    """
    Build a dataclass of numbers and booleans from a mapping; what is absent keeps its default.

    InputError for a value that is no mapping, or a key that the dataclass does not have.
    """
    if not isinstance(values, Mapping):
        raise InputError(f'{where} is {values!r}; it must be a mapping')
    known = {entry.name: entry for entry in fields(kind)}  # type: ignore[arg-type]
    for key in values:
        if key not in known:
            raise InputError(f'{where} has no {key!r}; there are {", ".join(known)}')
    for name, entry in known.items():
        if name not in values and entry.default is MISSING and entry.default_factory is MISSING:
            raise InputError(f'{where} lacks {name!r}')
    return kind(**values)
