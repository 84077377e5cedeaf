"""Groups of callbacks; with one thread all of them exclude one another."""


class CallbackGroup:
    """Base of the groups."""


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """Callbacks that never run at the same time."""


class ReentrantCallbackGroup(CallbackGroup):
    """Callbacks that may run at the same time."""
