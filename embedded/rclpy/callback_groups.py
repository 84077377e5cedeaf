"""Groups of callbacks; with one thread all of them exclude one another."""

from typing import Any


class CallbackGroup:
    """Base of the groups."""

    def can_execute(self, entity: Any) -> bool:
        """Tell whether an executor may serve an entity of the group."""
        return True


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """Callbacks that never run at the same time."""


class ReentrantCallbackGroup(CallbackGroup):
    """Callbacks that may run at the same time."""
