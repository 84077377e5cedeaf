"""Service servers."""

from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.impl.service_transport import ServiceEnd
from rclpy.qos import QoSProfile


class Service:
    """Answers requests by a callback (request, response) -> response."""

    def __init__(
        self,
        node: Any,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        callback_group: Any,
        qos_profile: QoSProfile,
    ):
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.callback = callback
        self.callback_group = callback_group
        self.qos_profile = qos_profile
        self._logger = node.get_logger()
        participant = node.context.participant
        self._end: ServiceEnd | None = ServiceEnd(
            participant, srv_type, srv_name, qos_profile, True
        )

    @property
    def service_name(self) -> str:
        """Absolute name of the service."""
        return self.srv_name

    @property
    def gids(self) -> tuple[bytes, bytes]:
        """Gids of reader and writer."""
        return self._alive().gids

    def _alive(self) -> ServiceEnd:
        if self._end is None:
            raise InvalidHandle('cannot use Destroyable because destruction was requested')
        return self._end

    def _conditions(self) -> list[tuple[Any, Any]]:
        return [] if self._end is None else [(self._end.unread, self._take)]

    def _take(self) -> list[tuple[Any, Any]]:
        if self._end is None:
            return []
        try:
            return [(self._execute, request) for request in self._end.take()]
        except ValueError as error:
            self._logger.error(f"request to '{self.srv_name}' dropped: {error}")
            return []

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

    def destroy(self) -> None:
        """Stop serving."""
        self._end = None
