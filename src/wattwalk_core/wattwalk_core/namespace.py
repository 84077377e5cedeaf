"""Namespaces of nodes."""

import re

from wattwalk_core.errors import InputError, quoted

_SOUND = re.compile(r'/|(?:/[A-Za-z_][A-Za-z0-9_]*)+')


def absolute_namespace(text: str) -> str:
    """Return a namespace with its leading slash; InputError for one that ROS refuses."""
    space = text if text.startswith('/') else f'/{text}'
    if not text or _SOUND.fullmatch(space) is None:
        raise InputError(
            f'namespace {quoted(text)}: expected letters, digits and _, no digit first, as robot_1'
        )
    return space
