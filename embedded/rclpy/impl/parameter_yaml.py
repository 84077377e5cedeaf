"""Parameter values in YAML as rcl reads them, which is not quite as YAML says."""

import re
from pathlib import Path
from typing import Any

import yaml

TRUE = frozenset(['Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'])
FALSE = frozenset(['N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'])
INTEGER = re.compile(r'[+-]?(?:0[xX][0-9a-fA-F]+|[0-9]+)')
SPECIAL = {'inf': float('inf'), 'nan': float('nan')}
FLOAT = re.compile(r'[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?')


class YamlError(ValueError):
    """Raised for what is no parameter value or no parameter file; the message says why."""


def _scalar(node: yaml.ScalarNode) -> bool | int | float | str:
    text: str = node.value
    if node.style in ("'", '"', '|', '>'):
        return text
    if text in TRUE or text in FALSE:
        return text in TRUE
    if INTEGER.fullmatch(text):
        octal = re.fullmatch(r'[+-]?0[0-7]+', text)
        return int(text, 8) if octal else int(text, 16 if 'x' in text.lower() else 10)
    if FLOAT.fullmatch(text):
        return float(text)
    bare = text.lower().lstrip('+-').removeprefix('.')
    if bare in SPECIAL:
        return -SPECIAL[bare] if text.startswith('-') else SPECIAL[bare]
    return text


def _value(node: yaml.Node) -> Any:
    if isinstance(node, yaml.ScalarNode):
        return _scalar(node)
    if not isinstance(node, yaml.SequenceNode):
        raise YamlError(f'expected a value or a list in line {node.start_mark.line + 1}')
    items = [_value(item) for item in node.value]
    if len({type(item) for item in items}) > 1:
        raise YamlError(f'Sequence should be of same type, got {items}')
    return items


def _compose(text: str) -> yaml.Node | None:
    try:
        return yaml.compose(text, yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise YamlError(' '.join(str(error).split())) from error


def parameter_value(text: str) -> Any:
    """Return the value that stands behind `name:=`."""
    node = _compose(text)
    if node is None:
        raise YamlError('there is no value')
    return _value(node)


def _below(node: yaml.MappingNode, prefix: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, child in node.value:
        name = f'{prefix}{key.value}'
        if isinstance(child, yaml.MappingNode):
            values |= _below(child, f'{name}.')
        else:
            values[name] = _value(child)
    return values


def _nodes(node: yaml.Node, name: str) -> list[tuple[str, dict[str, Any]]]:
    if not isinstance(node, yaml.MappingNode):
        raise YamlError(f"no 'ros__parameters' below '{name}'")
    entries: list[tuple[str, dict[str, Any]]] = []
    for key, child in node.value:
        if key.value != 'ros__parameters':
            entries += _nodes(
                child, f'{name}/{key.value}'.replace('//', '/') if name else key.value
            )
        elif isinstance(child, yaml.MappingNode):
            entries.append((name, _below(child, '')))
        else:
            raise YamlError(f"no parameters below '{name}'")
    return entries


def parameter_file(path: str) -> list[tuple[str, dict[str, Any]]]:
    """Return pairs of node pattern and values by name of a ROS parameter file."""
    try:
        node = _compose(Path(path).read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        raise YamlError(str(error)) from error
    return [] if node is None else _nodes(node, '')
