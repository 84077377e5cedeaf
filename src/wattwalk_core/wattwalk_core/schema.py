"""Configuration as frozen dataclasses, checked field by field when it is read.

A class decorated with `schema` is an ordinary frozen dataclass. `parse` and `read` build it from
YAML content by its annotations (pydantic does the work and is imported only then). Errors are one
line: file, entry, value, and what is allowed.

    @schema
    class Meter:
        bits: Annotated[int, Quantity(6, 24, 'bit', 'of the converter')] = 16

    read(Meter, Path('meter.yaml'), 'meter')
"""

import dataclasses
import json
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, dataclass_transform

from wattwalk_core.errors import InputError, printable, quoted
from wattwalk_core.yaml_file import read_yaml

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler as Handler  # slow to import
    from pydantic import TypeAdapter  # slow to import
    from pydantic_core import CoreSchema, ErrorDetails  # slow to import

T = TypeVar('T')

_EXPECTED = {
    'string_type': 'text',
    'bool_type': 'true or false',
    'int_type': 'a whole number',
    'float_type': 'a number',
    'finite_number': 'a finite number',
    'list_type': 'a list',
    'tuple_type': 'a list',
    'dict_type': 'keys with values',
    'dataclass_type': 'keys with values',
    'none_required': 'nothing',
}


@dataclass_transform(frozen_default=True)
def schema(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass that `parse` reads; keys it does not have are refused.

    A class variable RENAMED maps former keys, which are still read, to present ones. An
    InputError of `__post_init__` gets the place of the entry.
    """
    check_fields = cls.__dict__.get('__post_init__')
    if check_fields is not None:
        cls.__post_init__ = _with_place(check_fields)  # type: ignore[attr-defined]
    former = {new: old for old, new in getattr(cls, 'RENAMED', {}).items()}
    cls.__pydantic_config__ = {  # type: ignore[attr-defined]
        'extra': 'forbid',
        'allow_inf_nan': False,
        'alias_generator': lambda name: former.get(name, name),
        'validate_by_name': True,
        'loc_by_alias': False,
    }
    return dataclass(frozen=True)(cls)


class EntryError(InputError, ValueError):
    """InputError of one entry, whose place `parse` adds: pydantic does so to a ValueError."""


def _with_place(check_fields: Callable[[Any], None]) -> Callable[[Any], None]:
    @wraps(check_fields)
    def wrapped(self: Any) -> None:
        try:
            check_fields(self)
        except InputError as error:
            raise EntryError(str(error)) from error

    return wrapped


@dataclass(frozen=True)
class Quantity:
    """Range, unit and meaning of a number, as an annotation of its field."""

    low: float
    high: float
    unit: str = ''
    text: str = ''

    def check(self, value: object, kind: type = float) -> float | int:
        """Return the value as `kind`, float or int; ValueError with the range for all else."""
        if isinstance(value, int | float) and not isinstance(value, bool):
            is_sound = kind is not int or float(value).is_integer()
            if is_sound and self.low <= value <= self.high:
                return kind(value)  # type: ignore[no-any-return]
        whole = 'a whole number from ' if kind is int else ''
        limits = f'{whole}{self.low:g} to {self.high:g} {self.unit}'.rstrip()
        raise ValueError(f'expected {limits}, there is {quoted(value)}')

    def __get_pydantic_core_schema__(self, source: Any, handler: 'Handler') -> 'CoreSchema':
        from pydantic_core import PydanticCustomError, core_schema  # slow to import

        kind = int if source is int else float

        def check(value: object) -> float | int:
            try:
                return self.check(value, kind)
            except ValueError as error:
                raise PydanticCustomError('quantity', '{text}', {'text': str(error)}) from None

        return core_schema.no_info_plain_validator_function(check)


@dataclass(frozen=True)
class Length:
    """Least number of characters of a text or items of a list, as an annotation of its field."""

    least: int

    def __get_pydantic_core_schema__(self, source: Any, handler: 'Handler') -> 'CoreSchema':
        return {**handler(source), 'min_length': self.least}  # type: ignore[return-value]


@dataclass(frozen=True)
class Printable:
    """A text of printable characters, of a length from `least` to `most`, as an annotation."""

    least: int = 1
    most: int = 200

    def __get_pydantic_core_schema__(self, source: Any, handler: 'Handler') -> 'CoreSchema':
        from pydantic_core import PydanticCustomError, core_schema  # slow to import

        def check(value: str) -> str:
            if self.least <= len(value) <= self.most and value.isprintable():
                return value
            text = (
                f'expected a name of {self.least} to {self.most} printable characters, there is '
                f'{quoted(value)}'
            )
            raise PydanticCustomError('quantity', '{text}', {'text': text})

        return core_schema.no_info_after_validator_function(check, handler(source))


Name = Annotated[str, Printable()]  # text that is not empty, is not long and may go to a terminal


def parse(kind: type[T], content: object, where: str) -> T:
    """Build a schema class from the content of a file or message.

    kind: a class decorated with `schema`, or a type made of such, as `dict[str, Drive]`.
    where: prefix of error messages, such as `plant lab.yaml`. Raises InputError.
    """
    from pydantic import ValidationError  # slow to import, and parsers import this file

    try:
        # JSON's strict mode takes lists for tuples, but no text for numbers nor 1 for true.
        data = json.dumps(content)
    except (TypeError, ValueError):
        data = json.dumps(_plain(content))
    try:
        return _adapter(kind).validate_json(data, strict=True)  # type: ignore[no-any-return, arg-type]
    except ValidationError as error:
        details = min(error.errors(), key=lambda e: e['type'] == 'missing')
        raise InputError(f'{where}: {_describe(kind, details)}') from None
    except InputError as error:
        raise InputError(f'{where}: {error}') from None


def read(kind: type[T], path: Path, what: str) -> T:
    """Read a YAML file, in errors called `what`, into a schema class; InputError if it is bad."""
    return parse(kind, read_yaml(path, what), f'{what} {path}')


def check(item: object, where: str) -> None:
    """Check an instance made by code; InputError, after `where`, for the first invalid field."""
    parse(type(item), dataclasses.asdict(item), where)  # type: ignore[call-overload]


class CheckedFields:
    """Base of dataclasses whose fields with a Quantity are checked on creation; InputError."""

    def __post_init__(self) -> None:
        own: Any = self.__class__
        for name, (kind, quantity) in _quantities(own).items():
            try:
                object.__setattr__(self, name, quantity.check(getattr(self, name), kind))
            except ValueError as error:
                raise InputError(f'{name}: {error}') from None


@lru_cache
def _quantities(cls: type) -> dict[str, tuple[type, Quantity]]:
    """Type and Quantity of each field that is annotated with one."""
    return {
        name: (hint.__origin__, note)
        for name, hint in typing.get_type_hints(cls, include_extras=True).items()
        for note in getattr(hint, '__metadata__', ())
        if isinstance(note, Quantity)
    }


@lru_cache
def _adapter(kind: Any) -> 'TypeAdapter[Any]':
    from pydantic import TypeAdapter  # slow to import, and parsers import this file

    return TypeAdapter(kind)


def _plain(value: object) -> object:
    """Content with keys and values that JSON knows; dates and the like become text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence | set) and not isinstance(value, str | bytes):
        return [_plain(item) for item in value]
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def _describe(kind: Any, error: 'ErrorDetails') -> str:
    """One line about an error: its entry, the expected value, and the given one."""
    path, name = error['loc'], error['type']
    if name in ('missing', 'unexpected_keyword_argument', 'extra_forbidden'):
        place, key = _place(path[:-1]), path[-1]
        if name == 'missing' and isinstance(key, int):
            return f'{place}expected more values, there are {len(error["input"])}'
        if name == 'missing':
            there = printable(', '.join(error['input'] or ('nothing',)))
            return f'{place}{quoted(key)} is missing; there is {there}'
        found = _class_at(kind, path[:-1])
        known = [item.name for item in dataclasses.fields(found)] if found else []
        if key in known:
            return f'{place}{quoted(key)} is there twice, once by its former name'
        there = f'; there can be {", ".join(known)}' if known else ''
        return f'{place}unknown key {quoted(key)}{there}'
    place = _place(path)
    context = error.get('ctx', {})
    if name == 'quantity':
        return f'{place}{error["msg"]}'
    if name == 'value_error':
        return f'{place}{context["error"]}'
    if name in ('too_short', 'too_long'):
        bound = 'least' if name == 'too_short' else 'most'
        length = context.get('min_length', context.get('max_length'))
        return f'{place}expected at {bound} {length} values, there are {context["actual_length"]}'
    wanted = context['expected'] if name == 'literal_error' else _EXPECTED.get(name)
    said = f'expected {wanted}' if wanted else f'{error["msg"][:1].lower()}{error["msg"][1:]}'
    return f'{place}{said}, there is {quoted(error["input"])}'


def _place(path: Iterable[int | str]) -> str:
    text = ''
    for part in path:
        text += f'[{part}]' if isinstance(part, int) else f'.{part}' if text else str(part)
    return f'{text}: ' if text else ''


def _class_at(kind: Any, path: Sequence[int | str]) -> Any:
    """The dataclass at a place of a type, None where that is not one class."""
    while typing.get_origin(kind) is typing.Annotated:
        kind = typing.get_args(kind)[0]
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        kinds = [k for k in typing.get_args(kind) if k is not type(None)]
        return _class_at(kinds[0], path) if len(kinds) == 1 else None
    if not path:
        return kind if dataclasses.is_dataclass(kind) else None
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind, include_extras=True)
        return _class_at(hints[path[0]], path[1:]) if path[0] in hints else None
    arguments = [a for a in typing.get_args(kind) if a is not Ellipsis]
    return _class_at(arguments[-1], path[1:]) if arguments else None
