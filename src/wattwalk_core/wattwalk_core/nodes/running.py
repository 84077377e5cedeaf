"""How a node of the suite spins until its end, and ends in good order."""

import signal
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.task import Future


def spin(node: Node, until: Future | None = None) -> None:
    """
    Run a node's callbacks until Ctrl-C, SIGTERM, a shutdown, or a future that is done.

    A signal shuts the context down while a callback may be at work, whose publishing then fails:
    errors of a context that is no longer valid are part of the end. All others are raised.
    """
    try:
        if until is None:
            rclpy.spin(node)
        else:
            rclpy.spin_until_future_complete(node, until)
    except (KeyboardInterrupt, ExternalShutdownException):
        return
    except RuntimeError:
        if node.context.ok():
            raise


def run_node(make: Callable[[], Node], arguments: Sequence[str]) -> None:
    """
    Make a node and run it until Ctrl-C, SIGTERM or a shutdown; then stop and destroy it.

    arguments: with those of ROS. A node that has to end what it began has a method `stop`.
    """
    rclpy.init(args=list(arguments))
    node = None
    try:
        node = make()
        spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        if node is not None:
            getattr(node, 'stop', lambda: None)()
            node.destroy_node()
        rclpy.try_shutdown()


def interrupt_on_signals() -> None:
    """
    Make SIGINT and SIGTERM a KeyboardInterrupt, which ends `spin`, in the context's stead.

    To go with rclpy.init and SignalHandlerOptions.NO: the context stays valid, so that a node can
    still publish what it has. A node without a timer may notice late.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)


def ignore_signals() -> None:
    """Let nothing but SIGKILL cut the end off; launch files send SIGINT twice."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
