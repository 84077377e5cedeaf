"""Messages of one topic in batches, whatever file they come from, and limits of what is read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

LARGEST: Final = 256 << 20  # bytes of a chunk, packed or not
# What all chunks of a file may unpack to: far more than recordings, far less than zip bombs.
ROOM: Final = 256 << 20  # bytes
RATIO: Final = 200

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


def joined(topic: Topic, messages: Sequence[tuple[int, bytes]]) -> Batch:
    """Return messages of a topic, (log time in ns, bytes) each, as a batch."""
    sizes = np.array([len(raw) for _, raw in messages], np.int64)
    data = np.frombuffer(b''.join(raw for _, raw in messages), np.uint8)
    times = np.array([time for time, _ in messages], np.int64)
    return Batch(topic, data, np.cumsum(sizes) - sizes, sizes, times)


def windows(data: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return all windows of `size` bytes, [len(data) − size + 1, size], without copying."""
    return np.ndarray((len(data) - size + 1, size), np.uint8, data, strides=(1, 1))
