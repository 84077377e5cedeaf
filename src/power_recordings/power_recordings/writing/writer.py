"""A writer of rosbag2 MCAP bags that survive a killed process and a full disk."""

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import IO, Self

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray
from wattwalk_core.errors import InputError
from wattwalk_core.files import RecordingError, advice, write_whole
from wattwalk_core.yaml_file import dump_yaml

from power_recordings.messages import cdr as messages
from power_recordings.writing.metadata import TopicSummary, information

_CHUNK_SIZE = 1 << 20
_RESERVE = 4 << 20
_LIBRARY = 'power_daq'


@dataclass(frozen=True)
class MessageBlock:
    """Messages of one topic and one size: log times ascending, ns [N]; CDR bytes [N, size]."""

    topic: int
    times: NDArray[np.int64]
    messages: NDArray[np.uint8]

    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield time, topic and bytes of each message."""
        for time, raw in zip(self.times.tolist(), messages.in_a_list(self.messages), strict=True):
            yield time, self.topic, raw


class _Output:
    """A file of complete records, with space reserved for the end of the bag.

    What the MCAP writer writes waits in `parts` until `save` appends it to the file.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(
            path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644
        )
        self.size = 0
        self.parts: list[bytes] = []
        self._reserve: IO[bytes] | None = None
        try:
            self._reserve = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115
            os.posix_fallocate(self._reserve.fileno(), 0, _RESERVE)
        except OSError:
            self.close()
            path.unlink()
            raise

    def write(self, data: bytes) -> int:
        if data:
            self.parts.append(bytes(data))
        return len(data)

    def tell(self) -> int:
        return self.size + sum(map(len, self.parts))

    def flush(self) -> None:
        pass

    def save(self) -> None:
        """Append all that waits; on OSError the file keeps its former end."""
        records = b''.join(self.parts)
        rest = memoryview(records)
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            os.ftruncate(self._descriptor, self.size)
            os.lseek(self._descriptor, self.size, os.SEEK_SET)
            raise
        self.size += len(records)
        self.parts.clear()

    def release_reserve(self) -> None:
        """Free the reserved space."""
        if self._reserve is not None:
            self._reserve.close()
            self._reserve = None

    def sync(self) -> None:
        """Wait until the disk holds the file."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Release everything."""
        self.release_reserve()
        os.close(self._descriptor)


class BagWriter:
    """A rosbag2 bag `path/` with `<name>_0.mcap` and, once closed, metadata.yaml.

    Messages are collected in zstd-compressed chunks. A chunk is given to the operating system once
    its log times span `flush_period` seconds (or it has 1 MiB), or on `flush`; a killed process
    loses no more than that. The disk is synced at `close` only: a power cut may lose what the
    operating system has not written yet. The same calls give the same bytes.

    If the disk fills, space that was reserved in the folder takes the last chunk and the index,
    the bag is closed, and RecordingError is raised; nothing given to `write` is lost. If that
    fails too, the bag ends with the last complete chunk and the error counts the lost messages.

    Raises InputError if path exists (unless `overwrite`, which replaces only bags) and
    RecordingError if it cannot be written.
    """

    def __init__(
        self, path: Path, *, overwrite: bool | None = None, flush_period: float = 0.5
    ) -> None:
        if not 0 < flush_period <= 10:
            raise InputError(f'flush_period is {flush_period} s; it must be in (0, 10]')
        self.path = Path(path)
        self.file = self.path / f'{self.path.resolve().name}_0.mcap'
        self._period = round(flush_period * 1e9)
        self._schemas: dict[str, int] = {}
        self._topics: dict[int, TopicSummary] = {}
        self._first: int | None = None
        self._last = 0
        self._chunk_start: int | None = None
        self._saved = 0
        self._closed = False
        make_way(self.path, overwrite)
        try:
            self.path.mkdir(parents=True)
            self._output = _Output(self.file)
        except OSError as error:
            with suppress(OSError):
                self.path.rmdir()
            raise RecordingError(f'cannot record to {self.path}: {advice(error)}') from error
        self._mcap = Writer(self._output, _CHUNK_SIZE)  # type: ignore[arg-type]
        self._mcap.start('ros2', _LIBRARY)
        self._save()

    @property
    def counts(self) -> Mapping[str, int]:
        """Number of messages given to `write`, by topic."""
        return {topic.name: topic.count for topic in self._topics.values()}

    @property
    def size(self) -> int:
        """Bytes in the file so far."""
        return self._output.size

    def add_topic(self, name: str, type_name: str, reliability: str = 'reliable') -> int:
        """Declare a topic and return its handle for `write`.

        A name without a leading slash is taken to be in the root namespace.
        Raises InputError for an unknown type or reliability or a topic that is there already.
        """
        self._must_be_open()
        name = name if name.startswith('/') else f'/{name}'
        type_name = messages.full_name(type_name)
        summary = TopicSummary(name, type_name, messages.type_hash(type_name), reliability)
        if name in self.counts:
            raise InputError(f'topic {name!r} is in the bag already')
        if type_name not in self._schemas:
            text = messages.definition(type_name).encode()
            self._schemas[type_name] = self._mcap.register_schema(type_name, 'ros2msg', text)
        topic = self._mcap.register_channel(
            name,
            'cdr',
            self._schemas[type_name],
            {
                'offered_qos_profiles': dump_yaml([summary.profile()]).rstrip(),
                'topic_type_hash': summary.type_hash,
            },
        )
        self._topics[topic] = summary
        return topic

    def write(self, topic: int, log_time_ns: int, cdr: bytes) -> None:
        """Add a message that arrived at log_time_ns.

        Raises RecordingError if the disk refuses (the bag is then closed) or the bag is closed,
        InputError for a topic that `add_topic` did not return.
        """
        self._must_be_open()
        if topic not in self._topics:
            raise InputError(f'no topic {topic!r} in this bag: call add_topic first')
        time = int(log_time_ns)
        if self._chunk_start is None:
            self._chunk_start = time
        self._first = time if self._first is None else min(self._first, time)
        self._last = max(self._last, time)
        self._topics[topic].count += 1
        self._mcap.add_message(topic, time, cdr, time)
        if abs(time - self._chunk_start) >= self._period:
            self.flush()
        elif self._output.parts:
            self._save()

    def write_blocks(self, blocks: Sequence[MessageBlock]) -> None:
        """Add messages of several topics in the order of their times, equal ones as given.

        Raises RecordingError as `write` does.
        """
        rows = merge(*(block.rows() for block in blocks), key=itemgetter(0))
        for time, topic, message in rows:
            self.write(topic, time, message)

    def flush(self) -> None:
        """Give all messages so far to the operating system; RecordingError if it refuses."""
        self._must_be_open()
        self._mcap.flush()
        self._save()

    def close(self) -> None:
        """Write the index and metadata.yaml and sync the disk; a second call does nothing.

        Raises RecordingError if the disk refuses; the messages are then readable without index.
        """
        if self._closed:
            return
        self.flush()
        self._output.release_reserve()
        try:
            self._finish()
        except OSError as error:
            raise RecordingError(
                f'{self.path}: the index could not be written: {advice(error)}. All '
                f'{self._saved} messages are readable'
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _must_be_open(self) -> None:
        if self._closed:
            raise RecordingError(f'the bag {self.path} is closed')

    def _save(self) -> None:
        self._chunk_start = None
        try:
            self._output.save()
        except OSError as error:
            raise self._rescue(error) from error
        self._saved = sum(self.counts.values())

    def _rescue(self, cause: OSError) -> RecordingError:
        """Close the bag in the reserved space and return the error to raise."""
        stopped = f'recording to {self.path} stopped: {advice(cause)}'
        self._output.release_reserve()
        try:
            self._output.save()
            self._saved = sum(self.counts.values())
            self._finish()
        except OSError:
            self._closed = True
            self._output.close()
            lost = sum(self.counts.values()) - self._saved
            return RecordingError(
                f'{stopped}. The {self._saved} messages in the bag are readable, though it has '
                f'no index; {lost} messages are lost'
            )
        return RecordingError(
            f'{stopped}. The bag is closed; it holds all {self._saved} messages up to now'
        )

    def _finish(self) -> None:
        self._closed = True
        topics = list(self._topics.values())
        content = information(self.file.name, topics, self._first or 0, self._last)
        try:
            self._mcap.add_metadata('rosbag2', {'serialized_metadata': dump_yaml(content)})
            self._mcap.finish()
            self._output.save()
            self._output.sync()
        finally:
            self._output.close()
        whole = {'rosbag2_bagfile_information': content}
        write_whole(self.path / 'metadata.yaml', dump_yaml(whole))


@contextmanager
def staged(path: Path) -> Iterator[Path]:
    """Yield a temporary path for a recording, which is moved to `path` if no error occurs.

    After an error nothing is left. Raises RecordingError where `path` cannot be written.
    """
    there = next(parent for parent in path.absolute().parents if parent.exists())
    try:
        folder = Path(tempfile.mkdtemp(prefix='.import_', dir=there))
    except OSError as error:
        raise RecordingError(f'cannot record to {path}: {advice(error)}') from error
    try:
        whole = folder / path.absolute().name
        yield whole
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            make_way(path, overwrite=True)
            whole.rename(path)
        except OSError as error:
            raise RecordingError(f'cannot record to {path}: {advice(error)}') from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def make_way(path: Path, overwrite: bool | None, *, remove: bool = True) -> None:
    """Remove a recording at `path` to replace it; without `remove`, only check that one may.

    InputError if there is something but a recording or, unless `overwrite` (None: no option), any.
    """
    try:
        path.lstat()
    except FileNotFoundError:
        return
    except OSError as error:
        raise RecordingError(f'cannot record to {path}: {advice(error)}') from error
    except ValueError as error:
        raise InputError(f'cannot record to {str(path)!r}: {error}') from error
    recording = path.is_dir() and any(path.glob('*_0.mcap'))
    if not overwrite:
        other = ', or --overwrite' if recording and overwrite is False else ' or remove it'
        raise InputError(f'{path} exists already: choose another name{other}')
    if not recording:
        raise InputError(f'{path} is not a recording, so it is not replaced: choose another name')
    if remove:
        shutil.rmtree(path)
