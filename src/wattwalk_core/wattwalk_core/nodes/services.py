"""Services without arguments."""

from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import Trigger


def offer(node: Node, name: str, action: Callable[[], tuple[bool, str]]) -> None:
    """Serve std_srvs/Trigger as `~/name`, and as `name`, which clients of release 0.1 call.

    action: runs at each call; returns whether it succeeded, and a message.
    """

    def serve(request: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        answer.success, answer.message = action()
        return answer

    for full_name in (f'~/{name}', name):
        node.create_service(Trigger, full_name, serve)
