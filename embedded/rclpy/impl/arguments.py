"""Arguments between --ros-args and --: remappings, parameters, parameter files, log levels."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from rclpy._rclpy_pybind11 import RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
)

SUBSTITUTION = re.compile(r'\{([^{}]*)\}')


# What is wrong with a name: a pattern, how far behind the start of its match, and rcl's words.
Rules = tuple[tuple[str, int, str], ...]
NODE_NAME: Rules = (
    (r'\A\Z', 0, 'node name must not be empty'),
    (r'[^A-Za-z0-9_]', 0, "node name must not contain characters other than alphanumerics or '_'"),
    (r'\A[0-9]', 0, 'node name must not start with a number'),
)
FULL_NAME: Rules = (
    (r'\A\Z', 0, '{} must not be empty'),
    (r'\A[^/]', 0, "{} must be absolute, it must lead with a '/'"),
    (r'/\Z', 0, "{} must not end with a '/'"),
    (r'[^A-Za-z0-9_/]', 0, "{} must not contain characters other than alphanumerics, '_', or '/'"),
    (r'//', 1, "{} must not contain repeated '/'"),
    (r'/[0-9]', 1, '{} must not have a token that starts with a number'),
)
TOPIC_NAME: Rules = (
    (r'\A\Z', 0, 'topic name must not be empty string'),
    (r'\A[0-9]', 0, 'topic name token must not start with a number'),
    (r'/\Z', 0, 'topic name must not end with a forward slash'),
    (r'[{}]', 0, "topic name must not have unmatched (unbalanced) curly braces '{}'"),
    (
        r'[^A-Za-z0-9_/~]',
        0,
        "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'",
    ),
    (r'(?<=.)~', 0, "topic name must not have tilde '~' unless it is the first character"),
    (
        r'\A~[^/]',
        1,
        "topic name must not have a tilde '~' that is not followed by a forward slash '/'",
    ),
    (r'//', 1, "topic name must not contain repeated '/'"),
    (r'/[0-9]', 1, 'topic name token must not start with a number'),
)


def _check(name: str, rules: Rules, error: Any, kind: str = '', given: str | None = None) -> None:
    """Raise an Invalid…NameException, of the name as given, for the first rule that is broken."""
    for pattern, offset, text in rules:
        if (match := re.search(pattern, name)) is not None:
            words = text.format(kind) if kind else text
            raise error(name if given is None else given, words, match.start() + offset)


def validate_node_name(name: str) -> None:
    """Raise InvalidNodeNameException for an invalid node name."""
    _check(name, NODE_NAME, InvalidNodeNameException)


def validate_namespace(namespace: str) -> None:
    """Raise InvalidNamespaceException for an invalid namespace."""
    if namespace != '/':
        _check(namespace, FULL_NAME, InvalidNamespaceException, 'namespace')


def expand(name: str, node_name: str, namespace: str, is_service: bool = False) -> str:
    """Return the absolute form of a topic's or service's name, without remapping.

    InvalidTopicNameException or InvalidServiceNameException for an invalid name.
    """
    error = InvalidServiceNameException if is_service else InvalidTopicNameException
    plain = SUBSTITUTION.sub(lambda match: '_' * len(match[0]), name)
    _check(plain, TOPIC_NAME, error, given=name)
    base = '' if namespace == '/' else namespace
    known = {'node': node_name, 'ns': base, 'namespace': base}
    expanded = SUBSTITUTION.sub(lambda match: known.get(match[1], match[0]), name)
    if expanded.startswith('~'):
        expanded = f'{base}/{node_name}{expanded[1:]}'
    elif not expanded.startswith('/'):
        expanded = f'{base}/{expanded}'
    expanded = expanded.replace('//', '/')
    _check(expanded, FULL_NAME, error, 'topic name', name)
    return expanded


TRUE = frozenset(['Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'])
FALSE = frozenset(['N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'])
INTEGER = re.compile(r'[+-]?(?:0[xX][0-9a-fA-F]+|[0-9]+)')
SPECIAL = {'inf': float('inf'), 'nan': float('nan')}
FLOAT = re.compile(r'[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?')


class YamlError(ValueError):
    """Raised for text that is no valid parameter value or file; the message says why."""


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
    """Parse the value of a parameter given as `name:=text`; YamlError if invalid."""
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


FLAGS = (
    *('-r', '--remap', '-p', '--param', '--params-file', '--log-level', '-e', '--enclave'),
    *('--log-config-file', '--log-file-name'),
)
"""Flags with a value; those of the last line have no effect."""
FLAGS_WITHOUT_VALUE = re.compile(r'--(?:enable|disable)-(?:rosout|stdout|external-lib)-logs?')
NODE_PREFIX = re.compile(r'([A-Za-z_][A-Za-z0-9_]*|\*{1,2}|/[A-Za-z0-9_/*]*):(?!=)(.*)', re.DOTALL)


@dataclass(frozen=True)
class Remap:
    """One rule `[node:]source:=target`."""

    node: str | None
    source: str
    target: str


@dataclass
class RosArguments:
    """The ROS arguments of a process or of a node."""

    remaps: list[Remap] = field(default_factory=list)
    parameters: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    log_levels: dict[str, str] = field(default_factory=dict)
    enclave: str = '/'

    def node_name(self, name: str) -> str:
        """Return a node's name after remapping."""
        return self._target(('__node', '__name'), name, name)

    def namespace(self, name: str, namespace: str) -> str:
        """Return a node's namespace after remapping; name, namespace: those before."""
        return self._target(('__ns',), name, namespace)

    def _target(self, sources: tuple[str, ...], node: str, default: str) -> str:
        known = (r for r in self.remaps if r.source in sources and r.node in (None, node))
        return next((rule.target for rule in known), default)

    def topic(self, absolute: str, node: str, namespace: str, is_service: bool) -> str:
        """Return the absolute name after remapping of a topic or service of a node."""
        scheme = 'rosservice://' if is_service else 'rostopic://'
        for rule in self.remaps:
            source = rule.source.removeprefix(scheme)
            if source.startswith(('__', 'rostopic:', 'rosservice:')):
                continue
            if rule.node in (None, node) and expand(source, node, namespace) == absolute:
                return expand(rule.target, node, namespace, is_service)
        return absolute

    def overrides(self, fully_qualified_name: str) -> dict[str, Any]:
        """Return the parameter values given for a node; later ones win."""
        values: dict[str, Any] = {}
        for pattern, given in self.parameters:
            if _matches(pattern, fully_qualified_name):
                values |= given
        return values


def _matches(pattern: str, node: str) -> bool:
    if pattern in ('/**', '**'):
        return True
    absolute = pattern if pattern.startswith('/') else f'/{pattern}'
    if '*' not in absolute:
        return absolute == node
    parts = re.split(r'(\*\*|\*)', absolute)
    wild = {'**': '.*', '*': '[^/]*'}
    expression = ''.join(wild.get(part, re.escape(part)) for part in parts)
    return re.fullmatch(expression.replace('/.*/', '/(?:.*/)?'), node) is not None


def split(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split a command line into arguments outside and inside --ros-args … --."""
    plain: list[str] = []
    ros: list[str] = []
    inside = False
    for argument in argv:
        if argument == '--ros-args':
            inside = True
        elif inside and argument == '--':
            inside = False
        else:
            (ros if inside else plain).append(argument)
    return plain, ros


def _rule(text: str, flag: str) -> tuple[str | None, str, str]:
    left, separator, target = text.partition(':=')
    if not separator or not left:
        raise RCLInvalidROSArgsError(
            f"Couldn't parse {flag} rule: '{flag} {text}'. It must look like 'name:=value'"
        )
    node = None
    if '://' not in left.partition(':=')[0] and (match := NODE_PREFIX.fullmatch(left)):
        node, left = match[1], match[2]
    return node, left, target


def parameters_of(path: str) -> list[tuple[str, dict[str, Any]]]:
    """Return pairs of node pattern and values of a ROS parameter file.

    Raises RCLInvalidROSArgsError if the file is absent or invalid.
    """
    try:
        node = _compose(Path(path).read_text(encoding='utf-8'))
        return [] if node is None else _nodes(node, '')
    except (OSError, UnicodeDecodeError, YamlError) as error:
        raise RCLInvalidROSArgsError(
            f"Couldn't parse params file: '--params-file {path}'. Error: {error}"
        ) from error


def parse(argv: Sequence[str]) -> RosArguments:
    """Read the ROS arguments of a command line.

    Raises UnknownROSArgsError or RCLInvalidROSArgsError, which quote the argument.
    """
    _, given = split(argv)
    result = RosArguments()
    remaining = iter(given)
    for flag in remaining:
        if FLAGS_WITHOUT_VALUE.fullmatch(flag):
            continue
        if flag not in FLAGS:
            raise UnknownROSArgsError([flag])
        text = next(remaining, None)
        if text is None:
            raise RCLInvalidROSArgsError(f"Couldn't parse trailing {flag} flag. No value found")
        match flag:
            case '-r' | '--remap':
                result.remaps.append(Remap(*_rule(text, '-r')))
            case '-p' | '--param':
                result.parameters.append(_parameter(text))
            case '--params-file':
                result.parameters += parameters_of(text)
            case '--log-level':
                name, level = _log_level(text)
                result.log_levels[name] = level
            case '-e' | '--enclave':
                result.enclave = text
    return result


def _parameter(text: str) -> tuple[str, dict[str, Any]]:
    node, name, value = _rule(text, '-p')
    try:
        return node or '/**', {name: parameter_value(value)}
    except YamlError as error:
        raise RCLInvalidROSArgsError(
            f"Couldn't parse parameter override rule: '-p {text}'. Error: {error}"
        ) from error


def _log_level(text: str) -> tuple[str, str]:
    name, _, level = text.rpartition(':=')
    if level.upper() not in ('UNSET', 'DEBUG', 'INFO', 'WARN', 'ERROR', 'FATAL'):
        raise RCLInvalidROSArgsError(
            f"Couldn't parse log level rule: '--log-level {text}'. "
            'It must be one of debug, info, warn, error, fatal'
        )
    return name, level
