"""ROS 1 bags and rosbag2 bags (MCAP, SQLite; folders and bare files), numbers by `topic:field`."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, printable
from wattwalk_core.files import regular_size
from wattwalk_core.yaml_file import read_text

from power_recordings.importing.sources.source import LogBlock, LogColumn, LogSource, Progress
from power_recordings.messages.batch import Batch, Skip, Topic
from power_recordings.messages.cdr import fields_of, full_type, own_fields
from power_recordings.messages.cdr_layout import Layout
from power_recordings.messages.topic_columns import MessageSorter, TooManyLayoutsError
from power_recordings.reading.bag_folder import Bag, find

_MOST_COLUMNS: Final = 400  # of one topic that are listed
_STAMP: Final = ('header.stamp.sec', 'header.stamp.nanosec')


class BagFile(LogSource):
    """The topics of a bag, one stream each; a field is `topic:field.path[i]` or `…[name]`."""

    is_bag = True

    def __init__(self, path: Path, messages: Path | None = None) -> None:
        self.path = path
        is_ros1 = path.suffix.lower() == '.bag' and not path.is_dir()
        self._bag = Bag(path, path.parent, (path,), None, ()) if is_ros1 else find(path)
        self.size = sum(regular_size(file, 'recording') for file in self._bag.files)
        self.problems: list[str] = []
        self.counts: Counter[str] = Counter()
        self._given = _given_types(messages)
        self._fields: dict[str, Mapping[str, Any]] = {}
        self._examples: dict[str, Layout] = {}
        self._errors: dict[str, str] = {}
        for batch in self._batches(self._known):
            name = batch.topic.name
            self.counts[name] += len(batch.offsets)
            if name not in self._examples and name not in self._errors and len(batch.offsets):
                first = slice(batch.offsets[0], batch.offsets[0] + batch.sizes[0])
                try:
                    self._examples[name] = self._layout(batch.topic, batch.data[first].tobytes())
                except InputError as error:
                    self._errors[name] = str(error)
        if not self.counts:
            why = ''.join(f': {problem}' for problem in self.problems[:1])
            raise InputError(f'{path} holds no messages{why}')

    def _known(self, counts: Mapping[str, int]) -> bool:
        """Count the messages of a chunk and leave it out where all its topics have an example."""
        known = counts.keys() <= self._examples.keys() | self._errors.keys()
        if known:
            self.counts.update(counts)
        return known

    def columns(self) -> Sequence[LogColumn]:
        """Return up to 400 numeric fields of each topic, by its first message."""
        found = []
        for topic, layout in self._examples.items():
            listed: list[str] = []
            for path, column in layout.columns.items():
                if path in _STAMP or column.count == 0:
                    continue
                names = _names(layout, path, column.count)
                listed += [path] if column.count is None else [f'{path}[{n}]' for n in names]
            rows = self.counts[topic]
            found += [LogColumn(f'{topic}:{p}', topic, '', rows) for p in listed[:_MOST_COLUMNS]]
        return found

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield blocks of the columns at `topic:field` addresses, in the order of the file.

        A block has n messages of one topic: float64 [n] by address, NaN where a message lacks the
        field, with header and log stamps in ns; blocks of several topics alternate as recorded.
        A last block without a stream has the bag's problems as notes. InputError for a topic that
        is not there or cannot be decoded.
        """
        wanted: dict[str, list[str]] = defaultdict(list)
        for address in addresses:
            topic, _, field = address.partition(':')
            wanted[topic].append(field)
            if topic in self._errors:
                raise InputError(self._errors[topic])
            if topic not in self.counts:
                raise InputError(f'{self.path}: no topic {topic!r}')
        sorters: dict[str, MessageSorter] = {}
        done, total = 0, sum(self.counts.values())

        def unwanted(counts: Mapping[str, int]) -> bool:
            nonlocal done
            if counts.keys() & wanted:
                return False
            done += sum(counts.values())
            return True

        for batch in self._batches(unwanted):
            name = batch.topic.name
            done += len(batch.offsets)
            progress(round(self.size * min(done / total, 1.0)))
            if name in wanted:
                if name not in sorters:
                    sorters[name] = MessageSorter(partial(self._layout, batch.topic))
                yield self._decode(batch, wanted[name], sorters[name])
        if self.problems:
            yield LogBlock('', {}, notes=tuple(self.problems))

    def _decode(self, batch: Batch, fields: Sequence[str], sorter: MessageSorter) -> LogBlock:
        count, topic = len(batch.offsets), batch.topic.name
        values = {f'{topic}:{f}': np.full(count, np.nan) for f in fields}
        stamps = np.zeros(count, np.int64)
        try:
            for layout, places, rows in sorter.sort(batch):
                if layout is None:
                    continue
                for field in fields:
                    values[f'{topic}:{field}'][places] = _numbers(layout, rows, field)
                if _STAMP[0] in layout.columns:
                    sec, nsec = (_whole(layout.decode(rows, p)) for p in _STAMP)
                    stamps[places] = sec * 1_000_000_000 + nsec
        except TooManyLayoutsError:
            raise InputError(
                f'{self.path}: texts or lengths in {topic} change in nearly every message; '
                'expected ones that stay'
            ) from None
        return LogBlock(topic, values, stamps, batch.log_times)

    def _layout(self, topic: Topic, example: bytes) -> Layout:
        kind = full_type(topic.type_name)
        if topic.name not in self._fields:
            if topic.encoding not in ('cdr', 'ros1'):
                raise InputError(
                    f'{self.path}: {printable(topic.name)} is encoded as '
                    f'{printable(topic.encoding, 40)}; expected cdr or ros1'
                )
            try:
                self._fields[topic.name] = fields_of(topic.definition, kind, self._given)
            except ValueError as error:
                raise InputError(
                    f'{self.path}: the definition of {printable(topic.name)} cannot be read: '
                    f'{printable(str(error))}'
                ) from None
        fields = self._fields[topic.name]
        if kind not in fields:
            raise InputError(
                f'{self.path}: {printable(topic.name)} has messages of {printable(kind, 80)}, '
                'which the bag does not define; give its .msg files with --msgs DIR'
            )
        try:
            return Layout(fields, kind, example, is_ros1=topic.encoding == 'ros1')
        except ValueError as error:
            raise InputError(
                f'{self.path}: {printable(topic.name)}: a damaged message: {error}'
            ) from None

    def _batches(self, skip: Skip = None) -> Iterator[Batch]:
        self.problems = list(self._bag.problems)
        yield from self._bag.batches(self.problems, {}, skip)


def _given_types(folder: Path | None) -> dict[str, Any]:
    """Types of a folder of `package/msg/Name.msg` (or `package/Name.msg`) files."""
    if folder is None:
        return {}
    files = sorted(folder.rglob('*.msg'))
    if not files:
        raise InputError(f'--msgs {folder}: no .msg files there')
    types: dict[str, Any] = {}
    for file in files:
        package = file.parent.parent.name if file.parent.name == 'msg' else file.parent.name
        try:
            text = read_text(file, 'message')
            types.update(own_fields(text, f'{package}/msg/{file.stem}'))
        except ValueError as error:
            raise InputError(f'--msgs {file}: {printable(str(error))}') from None
    return types


@np.errstate(invalid='ignore')
def _whole(values: NDArray[Any]) -> NDArray[np.int64]:
    return values.astype(np.int64)


def _names(layout: Layout, path: str, count: int | None) -> list[str]:
    """Names of the values of an array: those of the message's `name` field, else indices."""
    prefix = path.rpartition('.')[0]
    names = layout.strings.get(f'{prefix}.name' if prefix else 'name')
    if isinstance(names, tuple) and len(names) == count and len(set(names)) == count:
        return list(names)
    return [str(i) for i in range(count or 0)]


@np.errstate(invalid='ignore')
def _numbers(layout: Layout, rows: NDArray[np.uint8], field: str) -> Floats:
    if field in layout.columns and layout.columns[field].count is None:
        return np.asarray(layout.decode(rows, field), np.float64)
    path, _, index = field.removesuffix(']').rpartition('[')
    column = layout.columns.get(path)
    if column is None or not column.count:
        return np.full(len(rows), np.nan)
    names = _names(layout, path, column.count)
    place = names.index(index) if index in names else int(index) if index.isdigit() else -1
    if not 0 <= place < column.count:
        return np.full(len(rows), np.nan)
    return np.asarray(layout.decode(rows, path)[:, place], np.float64)
