"""Layouts of messages that are learned from examples."""

from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import numpy as np
from power_recordings.messages.topic_columns import MessageSorter, TooManyLayoutsError


def test_no_more_layouts_are_kept_than_the_limit_however_many_batches_come() -> None:
    learned = []

    class Exactly:
        def __init__(self, example: bytes) -> None:
            learned.append(self)
            self._example = np.frombuffer(example, np.uint8)

        def matches(self, rows: Any) -> Any:
            return (rows == self._example).all(axis=1)

    sorter = MessageSorter(Exactly)
    for start in (0, 200, 400, 600):
        numbers = np.arange(start, start + 200, dtype='<u4')
        batch = SimpleNamespace(
            data=numbers.view(np.uint8), offsets=4 * np.arange(200), sizes=np.full(200, 4)
        )
        with suppress(TooManyLayoutsError):
            assert all(layout is not None for layout, *_ in sorter.sort(batch))
    assert len(sorter._layouts[4]) == 256
    assert len(learned) == 256 + 3
