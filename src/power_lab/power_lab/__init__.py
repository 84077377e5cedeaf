"""Judges power models: where they fail and which physical effect they miss."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from power_lab.session import Session as Session


def __getattr__(name: str) -> Any:
    """Import `Session` when it is asked for."""
    if name != 'Session':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from power_lab.session import Session  # it takes seconds

    return Session
