"""Bags of a soak as rows of numbered samples, just as they lie in the file."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_recordings.messages.batch import Topic
from power_recordings.messages.samples import DriveSamples, JointSamples, Samples, SupplySamples
from power_recordings.messages.topic_columns import Columns
from power_recordings.messages.topics import KINDS
from power_recordings.reading import bag_folder
from power_recordings.reading.reader import Recording
from soak_account import BagRows
from soak_devices import current_numbers, position_numbers, supply_numbers
from wattwalk_core.errors import InputError

STREAMS = {'electrical': 'drive_supply', 'joints': 'joint_states', 'supply': 'supply'}
_CAME = r'(?:all |places \()(\d+) (?:samples of drive_supply )?came'
_LOST = r'drive_supply lost (\d+) samples'


def rows(
    path: Path, begun: dict[str, int], ended: dict[str, int], how: str, said: str
) -> dict[str, BagRows]:
    """
    A bag by stream; a stream that it lacks is empty.

    begun and ended: counts of the devices by stream; said: what the recorder wrote at its end.
    """
    raw = _raw(path)
    kept = _kept(path)
    lost = told_lost(said)
    found = {}
    for stream, topic in STREAMS.items():
        samples = raw.get(topic)
        electrical = samples if isinstance(samples, DriveSamples) else None
        found[stream] = BagRows(
            path.name,
            _numbers(samples),
            begun[stream],
            ended[stream],
            how,
            kept.get(topic, 0),
            None if electrical is None else electrical.sequence.astype(np.int64),
            None if electrical is None else electrical.device_time.astype(np.int64),
            told_came(said, topic),
            lost if stream == 'electrical' else None,
        )
    return found


def messages(path: Path) -> int:
    """All messages in a bag."""
    return sum(len(batch.offsets) for batch in bag_folder.find(path).batches([], {}))


def _numbers(samples: Samples | None) -> NDArray[np.int64]:
    if isinstance(samples, DriveSamples):
        return current_numbers(samples.current)
    if isinstance(samples, JointSamples):
        return position_numbers(samples.position)
    if isinstance(samples, SupplySamples):
        return supply_numbers(samples.voltage, samples.current)
    return np.zeros(0, np.int64)


def _raw(path: Path) -> dict[str, Samples]:
    """Streams of a bag before anything is cut out of them."""
    columns: dict[str, Columns] = {}
    topics: dict[str, Topic] = {}
    for batch in bag_folder.find(path).batches([], topics):
        name = batch.topic.name.rsplit('/', 1)[-1]
        if name in STREAMS.values():
            kind = KINDS[name]
            if name not in columns:
                columns[name] = Columns(name, kind.type_name, kind.paths)
            columns[name].add(batch)
    build: dict[str, Callable[[Columns], Samples]] = {name: KINDS[name].build for name in columns}
    return {name: build[name](found) for name, found in columns.items() if found.blocks}


def _kept(path: Path) -> dict[str, int]:
    """Samples by topic that a reader gives out."""
    try:
        recording = Recording.open(path)
    except InputError:
        return {}
    return {
        topic: len(getattr(recording, topic)())
        for topic in STREAMS.values()
        if recording.has(topic)
    }


def told_came(said: str, topic: str) -> int | None:
    """Samples of a topic that a recorder said came; None where it did not."""
    words = _CAME if topic == 'drive_supply' else rf'^/?{topic} +(\d+) messages'
    found = re.search(words, said, re.MULTILINE)
    return int(found[1]) if found else None


def told_lost(said: str) -> int | None:
    """Samples of drive_supply that a recorder said were lost; None where it did not."""
    if re.search(_CAME, said) is None:
        return None
    found = re.search(_LOST, said)
    return int(found[1]) if found else 0
