"""Groups of callbacks; with one thread all of them exclude one another."""

from typing import Any


class CallbackGroup:
    """Base class of groups of callbacks, which say what may run at the same time."""

    def can_execute(self, entity: Any) -> bool:
        """Return whether an executor may run a callback of an entity now; always True."""
        return True


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """Callbacks that never run at the same time."""


class ReentrantCallbackGroup(CallbackGroup):
    """Callbacks that may run at the same time; here they do not, with one thread."""
