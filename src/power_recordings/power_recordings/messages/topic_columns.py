"""Columns of numbers from the messages of one topic, in one order of names."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from power_recordings.messages.batch import Batch, windows
from power_recordings.messages.cdr import typestore
from power_recordings.messages.cdr_layout import Bytes, Layout

_MOST_LAYOUTS = 256  # of messages of one size


class TooManyLayoutsError(Exception):
    """Raised where texts or array lengths change in nearly every message of a topic."""


class MessageSorter:
    """Sorts the messages of a topic by their layouts, which it learns from them.

    learn: makes the layout of a message; ValueError for one that is damaged.
    """

    def __init__(self, learn: Callable[[bytes], Layout]) -> None:
        self._learn = learn
        self._layouts: dict[int, list[Layout]] = defaultdict(list)

    def sort(self, batch: Batch) -> Iterator[tuple[Layout | None, NDArray[np.intp], Bytes]]:
        """Yield each layout with the indices [N] in the batch and bytes [N, size] of its messages.

        The layout of damaged messages is None. Raises TooManyLayoutsError.
        """
        for size in np.unique(batch.sizes).tolist():
            places = np.flatnonzero(batch.sizes == size)
            if size < 4:
                yield None, places, np.zeros((len(places), 0), np.uint8)
                continue
            rows = windows(batch.data, size)[batch.offsets[places]]
            known, tried = self._layouts[size], 0
            while len(places):
                if tried == len(known):
                    try:
                        layout = self._learn(rows[0].tobytes())
                    except ValueError:
                        yield None, places[:1], rows[:1]
                        places, rows = places[1:], rows[1:]
                        continue
                    if tried >= _MOST_LAYOUTS:
                        raise TooManyLayoutsError
                    known.append(layout)
                layout = known[tried]
                tried += 1
                same = layout.matches(rows)
                if same.all():
                    yield layout, places, rows
                    break
                if same.any():
                    yield layout, places[same], rows[same]
                    places, rows = places[~same], rows[~same]


@dataclass
class Block:
    """N messages of one layout: indices in the topic [N], stamps [N], and numbers by path."""

    layout: Layout
    order: NDArray[np.int64]
    stamp_ns: NDArray[np.int64]
    columns: dict[str, NDArray[Any]]

    def strings(self, path: str) -> tuple[str, ...]:
        """Return the strings that all messages of the block have at path."""
        found = self.layout.strings[path]
        return (found,) if isinstance(found, str) else found


@dataclass
class Columns:
    """The numbers of a topic's messages, collected batch by batch; paths: of the fields wanted.

    Methods return values of all undamaged messages, N, in recorded order.
    """

    topic: str
    type_name: str
    paths: Sequence[str]
    blocks: list[Block] = field(default_factory=list)
    count: int = 0
    damaged: int = 0
    _too_many_layouts: bool = False

    def __post_init__(self) -> None:
        self._sorter = MessageSorter(
            lambda example: Layout(typestore().fielddefs, self.type_name, example)
        )

    def add(self, batch: Batch) -> None:
        """Decode the messages of a batch; damaged ones are counted and left out."""
        begin, self.count = self.count, self.count + len(batch.offsets)
        if self._too_many_layouts:
            return
        try:
            for layout, places, rows in self._sorter.sort(batch):
                if layout is None:
                    self.damaged += len(places)
                else:
                    self._decode(layout, rows, begin + places)
        except TooManyLayoutsError:
            self._too_many_layouts = True

    def _decode(self, layout: Layout, rows: Bytes, order: NDArray[np.int64]) -> None:
        seconds = layout.decode(rows, 'header.stamp.sec').astype(np.int64)
        stamp = seconds * 1_000_000_000 + layout.decode(rows, 'header.stamp.nanosec')
        columns = {path: layout.decode(rows, path) for path in self.paths}
        for path, values in columns.items():
            if values.dtype.kind == 'f':
                with np.errstate(over='ignore'):
                    columns[path] = values.astype(np.float32)
        self.blocks.append(Block(layout, order, stamp, columns))

    def check(self) -> None:
        """Raise InputError if names or array lengths change in nearly every message added."""
        if self._too_many_layouts:
            raise InputError(
                f'{self.topic}: the names or array lengths change in nearly every message; '
                'expected one set of names'
            )

    def stamps(self) -> NDArray[np.int64]:
        """Return the header stamps, ns [N]."""
        return self.in_order([block.stamp_ns for block in self.blocks])

    def scalars(self, path: str) -> NDArray[Any]:
        """Return the values of a field that is a single number, [N]."""
        return self.in_order([block.columns[path] for block in self.blocks])

    def vector(self, path: str, axes: str) -> NDArray[Any]:
        """Return the fields `path`.x, .y … for the letters of `axes`, [N, len(axes)]."""
        return np.stack([self.scalars(f'{path}.{axis}') for axis in axes], axis=1)

    def names(self, path: str = 'name') -> tuple[str, ...]:
        """Return the names in field `path`, each once, in the order of first occurrence."""
        blocks = sorted(self.blocks, key=lambda block: int(block.order[0]))
        return tuple(dict.fromkeys(name for block in blocks for name in block.strings(path)))

    def by_name(self, path: str, names: Sequence[str]) -> NDArray[Any]:
        """Return the values of an array field in the order of names, [N, D]; NaN if missing."""
        return self.in_order([self.remapped(block, path, names) for block in self.blocks])

    def remapped(
        self, block: Block, path: str, names: Sequence[str], per_message: int = 1
    ) -> NDArray[Any]:
        """Return an array field of one block in the order of names, [N · per_message, D].

        Missing names get NaN (0 for integers). per_message: samples in each message. InputError
        for an array of a wrong length.
        """
        own = block.strings('name')
        values = block.columns[path]
        missing = np.nan if values.dtype.kind == 'f' else 0
        result = np.full((len(values) * per_message, len(names)), missing, values.dtype)
        if not values.shape[1]:
            return result
        if values.shape[1] != len(own) * per_message:
            raise InputError(
                f'{self.topic}: {path} has {values.shape[1]} values for {len(own)} names'
                + (f' and {per_message} samples' if per_message != 1 else '')
            )
        if len(set(own)) != len(own):
            raise InputError(f'{self.topic}: a name occurs twice in {", ".join(own)}')
        rows = values.reshape(-1, len(own))
        if own == tuple(names):
            return rows
        result[:, [names.index(name) for name in own]] = rows
        return result

    def in_order(
        self, parts: Sequence[NDArray[Any]], places: Sequence[NDArray[np.int64]] | None = None
    ) -> NDArray[Any]:
        """Concatenate arrays of all blocks in recorded order; places: row indices by block."""
        joined = np.concatenate(parts)
        order = np.concatenate(places or [block.order for block in self.blocks])
        if (np.diff(order) >= 0).all():
            return joined
        return joined[np.argsort(order, kind='stable')]
