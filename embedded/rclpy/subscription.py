"""Subscriptions."""

import inspect
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Self

from rosidl_embedded import codec

from rclpy.event_handler import IncompatibleQos
from rclpy.exceptions import InvalidHandle
from rclpy.impl.graph import Gids
from rclpy.impl.transport import Sample, unread
from rclpy.qos import HistoryPolicy, QoSProfile

BATCH = 32


class SubscriptionHandle:
    """Handle of a subscription, a context manager; reads messages without an executor."""

    def __init__(self, reader: Any, batch: int, topic: str, logger: Any):
        self._reader, self._batch = reader, batch
        self._topic, self._logger = topic, logger
        self._taken: deque[Sample] = deque()

    def __enter__(self) -> Self:
        if self._reader is None:
            raise InvalidHandle
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def take_message(self, pymsg_type: Any, raw: bool) -> tuple[Any, dict[str, int]] | None:
        """Return the oldest waiting message with its `message_info`; None if none waits."""
        while True:
            while self._taken:
                sample = self._taken.popleft()
                message = decoded(sample, pymsg_type, raw, self._topic, self._logger)
                if message is not None:
                    return message, message_info(sample)
            samples = self._reader.take(self._batch)
            if not samples:
                return None
            self._taken.extend(s for s in samples if s.__class__ is Sample)

    def destroy(self) -> None:
        """Release the reader and drop waiting messages."""
        self._reader = None
        self._taken.clear()


def decoded(sample: Sample, msg_type: Any, raw: bool, topic: str, logger: Any) -> Any:
    """Decode a sample (raw: return its bytes); None, and an error is logged, if it is invalid."""
    if raw:
        return bytes(sample)
    try:
        return codec.deserialize(sample, msg_type)
    except ValueError as error:
        logger.error(f"message on '{topic}' dropped: {error}")
        return None


def message_info(sample: Sample) -> dict[str, int]:
    """Return the system times of a sample's publication and arrival, ns."""
    source = sample.sample_info.source_timestamp
    return {'source_timestamp': source, 'received_timestamp': time.time_ns()}


def takes_info(callback: Callable[..., Any]) -> bool:
    """Return True for a callback (message, info), False for (message); else RuntimeError."""
    signature = inspect.signature(callback)
    for arguments in (1, 2):
        try:
            signature.bind(*[object()] * arguments)
        except TypeError:
            continue
        return arguments == 2
    raise RuntimeError(
        'Subscription.__init__(): callback should be either be callable with one argument'
        '(to get only the message) or two (to get message and message info)'
    )


class Subscription:
    """Gets messages of one type from one topic and hands them to a callback."""

    def __init__(
        self,
        node: Any,
        msg_type: Any,
        topic: str,
        given_name: str,
        callback: Callable[..., Any],
        callback_group: Any,
        qos_profile: QoSProfile,
        raw: bool,
        event_callbacks: Any,
    ):
        codec.warm(msg_type)
        self.msg_type = msg_type
        self.callback = callback
        self.callback_group = callback_group
        self.qos_profile = qos_profile
        self.raw = raw
        self._with_info = takes_info(callback)
        self.topic = topic
        self._logger = node.get_logger()
        name = msg_type._type_name
        self._reader: Any = node.context.participant.reader(f'rt{topic}', name, qos_profile)
        self.gids: Gids = [self._reader.guid.bytes], []
        self._unread: Any = unread(self._reader)
        keeps_all = qos_profile.history == HistoryPolicy.KEEP_ALL
        self._batch = BATCH if keeps_all else max(1, min(BATCH, qos_profile.depth))
        self.handle = SubscriptionHandle(self._reader, self._batch, topic, self._logger)
        self._event: IncompatibleQos | None = IncompatibleQos(
            self._reader, True, given_name, event_callbacks, self._logger
        )

    def _conditions(self) -> list[tuple[Any, Any]]:
        if self._event is None:
            return []
        found = [(self._event.entity, self._event.check)]
        if self.callback_group.can_execute(self):
            found.append((self._unread, self._take))
        return found

    def _take(self) -> list[tuple[Any, Any]]:
        """Return the callbacks that are due, each with its sample."""
        if self._reader is None:
            return []
        samples = self._reader.take(self._batch)
        return [(self._execute, sample) for sample in samples if sample.__class__ is Sample]

    def _execute(self, sample: Sample) -> None:
        if self._reader is None:
            return
        message = decoded(sample, self.msg_type, self.raw, self.topic, self._logger)
        if message is None:
            return
        if self._with_info:
            self.callback(message, message_info(sample))
        else:
            self.callback(message)

    def destroy(self) -> None:
        """Release the DDS reader."""
        self._reader = self._unread = self._event = None
        self.handle.destroy()
