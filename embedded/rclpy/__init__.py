"""The subset of rclpy that the nodes use, for machines without ROS 2.

Same API, same wire: nodes see and are seen by ROS 2 Jazzy nodes on rmw_cyclonedds.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions, install_signal_handlers, uninstall_signal_handlers
from rclpy.task import Future
from rclpy.utilities import get_default_context, try_shutdown

_executor: Any = None


class InitContextManager:
    """Context manager of a started context, which it shuts down at the end of its block."""

    def __init__(self, context: Context, uninstalls_handlers: bool) -> None:
        self.context = context
        self._uninstalls_handlers = uninstalls_handlers

    def __enter__(self) -> 'InitContextManager':
        return self

    def __exit__(self, *_: object) -> None:
        # The default context is replaced by a new one when it is shut down as such.
        is_default = self.context is get_default_context()
        try_shutdown(context=None if is_default else self.context)
        if self._uninstalls_handlers:
            uninstall_signal_handlers()


def init(
    *,
    args: Sequence[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> InitContextManager:
    """Start a context, by default the default one, with the process's arguments.

    SIGINT and SIGTERM then shut it down, unless another context or other options are given.
    `with rclpy.init():` shuts it down at the end of the block, as rclpy after Jazzy does.
    Raises RuntimeError where it was started before.
    """
    default = get_default_context()
    chosen = default if context is None else context
    chosen.init(args, domain_id=domain_id)
    if signal_handler_options is None:
        is_default = chosen is default
        signal_handler_options = (
            SignalHandlerOptions.ALL if is_default else SignalHandlerOptions.NO
        )
    install_signal_handlers(signal_handler_options)
    return InitContextManager(chosen, signal_handler_options is not SignalHandlerOptions.NO)


def shutdown(*, context: Context | None = None) -> None:
    """Shut a context down; raise RuntimeError where it was not started."""
    default = get_default_context()
    (get_default_context(shutting_down=True) if context is None else context).shutdown()
    if context in (None, default):
        uninstall_signal_handlers()


def ok(*, context: Context | None = None) -> bool:
    """Tell whether a context was started and not shut down."""
    return (get_default_context() if context is None else context).ok()


def create_node(node_name: str, **options: Any) -> Any:
    """Make a plain node; the options are those of Node."""
    from rclpy.node import Node  # circular

    return Node(node_name, **options)


def get_global_executor() -> Any:
    """Return the executor used by `spin` by default; ExternalShutdownException after shutdown."""
    global _executor
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor  # circular

    context = get_default_context()
    if not context.ok():
        raise ExternalShutdownException
    if _executor is None or _executor.context is not context:
        _executor = SingleThreadedExecutor(context=context)
    return _executor


@contextmanager
def _serving(node: Any, executor: Any) -> Iterator[Any]:
    """Give the executor, by default the global one, which serves a node within the block."""
    chosen = get_global_executor() if executor is None else executor
    added = chosen.add_node(node)
    try:
        yield chosen
    finally:
        if added:
            chosen.remove_node(node)


def spin_once(node: Any, *, executor: Any = None, timeout_sec: float | None = None) -> None:
    """Wait for one callback, at most `timeout_sec` [s], and run it."""
    with _serving(node, executor) as chosen:
        chosen.spin_once(timeout_sec=timeout_sec)


def spin(node: Any, executor: Any = None) -> None:
    """Run callbacks until the context is shut down.

    Raises KeyboardInterrupt at Ctrl-C and ExternalShutdownException at SIGTERM.
    """
    with _serving(node, executor) as chosen:
        chosen.spin()


def spin_until_future_complete(
    node: Any, future: Future, executor: Any = None, timeout_sec: float | None = None
) -> None:
    """Run callbacks until a future is done, at most `timeout_sec` [s]."""
    with _serving(node, executor) as chosen:
        chosen.spin_until_future_complete(future, timeout_sec)
