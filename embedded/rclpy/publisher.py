"""Publishers."""

from typing import Any

from cyclonedds.core import DDSException
from rosidl_embedded import codec

from rclpy._rclpy_pybind11 import InvalidHandle, RCLError
from rclpy.event_handler import IncompatibleQos
from rclpy.impl.graph import Gids
from rclpy.impl.transport import raw_type
from rclpy.qos import QoSProfile


class Publisher:
    """Publishes messages of one type on one topic; publish may be called from any thread."""

    def __init__(
        self, node: Any, msg_type: Any, topic: str, given_name: str, qos_profile: QoSProfile
    ):
        codec.warm(msg_type)
        self.msg_type = msg_type
        self.qos_profile = qos_profile
        self._node = node
        self._context = node.context
        self._topic = topic
        name = msg_type._type_name
        self._raw: Any = raw_type(name)
        self._writer: Any = node.context.participant.writer(f'rt{topic}', name, qos_profile)
        self.gids: Gids = [], [self._writer.guid.bytes]
        self._event: IncompatibleQos | None = IncompatibleQos(
            self._writer, False, given_name, None, node.get_logger()
        )

    @property
    def topic_name(self) -> str:
        """Absolute name of the topic."""
        return self._topic

    topic = topic_name

    def publish(self, msg: Any) -> None:
        """Send a message, or CDR bytes as they are.

        Raises TypeError for a wrong type of message or field, InvalidHandle after `destroy`,
        RCLError after shutdown or if reliable subscriptions lag behind.
        """
        if msg.__class__ is self.msg_type:
            cdr = codec.serialize(msg)
        elif isinstance(msg, bytes):
            cdr = msg
        else:
            raise TypeError(f'Expected {self.msg_type}, got {type(msg)}')
        if not self._context.valid:
            raise RCLError("Failed to publish: publisher's context is invalid")
        try:
            self._alive().write(self._raw(cdr))
        except DDSException as error:
            raise RCLError(f"Failed to publish on '{self._topic}': {error}") from error

    def get_subscription_count(self) -> int:
        """Return the number of matched subscriptions."""
        return len(self._alive().get_matched_subscriptions())

    def wait_for_all_acked(self, timeout: Any = None) -> bool:
        """Block until reliable subscriptions have all messages; False at timeout (a Duration)."""
        span = 2**63 - 1 if timeout is None else timeout.nanoseconds
        writer = self._alive()
        return bool(writer._wait_for_acks(writer._ref, span) == 0)

    def _alive(self) -> Any:
        if self._writer is None:
            raise InvalidHandle
        return self._writer

    def _conditions(self) -> list[tuple[Any, Any]]:
        return [] if self._event is None else [(self._event.entity, self._event.check)]

    def destroy(self) -> None:
        """Release the DDS writer; `publish` then raises InvalidHandle."""
        self._writer = self._event = None
