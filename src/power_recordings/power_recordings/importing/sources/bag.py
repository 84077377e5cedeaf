"""ROS 1 bags and rosbag2 bags (MCAP, SQLite; folders and bare files), numbers by `topic:field`."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import ReaderError as Ros1Error
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.rosbag2 import ReaderError as Ros2Error
from rosbags.serde import SerdeError
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import printable
from wattwalk_core.yaml_file import read_text

from power_recordings.importing.sources.source import LogBlock, LogColumn, Progress
from power_recordings.messages.cdr_layout import Layout
from power_recordings.reading import bag_folder
from power_recordings.reading.mcap_file import Batch, Topic, windows

_MOST_LAYOUTS: Final = 256
_MOST_COLUMNS: Final = 400  # of one topic that are listed
_BLOCK: Final = 4096
_STAMP: Final = ('header.stamp.sec', 'header.stamp.nanosec')


def open_file(path: Path, messages: Path | None = None) -> 'BagFile':
    """Open a bag; InputError for one that is damaged or whose types are unknown."""
    return BagFile(path, messages)


class BagFile:
    """The topics of a bag, one stream each; a field is `topic:field.path[i]` or `…[name]`."""

    is_bag = True

    def __init__(self, path: Path, messages: Path | None = None) -> None:
        self.path = path
        files = path.rglob('*') if path.is_dir() else [path]
        self.size = sum(file.stat().st_size for file in files if file.is_file())
        self.problems: list[str] = []
        self.topics: dict[str, Topic] = {}
        self.counts: dict[str, int] = {}
        self._given = _given_types(messages)
        self._stores: dict[str, Typestore] = {}
        self._examples: dict[str, Layout] = {}
        self._errors: dict[str, str] = {}
        for batch in self._batches():
            name = batch.topic.name
            self.topics.setdefault(name, batch.topic)
            self.counts[name] = self.counts.get(name, 0) + len(batch.offsets)
            if name not in self._examples and name not in self._errors and len(batch.offsets):
                first = slice(batch.offsets[0], batch.offsets[0] + batch.sizes[0])
                try:
                    self._examples[name] = self._layout(batch.topic, batch.data[first].tobytes())
                except InputError as error:
                    self._errors[name] = str(error)
        if not self.counts:
            why = ''.join(f': {problem}' for problem in self.problems[:1])
            raise InputError(f'{path} holds no messages{why}')

    def columns(self) -> Sequence[LogColumn]:
        """Return the numbers of each topic, as its first message has them."""
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
        """Yield the named numbers topic by topic, as the messages come."""
        wanted: dict[str, list[str]] = defaultdict(list)
        for address in addresses:
            topic, _, field = address.partition(':')
            wanted[topic].append(field)
            if topic in self._errors:
                raise InputError(self._errors[topic])
            if topic not in self.counts:
                raise InputError(f'{self.path}: no topic {topic!r}')
        layouts: dict[str, dict[int, list[Layout]]] = {t: defaultdict(list) for t in wanted}
        done, total = 0, sum(self.counts.values())
        for batch in self._batches():
            done += len(batch.offsets)
            progress(round(self.size * done / total))
            if batch.topic.name in wanted:
                name = batch.topic.name
                yield self._decode(batch, wanted[name], layouts[name])

    def _decode(
        self, batch: Batch, fields: Sequence[str], layouts: dict[int, list[Layout]]
    ) -> LogBlock:
        count, topic = len(batch.offsets), batch.topic.name
        values = {f'{topic}:{f}': np.full(count, np.nan) for f in fields}
        stamps = np.zeros(count, np.int64)
        for size in np.unique(batch.sizes).tolist():
            left = np.flatnonzero(batch.sizes == size)
            if size < 4:
                continue
            rows = windows(batch.data, size)[batch.offsets[left]]
            known = layouts[size]
            tried = 0
            while len(left):
                if tried == len(known):
                    if len(known) == _MOST_LAYOUTS:
                        raise InputError(
                            f'{self.path}: texts or lengths in {topic} change in nearly every '
                            'message; expected ones that stay'
                        )
                    known.append(self._layout(batch.topic, rows[0].tobytes()))
                layout = known[tried]
                tried += 1
                same = layout.matches(rows)
                if not same.any():
                    continue
                for field in fields:
                    values[f'{topic}:{field}'][left[same]] = _numbers(layout, rows[same], field)
                if _STAMP[0] in layout.columns:
                    sec, nsec = (layout.decode(rows[same], p).astype(np.int64) for p in _STAMP)
                    stamps[left[same]] = sec * 1_000_000_000 + nsec
                left, rows = left[~same], rows[~same]
        return LogBlock(topic, values, stamps, batch.log_times)

    def _layout(self, topic: Topic, example: bytes) -> Layout:
        store = self._store(topic)
        if topic.type_name not in store.fielddefs:
            raise InputError(
                f'{self.path}: {topic.name} has messages of {printable(topic.type_name, 80)}, '
                'which the bag does not define; give its .msg files with --msgs DIR'
            )
        try:
            return Layout(store, topic.type_name, example)
        except (ValueError, RecursionError) as error:
            raise InputError(f'{self.path}: {topic.name}: a damaged message: {error}') from None

    def _store(self, topic: Topic) -> Typestore:
        if topic.name not in self._stores:
            store = get_typestore(Stores.ROS2_JAZZY)
            try:
                if topic.definition:
                    found = _definitions(topic)
                    store.register({k: v for k, v in found.items() if k not in store.fielddefs})
                store.register({k: v for k, v in self._given.items() if k not in store.fielddefs})
            except (TypesysError, KeyError, ValueError, RecursionError) as error:
                raise InputError(
                    f'{self.path}: the definition of {topic.name} cannot be read: '
                    f'{printable(str(error))}'
                ) from None
            self._stores[topic.name] = store
        return self._stores[topic.name]

    def _batches(self) -> Iterator[Batch]:
        suffix = self.path.suffix.lower()
        if self.path.is_dir() or suffix == '.mcap':
            problems: list[str] = []
            for batch in bag_folder.find(self.path).batches(problems, self.topics):
                if batch.topic.encoding not in ('cdr', 'ros1'):
                    raise InputError(
                        f'{self.path}: {batch.topic.name} is encoded as '
                        f'{printable(batch.topic.encoding, 40)}; expected cdr'
                    )
                yield batch
            self.problems = problems
            return
        kind: Any = Ros1Reader if suffix == '.bag' else Ros2Reader
        try:
            with kind(self.path) as reader:
                yield from self._gathered(reader, is_ros1=suffix == '.bag')
        except (Ros1Error, Ros2Error, SerdeError, OSError, ValueError, KeyError) as error:
            reason = printable(str(error) or type(error).__name__)
            raise InputError(f'{self.path}: not a readable bag: {reason}') from None

    def _gathered(self, reader: Any, *, is_ros1: bool) -> Iterator[Batch]:
        waiting: dict[int, list[tuple[int, bytes]]] = defaultdict(list)
        topics = {
            c.id: Topic(c.topic, c.msgtype, 'cdr', c.msgdef.data) for c in reader.connections
        }
        for connection, time, raw in reader.messages():
            topic = topics[connection.id]
            if is_ros1:
                try:
                    raw = bytes(self._store(topic).ros1_to_cdr(raw, topic.type_name))
                except (SerdeError, KeyError, IndexError, ValueError) as error:
                    raise InputError(
                        f'{self.path}: {topic.name}: a damaged message: {error}'
                    ) from None
            waiting[connection.id].append((time, raw))
            if len(waiting[connection.id]) == _BLOCK:
                yield bag_folder.joined(topic, waiting.pop(connection.id))
        for number, messages in waiting.items():
            yield bag_folder.joined(topics[number], messages)


def _definitions(topic: Topic) -> dict[str, Any]:
    text = topic.definition
    separator = '=' * 80 + '\n'
    if text.startswith(f'{separator}IDL: '):
        parts = [part.split('\n', 1)[1] for part in text.split(separator)[1:]]
        return {k: v for part in parts for k, v in get_types_from_idl(part).items()}
    return dict(get_types_from_msg(text, topic.type_name))


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
            types.update(get_types_from_msg(text, f'{package}/msg/{file.stem}'))
        except TypesysError as error:
            raise InputError(f'--msgs {file}: {printable(str(error))}') from None
    return types


def _names(layout: Layout, path: str, count: int | None) -> list[str]:
    """Names of the values of an array: those of the message's `name` field, else indices."""
    prefix = path.rpartition('.')[0]
    names = layout.strings.get(f'{prefix}.name' if prefix else 'name')
    if isinstance(names, tuple) and len(names) == count and len(set(names)) == count:
        return list(names)
    return [str(i) for i in range(count or 0)]


def _numbers(layout: Layout, rows: NDArray[np.uint8], field: str) -> NDArray[np.float64]:
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
