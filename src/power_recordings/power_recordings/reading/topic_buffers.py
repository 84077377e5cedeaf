"""Buffers of a topic's messages, decoded many at a time."""

from collections import deque

from wattwalk_core.errors import InputError

from power_recordings.messages.batch import Topic, joined
from power_recordings.messages.samples import Samples
from power_recordings.messages.topic_columns import Columns
from power_recordings.messages.topics import KINDS

_MOST = 20_000  # messages


class TopicCounter:
    """Counts the messages of a topic and keeps the arrival of the newest."""

    def __init__(self) -> None:
        self.count = 0
        self.last: float | None = None

    def take(self, cdr: bytes, now: float) -> None:
        """Count a message that arrived at `now` [s]."""
        self.count += 1
        self.last = now


class TopicBuffer(TopicCounter):
    """Keeps the CDR bytes of a topic's messages and decodes them when it is drained.

    count: messages so far; last: arrival of the newest, s on a steady clock; fault: error of the
    latest `drain`, '' if none. Beyond 20,000 messages the oldest are dropped.
    """

    def __init__(self, topic: str) -> None:
        """topic: one of `power_recordings.messages.topics.KINDS`."""
        super().__init__()
        self._kind = KINDS[topic]
        self._topic = Topic(topic, self._kind.type_name, 'cdr', '')
        self._columns = Columns(topic, self._kind.type_name, self._kind.paths)
        self._waiting: deque[bytes] = deque(maxlen=_MOST)
        self.fault = ''

    def take(self, cdr: bytes, now: float) -> None:
        """Buffer a message that arrived at `now` [s]."""
        super().take(cdr, now)
        self._waiting.append(cdr)

    def drain(self) -> tuple[list[bytes], Samples | None]:
        """Return the bytes since the last call, and their samples if they can be decoded."""
        raw = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if not raw:
            return raw, None
        columns = self._columns
        columns.blocks, columns.count, columns.damaged = [], 0, 0
        columns.add(joined(self._topic, [(0, cdr) for cdr in raw]))
        self.fault = f'{columns.damaged} damaged messages' if columns.damaged else ''
        if not columns.blocks:
            return raw, None
        try:
            columns.check()
            return raw, self._kind.build(columns)
        except InputError as error:
            self.fault = str(error)
            return raw, None
