"""Messages of one topic in batches, whatever file they come from, and limits of what is read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError
from wattwalk_core.files import regular_size

LARGEST: Final = 256 << 20  # bytes of a chunk, packed or not
# What all chunks of a file may unpack to: far more than recordings, far less than zip bombs.
_ROOM: Final = 256 << 20  # bytes
_RATIO: Final = 200

Integers = NDArray[np.int64]
Skip = Callable[[Mapping[str, int]], bool] | None  # of a chunk, by its messages of each topic


@dataclass(frozen=True)
class Topic:
    """A topic as the file declares it; `definition` is the text of its message type."""

    name: str
    type_name: str
    encoding: str
    definition: str


@dataclass(frozen=True)
class Batch:
    """N messages of one topic in recorded order; each is data[offset : offset + size]."""

    topic: Topic
    data: NDArray[np.uint8]
    offsets: Integers
    sizes: Integers
    log_times: Integers  # ns


class MessageFile:
    """Base of a file of messages; `problems` is complete once its `batches` is exhausted.

    Raises InputError for a path that is no regular file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problems: list[str] = []
        self.topics: dict[int, Topic] = {}
        self._size = regular_size(path, 'recording')
        self._room = _ROOM + _RATIO * self._size

    def _count_unpacked(self, size: int) -> None:
        """Count bytes of a chunk; InputError if all unpack to far more than the file can hold."""
        self._room -= size
        if self._room < 0:
            raise InputError(
                f'{self.path}: its chunks unpack to more than {_RATIO} times its size; expected a '
                'recording'
            )


def joined(topic: Topic, messages: Sequence[tuple[int, bytes]]) -> Batch:
    """Return messages of a topic, (log time in ns, bytes) each, as a batch."""
    sizes = np.array([len(raw) for _, raw in messages], np.int64)
    data = np.frombuffer(b''.join(raw for _, raw in messages), np.uint8)
    times = np.array([time for time, _ in messages], np.int64)
    return Batch(topic, data, np.cumsum(sizes) - sizes, sizes, times)


def windows(data: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return all windows of `size` bytes, [len(data) − size + 1, size], without copying."""
    return np.ndarray((len(data) - size + 1, size), np.uint8, data, strides=(1, 1))
