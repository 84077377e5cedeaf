"""Messages to YAML and back."""

from array import array
from typing import Any

import numpy as np
import yaml

from ros2cli.main import CommandError


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
    """Return a field by its dotted path; raise CommandError where there is none."""
    value = message
    for name in path.split('.'):
        if not hasattr(value, 'get_fields_and_field_types') or not hasattr(value, name):
            raise CommandError(f"Invalid field '{path}': {type(value).__name__} has no '{name}'")
        value = getattr(value, name)
    return value


def fill(message: Any, values: Any) -> None:
    """Set a message's fields from dictionaries; raise CommandError for what does not fit."""
    types = message.get_fields_and_field_types()
    if not isinstance(values, dict):
        raise CommandError(
            f'values must be a YAML dictionary of {", ".join(types)}, got {values!r}'
        )
    for name, value in values.items():
        if name not in types:
            known = ', '.join(types) or 'none'
            raise CommandError(f"{type(message).__name__} has no field '{name}', it has: {known}")
        setattr(message, name, _converted(getattr(message, name), types[name], value))


def _converted(current: Any, kind: str, value: Any) -> Any:
    if hasattr(current, 'get_fields_and_field_types'):
        fill(current, value)
        return current
    if kind.startswith('sequence<') and '/' in kind:
        inner = kind.removeprefix('sequence<').removesuffix('>').partition(',')[0]
        package, _, name = inner.partition('/')
        return [_made(package, name, item) for item in value]
    if kind in ('float', 'double') and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if kind == 'octet' and isinstance(value, int):
        return bytes((value & 255,))
    return value


def _made(package: str, name: str, values: Any) -> Any:
    from rosidl_embedded import message_class  # slow to import

    message = message_class(package, name)()
    fill(message, values)
    return message


def parse_values(text: str) -> Any:
    """Return what YAML means; raise CommandError where it is none."""
    try:
        values = yaml.safe_load(text)
    except yaml.YAMLError as error:
        reason = ' '.join(str(error).split())
        raise CommandError(f'cannot read {text!r} as YAML: {reason}') from error
    return {} if values is None else values
