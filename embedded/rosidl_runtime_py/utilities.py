"""Interface classes by their names."""

from typing import Any

from rosidl_embedded import message_class, service_class


def _parts(identifier: str, kind: str) -> tuple[str, str]:
    parts = identifier.split('/')
    if len(parts) == 2:
        parts.insert(1, kind)
    if len(parts) != 3 or parts[1] != kind or not all(parts):
        raise ValueError(f"Expected the full name of a {kind}, got '{identifier}'")
    return parts[0], parts[2]


def get_message(identifier: str) -> Any:
    """Return the class of `pkg/msg/Name`; raise ValueError or AttributeError without one."""
    return message_class(*_parts(identifier, 'msg'))


def get_service(identifier: str) -> Any:
    """Return the class of `pkg/srv/Name`; raise ValueError or AttributeError without one."""
    return service_class(*_parts(identifier, 'srv'))
