"""Service servers."""

from collections.abc import Callable
from typing import Any

from rclpy.impl.service_transport import ServiceEntity
from rclpy.qos import QoSProfile


class Service(ServiceEntity):
    """Answers requests by a callback (request, response) -> response."""

    def __init__(
        self,
        node: Any,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        qos_profile: QoSProfile,
    ):
        super().__init__(node, srv_type, srv_name, qos_profile, True)
        self.callback = callback

    def _execute(self, taken: tuple[int, int, int, Any]) -> None:
        guid, sequence, publication, request = taken
        response = self.callback(request, self.srv_type.Response())
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(
                f"callback of service '{self.srv_name}' returned {type(response)}, "
                f'expected {self.srv_type.Response}'
            )
        end = self._end
        if end is not None:
            end.wait_for_client(publication)
            end.send(response, guid, sequence)
