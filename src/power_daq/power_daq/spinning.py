"""How a node of the suite spins until its end, and ends in good order."""

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
