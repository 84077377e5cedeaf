"""Base of commands with verbs: parser, a node of their own, wait for discovery."""

import argparse
import os
import struct
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import yaml

from ros2cli.main import CommandError

QUIET = 0.3
PATIENCE = 5.0


class Verbs:
    """The verbs of a command, each with its arguments and a function."""

    def __init__(self, command: str, description: str):
        self._parser = argparse.ArgumentParser(f'ros2 {command}', description=description)
        self._verbs = self._parser.add_subparsers(metavar='verb', required=True)

    def add(
        self,
        name: str,
        function: Callable[[argparse.Namespace], int | None],
        text: str,
        example: str,
        *positional: str,
        spin_time: bool = False,
    ) -> argparse.ArgumentParser:
        """Add a verb that runs `function`, with help `text`; return its parser.

        positional: arguments of the verb that have to be given. spin_time: it looks for others.
        """
        verb = self._verbs.add_parser(
            name, help=text, description=text, epilog=f'Example: {example}'
        )
        verb.set_defaults(function=function)
        for argument in positional:
            verb.add_argument(argument)
        if spin_time:
            verb.add_argument(
                '--no-daemon', action='store_true', help='no effect: there is no daemon'
            )
            verb.add_argument(
                '--spin-time',
                type=float,
                metavar='SECONDS',
                help='how long to look for others (default: until nothing new comes for 0.3 s)',
            )
        return verb

    def run(self, argv: Sequence[str]) -> int:
        """Run the verb of a command line; without one, show the help."""
        if not argv:
            self._parser.print_help()
            return 0
        options = self._parser.parse_args(argv)
        return options.function(options) or 0


@contextmanager
def direct_node() -> Iterator[Any]:
    """Yield a hidden node; CommandError where it cannot start."""
    import rclpy  # slow to import
    from rclpy.node import Node

    try:
        rclpy.init(args=[])
        node = Node(f'_ros2cli_{os.getpid()}', start_parameter_services=False)
    except RuntimeError as error:
        raise CommandError(str(error)) from error
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def discover(node: Any, spin_time: float | None = None) -> None:
    """Wait until no new nodes or topics appear for 0.3 s, or for `spin_time` s."""
    graph = node.context.graph
    start = changed = time.monotonic()
    seen: Any = None
    limit = PATIENCE if spin_time is None else spin_time
    while (now := time.monotonic()) - start < limit:
        nodes = [
            (n.name, n.namespace, len(n.readers), len(n.writers)) for n in graph.participants()
        ]
        found = (nodes, len(graph.endpoints('reader')), len(graph.endpoints('writer')))
        if found != seen:
            seen, changed = found, now
        if spin_time is None and now - changed > QUIET and now - start > 2 * QUIET:
            return
        time.sleep(0.05)


def wait_until(condition: Callable[[], Any], timeout: float) -> Any:
    """Wait until a condition gives something true, at most `timeout` [s]; return what it gave."""
    end = time.monotonic() + timeout
    while not (found := condition()) and time.monotonic() <= end:
        time.sleep(0.02)
    return found


def to_plain(value: Any) -> Any:
    """Return a message as dictionaries, lists and numbers."""
    if hasattr(value, 'get_fields_and_field_types'):
        names = value.get_fields_and_field_types()
        return {name: to_plain(getattr(value, name)) for name in names}
    if isinstance(value, np.ndarray | array):
        return value.tolist()
    if isinstance(value, bytes) and len(value) == 1:
        return value[0]
    return [to_plain(item) for item in value] if isinstance(value, list) else value


def to_yaml(value: Any) -> str:
    """Return a message as YAML."""
    plain = to_plain(value)
    if not isinstance(plain, dict | list):
        return str(plain)
    text: str = yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, width=10**9)
    return text.rstrip('\n')


def field(message: Any, path: str) -> Any:
    """Return a field of a message by its dotted path; CommandError if there is none."""
    value = message
    for name in path.split('.'):
        if not hasattr(value, 'get_fields_and_field_types') or not hasattr(value, name):
            raise CommandError(f"Invalid field '{path}': {type(value).__name__} has no '{name}'")
        value = getattr(value, name)
    return value


def fill(message: Any, values: Any, path: str = '') -> None:
    """Set a message's fields from nested dictionaries.

    path: of the message as a field of another. CommandError for unknown fields and for values that
    a field cannot hold.
    """
    types = message.get_fields_and_field_types()
    if not isinstance(values, dict):
        raise CommandError(
            f'{path or "values"} must be a YAML dictionary of {", ".join(types)}, got {values!r}'
        )
    for name, value in values.items():
        if name not in types:
            known = ', '.join(types) or 'none'
            raise CommandError(f"{type(message).__name__} has no field '{name}', it has: {known}")
        where = f'{path}.{name}' if path else name
        setattr(message, name, _converted(where, types[name], value))


def _converted(path: str, kind: str, value: Any) -> Any:
    """Return a value from YAML as a field of an IDL type holds it; CommandError for no such."""
    from rosidl_embedded.message import SEQUENCE, check, message_class  # slow to import

    found = value
    if match := SEQUENCE.fullmatch(kind):
        if isinstance(value, list | bytes):
            inner = match[1] or match[3]
            found = [_converted(f'{path}[{i}]', inner, item) for i, item in enumerate(value)]
    elif '/' in kind:
        package, _, name = kind.partition('/')
        found = message_class(package, name)()
        fill(found, value, path)
    elif kind == 'octet' and isinstance(value, int) and 0 <= value < 256:
        found = bytes((value,))
    try:
        if kind in ('float', 'double') and type(value) is int:
            found = float(value)
        check(path, 'uint8' if kind == 'char' else kind, found)
        if kind == 'float':
            struct.pack('<f', found)  # OverflowError
    except (AssertionError, OverflowError):
        raise CommandError(f'{path} must be of type {kind}, got {value!r}') from None
    return found


def parse_values(text: str) -> Any:
    """Parse YAML; an empty text gives {}, an invalid one raises CommandError."""
    try:
        values = yaml.safe_load(text)
    except yaml.YAMLError as error:
        reason = ' '.join(str(error).split())
        raise CommandError(f'cannot read {text!r} as YAML: {reason}') from error
    return {} if values is None else values
