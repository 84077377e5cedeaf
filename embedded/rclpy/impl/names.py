"""Rules for the names of nodes, namespaces, topics and services."""

import re

from rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
)

SUBSTITUTION = re.compile(r'\{([^{}]*)\}')


def _first(pattern: str, name: str) -> int | None:
    match = re.search(pattern, name)
    return None if match is None else match.start()


def node_name_error(name: str) -> tuple[str, int] | None:
    """Return what is wrong with a node's name and where."""
    if not name:
        return 'node name must not be empty', 0
    if (at := _first(r'[^A-Za-z0-9_]', name)) is not None:
        return "node name must not contain characters other than alphanumerics or '_'", at
    if name[0].isdigit():
        return 'node name must not start with a number', 0
    return None


def full_name_error(name: str, kind: str) -> tuple[str, int] | None:
    """Return what is wrong with a fully qualified topic name or a namespace and where."""
    if not name:
        return f'{kind} must not be empty', 0
    if not name.startswith('/'):
        return f"{kind} must be absolute, it must lead with a '/'", 0
    if name == '/' and kind == 'namespace':
        return None
    if name.endswith('/'):
        return f"{kind} must not end with a '/'", len(name) - 1
    if (at := _first(r'[^A-Za-z0-9_/]', name)) is not None:
        return f"{kind} must not contain characters other than alphanumerics, '_', or '/'", at
    if (at := _first(r'//', name)) is not None:
        return f"{kind} must not contain repeated '/'", at + 1
    if (at := _first(r'/[0-9]', name)) is not None:
        return f'{kind} must not have a token that starts with a number', at + 1
    return None


def topic_name_error(name: str) -> tuple[str, int] | None:
    """Return what is wrong with a topic's or service's name as users give it, and where."""
    if not name:
        return 'topic name must not be empty string', 0
    if name[0].isdigit():
        return 'topic name token must not start with a number', 0
    if name.endswith('/'):
        return 'topic name must not end with a forward slash', len(name) - 1
    plain = SUBSTITUTION.sub(lambda match: '_' * len(match[0]), name)
    if (at := _first(r'[{}]', plain)) is not None:
        return "topic name must not have unmatched (unbalanced) curly braces '{}'", at
    if (at := _first(r'[^A-Za-z0-9_/~]', plain)) is not None:
        return (
            'topic name must not contain characters other than alphanumerics, '
            "'_', '~', '{', or '}'",
            at,
        )
    if (at := _first(r'(?<=.)~', plain)) is not None:
        return "topic name must not have tilde '~' unless it is the first character", at
    if len(plain) > 1 and plain[0] == '~' and plain[1] != '/':
        return (
            "topic name must not have a tilde '~' that is not followed by a forward slash '/'",
            1,
        )
    if (at := _first(r'//', plain)) is not None:
        return "topic name must not contain repeated '/'", at + 1
    if (at := _first(r'/[0-9]', plain)) is not None:
        return 'topic name token must not start with a number', at + 1
    return None


def validate_node_name(name: str) -> None:
    """Raise InvalidNodeNameException for a name that a node cannot have."""
    if (error := node_name_error(name)) is not None:
        raise InvalidNodeNameException(name, *error)


def validate_namespace(namespace: str) -> None:
    """Raise InvalidNamespaceException for a name that a namespace cannot have."""
    if (error := full_name_error(namespace, 'namespace')) is not None:
        raise InvalidNamespaceException(namespace, *error)


def validate_topic_name(name: str, is_service: bool = False) -> None:
    """Raise Invalid…NameException for a name that a topic or a service cannot have."""
    if (error := topic_name_error(name)) is not None:
        kind = InvalidServiceNameException if is_service else InvalidTopicNameException
        raise kind(name, *error)


def expand(name: str, node_name: str, namespace: str, is_service: bool = False) -> str:
    """Return the absolute form of a topic's or service's name, without remapping."""
    validate_topic_name(name, is_service)
    base = '' if namespace == '/' else namespace
    known = {'node': node_name, 'ns': base, 'namespace': base}
    expanded = SUBSTITUTION.sub(lambda match: known.get(match[1], match[0]), name)
    if expanded.startswith('~'):
        expanded = f'{base}/{node_name}{expanded[1:]}'
    elif not expanded.startswith('/'):
        expanded = f'{base}/{expanded}'
    expanded = expanded.replace('//', '/')
    if (error := full_name_error(expanded, 'topic name')) is not None:
        kind = InvalidServiceNameException if is_service else InvalidTopicNameException
        raise kind(name, *error)
    return expanded
