"""YAML files in which every value knows its place, for errors that name it."""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from wattwalk_core.errors import InputError


class _UniqueKeys(yaml.SafeLoader):
    """YAML in which a repeated key is an error instead of the last one winning."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                mark = node.start_mark
                raise yaml.constructor.ConstructorError(
                    'a mapping', mark, f'key {key!r} is there twice', mark
                )
        return super().construct_mapping(node, deep)


def read_entry(path: Path, kind: str) -> 'Entry':
    """Content of a file of a kind, such as a mapping; InputError if it cannot be read."""
    try:
        with path.open(encoding='utf-8') as file:
            return Entry(kind, str(path), yaml.load(file, _UniqueKeys))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'cannot read {kind} {path}: {error}') from error
    except yaml.YAMLError as error:
        reason = ' '.join(str(error).split())
        raise InputError(f'{kind} {path} is no valid YAML: {reason}') from error


@dataclass(frozen=True)
class Entry:
    """A value of a file with its place; its methods raise InputError that names both."""

    kind: str
    where: str
    value: Any

    def error(self, text: str) -> InputError:
        """An error about this value."""
        return InputError(f'{self.kind} {self.where}: {text}')

    def __contains__(self, key: str) -> bool:
        if not isinstance(self.value, dict):
            raise self.error(f'expected keys with values, there is {self.value!r}')
        return key in self.value

    def allow(self, keys: Sequence[str]) -> None:
        """Refuse keys other than these."""
        if not isinstance(self.value, dict):
            raise self.error(f'expected keys with values, there is {self.value!r}')
        unknown = [key for key in self.value if key not in keys]
        if unknown:
            raise self.error(f'unknown key {unknown[0]!r}; there can be {", ".join(keys)}')

    def child(self, key: str) -> 'Entry':
        """Value of a key that must be there."""
        if key not in self:
            there = ', '.join(map(str, self.value)) or 'nothing'
            raise self.error(f'{key!r} is missing; there is {there}')
        return Entry(self.kind, f'{self.where}: {key}', self.value[key])

    def text(self, key: str) -> str:
        """A name that is not empty."""
        value = self.child(key).value
        if not isinstance(value, str) or not value:
            raise self.child(key).error(f'expected a name, there is {value!r}')
        return value

    def number(
        self, key: str, low: float, high: float, unit: str, default: float | None = None
    ) -> float:
        """A number from low to high; the default, if there is one, where the key is absent."""
        if default is not None and key not in self:
            return default
        entry = self.child(key)
        value = entry.value
        real = isinstance(value, int | float) and not isinstance(value, bool)
        if not real or not low <= value <= high:
            raise entry.error(
                f'expected {low:g} to {high:g} {unit}'.rstrip() + f', there is {value!r}'
            )
        return float(value)

    def whole(self, key: str, low: int, high: int) -> int:
        """An integer from low to high."""
        entry = self.child(key)
        value = entry.value
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise entry.error(f'expected an integer from {low} to {high}, there is {value!r}')
        return value

    def rows(self, key: str) -> Iterator['Entry']:
        """Values of a list that is not empty."""
        rows = self.child(key)
        if not isinstance(rows.value, list) or not rows.value:
            raise rows.error(f'expected a list, there is {rows.value!r}')
        for index, row in enumerate(rows.value):
            yield Entry(self.kind, f'{rows.where}[{index}]', row)
