"""The default context and the command line."""

import sys
import threading
from collections.abc import Sequence

from rclpy.context import Context
from rclpy.impl import arguments

_default_context: Context | None = None
_lock = threading.RLock()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """Return the default context; shutting_down: the next call makes a new one."""
    global _default_context
    with _lock:
        if _default_context is None:
            _default_context = Context()
        context = _default_context
        if shutting_down:
            _default_context = None
        return context


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """Return the arguments without those from each --ros-args to its --."""
    return arguments.split(sys.argv if args is None else args)[0]


def try_shutdown(*, context: Context | None = None) -> None:
    """Shut a context down, where it was started and not shut down."""
    if context is not None:
        context.try_shutdown()
        return
    with _lock:
        default = get_default_context()
        default.try_shutdown()
        if default.initialized:
            get_default_context(shutting_down=True)
