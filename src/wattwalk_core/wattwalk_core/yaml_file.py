"""YAML files of others, read within limits.

Only plain YAML is accepted: no tags, no aliases or merge keys (which let half a kilobyte unfold
to gigabytes), no repeated keys, at most DEPTH levels, numbers of at most DIGITS digits, and a
bounded size. Everything else is an InputError of one line.
"""

from collections.abc import Hashable
from pathlib import Path
from typing import Any, Final

import yaml
from yaml.composer import Composer

from wattwalk_core.errors import InputError, printable, quoted
from wattwalk_core.files import read_bytes

SIZE: Final = 1 << 20  # bytes
DEPTH: Final = 32
DIGITS: Final = 30


class _Refused(yaml.YAMLError):
    """YAML that is valid but beyond the limits."""


class _PlainLoader(Composer, yaml.CSafeLoader):
    """Constructs plain values only, within the limits of this module.

    The parser is that of libyaml, five times as fast as the one in Python.
    """

    depth = 0

    def __init__(self, stream: str) -> None:
        yaml.CSafeLoader.__init__(self, stream)
        Composer.__init__(self)

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise _Refused(f'line {self._line()}: aliases (*name) are not allowed')
        tag = getattr(self.peek_event(), 'tag', None)
        if tag is not None:
            tag = tag.replace('tag:yaml.org,2002:', '!!')
            raise _Refused(f'line {self._line()}: tags ({printable(tag, 30)}) are not allowed')
        self.depth += 1
        if self.depth > DEPTH:
            raise _Refused(f'line {self._line()}: more than {DEPTH} levels')
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def _line(self) -> int:
        event: Any = self.peek_event()
        return int(event.start_mark.line) + 1

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key_node, _ in node.value:
            line = key_node.start_mark.line + 1
            if key_node.tag == 'tag:yaml.org,2002:merge':
                raise _Refused(f'line {line}: merge keys (<<) are not allowed')
            key = self.construct_object(key_node, deep=True)  # type: ignore[no-untyped-call]
            if not isinstance(key, Hashable):
                raise _Refused(f'line {line}: a key is a list or a mapping')
            if key in seen:
                raise _Refused(f'line {line}: key {quoted(key)} is there twice')
            seen.add(key)
        return super().construct_mapping(node, deep)

    def _number(self, node: yaml.ScalarNode) -> Any:
        if len(node.value) > DIGITS:
            line = node.start_mark.line + 1
            raise _Refused(f'line {line}: a number of {len(node.value)} digits')
        if node.tag.endswith(':int'):
            return self.construct_yaml_int(node)  # type: ignore[no-untyped-call]
        return self.construct_yaml_float(node)  # type: ignore[no-untyped-call]


for _tag in ('int', 'float'):
    _PlainLoader.add_constructor(f'tag:yaml.org,2002:{_tag}', _PlainLoader._number)


def read_text(path: Path, what: str, limit: int = SIZE) -> str:
    """Read a UTF-8 file of `limit` bytes at most; InputError, called `what` there, for others."""
    try:
        return read_bytes(path, what, limit).decode()
    except UnicodeDecodeError as error:
        raise InputError(f'{what} {path}: not UTF-8 text (byte {error.start})') from None


def parse_yaml(text: str, where: str) -> Any:
    """Parse plain YAML; InputError, which begins with `where`, for anything else."""
    try:
        return yaml.load(text, _PlainLoader)
    except (_Refused, yaml.reader.ReaderError) as error:
        raise InputError(f'{where}: {printable(str(error))}') from None
    except yaml.MarkedYAMLError as error:
        line = f'line {error.problem_mark.line + 1}: ' if error.problem_mark else ''
        raise InputError(f'{where} is no valid YAML: {line}{printable(str(error.problem))}') from (
            None
        )
    except (ValueError, RecursionError) as error:
        raise InputError(f'{where} is no valid YAML: {printable(str(error))}') from None


def read_yaml(path: Path, what: str, limit: int = SIZE) -> Any:
    """Read a file of plain YAML; InputError, which calls it `what`, for any other."""
    return parse_yaml(read_text(path, what, limit), f'{what} {path}')


class _PlainDumper(yaml.SafeDumper):
    """Writes what `parse_yaml` reads: a value that occurs twice is written twice."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def dump_yaml(content: Any, *, short_lists: bool = False) -> str:
    """Return content as plain YAML in the order of its keys; short_lists: one line per list."""
    style = None if short_lists else False
    return yaml.dump(  # type: ignore[no-any-return]
        content, Dumper=_PlainDumper, sort_keys=False, allow_unicode=True, default_flow_style=style
    )


def shipped_file(source: Path | str, folder: Path, what: str) -> Path:
    """Return `source` as a path or, where it is a bare name without a file, folder/SOURCE.yaml.

    what: noun for the message. InputError, with the names in the folder, if the file is not there.
    """
    path = Path(source)
    if not path.suffix and not path.exists():
        path = folder / f'{source}.yaml'
    if not path.exists():
        names = ', '.join(sorted(item.stem for item in folder.glob('*.yaml')))
        raise InputError(f'no {what} {quoted(str(source))}; give a file, or one of {names}')
    return path
