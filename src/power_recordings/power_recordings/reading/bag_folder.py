"""The files of a recording and their messages, for each kind of storage."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import Reader, ReaderError
from wattwalk_core.errors import InputError
from wattwalk_core.yaml_file import read_yaml

from power_recordings.reading.mcap_file import Batch, McapFile, Topic

_BLOCK = 4096


@dataclass(frozen=True)
class Bag:
    """A bag folder or a single file of one."""

    path: Path
    folder: Path
    files: tuple[Path, ...]
    promised: int | None  # number of messages in metadata.yaml
    problems: tuple[str, ...]

    @property
    def is_sqlite(self) -> bool:
        """Whether the messages are in rosbag2's sqlite3 storage."""
        return self.files[0].suffix == '.db3'

    def batches(self, problems: list[str], topics: dict[str, Topic]) -> Iterator[Batch]:
        """Yield all messages; add to `problems` and to the declared `topics`."""
        if self.is_sqlite:
            yield from _sqlite(self.folder, topics)
            return
        for path in self.files:
            file = McapFile(path)
            yield from file.batches()
            problems += file.problems
            topics.update({topic.name: topic for topic in file.topics.values()})


def find(path: Path) -> Bag:
    """
    Return the bag at path, which is its folder or its .mcap file.

    Raises InputError if there is none, or if it is compressed as a whole.
    """
    if not path.exists():
        raise InputError(f'there is no recording {path}')
    if path.is_file():
        if path.suffix != '.mcap':
            raise InputError(f'{path} is not a recording: expected a bag folder or an .mcap file')
        return Bag(path, path.parent, (path,), None, ())
    if (path / 'metadata.yaml').exists():
        return _described(path)
    files = sorted(path.glob('*.mcap'), key=_number)
    if files:
        note = 'no metadata.yaml: the recorder was killed'
        return Bag(path, path, tuple(files), None, (note,))
    if any(path.glob('*.db3')):
        raise InputError(
            f'{path} has no metadata.yaml: run `ros2 bag reindex {path} sqlite3` first'
        )
    raise InputError(f'{path} is not a recording: it holds neither metadata.yaml nor *.mcap')


def _described(path: Path) -> Bag:
    file = path / 'metadata.yaml'
    try:
        content: Any = read_yaml(file, 'metadata')
        information = content['rosbag2_bagfile_information']
        names = [str(name) for name in information['relative_file_paths']]
        promised = int(information['message_count'])
        compressed = str(information.get('compression_mode') or '').lower()
    except (InputError, KeyError, TypeError, ValueError):
        files = sorted(path.glob('*.mcap'), key=_number)
        if not files:
            raise InputError(f'{file} is damaged and there is no .mcap file beside it') from None
        return Bag(path, path, tuple(files), None, ('metadata.yaml is damaged: not used',))
    if compressed in ('file', 'message'):
        raise InputError(
            f'{path} is compressed by {compressed}: run `ros2 bag convert` without '
            'compression_mode (compression inside MCAP is fine)'
        )
    listed = [path / Path(name).name for name in names]
    there = tuple(file for file in listed if file.exists())
    if not there:
        raise InputError(f'{path} lacks its data: metadata.yaml lists {", ".join(names)}')
    missing = [file.name for file in listed if not file.exists()]
    problems = (f'{", ".join(missing)} is missing',) if missing else ()
    return Bag(path, path, there, promised, problems)


def _number(path: Path) -> tuple[int, str]:
    digits = path.stem.rsplit('_', 1)[-1]
    return (int(digits) if digits.isdigit() else 0, path.name)


def _sqlite(folder: Path, topics: dict[str, Topic]) -> Iterator[Batch]:
    waiting: dict[str, list[tuple[int, bytes]]] = {}
    try:
        with Reader(folder) as reader:
            for connection in reader.connections:
                topics[connection.topic] = Topic(
                    connection.topic, connection.msgtype, 'cdr', connection.msgdef.data
                )
            for connection, time, raw in reader.messages():
                messages = waiting.setdefault(connection.topic, [])
                messages.append((time, raw))
                if len(messages) == _BLOCK:
                    yield joined(topics[connection.topic], waiting.pop(connection.topic))
    except ReaderError as error:
        raise InputError(f'{folder}: {error}') from error
    for name, messages in waiting.items():
        yield joined(topics[name], messages)


def joined(topic: Topic, messages: Sequence[tuple[int, bytes]]) -> Batch:
    """Return messages of a topic, (log time in ns, CDR bytes) each, as a batch."""
    sizes = np.array([len(raw) for _, raw in messages], np.int64)
    data = np.frombuffer(b''.join(raw for _, raw in messages), np.uint8)
    times = np.array([time for time, _ in messages], np.int64)
    return Batch(topic, data, np.cumsum(sizes) - sizes, sizes, times)
