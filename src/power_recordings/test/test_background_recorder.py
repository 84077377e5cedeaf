import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from power_recordings.messages import cdr
from power_recordings.reading.reader import Recording
from power_recordings.writing.background import (
    BackgroundRecorder,
    RecordingProgress,
    SequenceCheck,
)
from power_recordings.writing.writer import BagWriter
from wattwalk_core.files import RecordingError

LONG = 30.0  # s, after which a test gives up


def wait_for(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < deadline, 'waited in vain'
        time.sleep(0.01)


def test_a_slow_disk_drops_and_counts_but_holds_nobody_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = BagWriter(tmp_path / 'walk', flush_period=10)
    stuck = threading.Event()
    write = bag.write

    def slow(*arguments: Any) -> None:
        assert stuck.wait(LONG)
        write(*arguments)

    monkeypatch.setattr(bag, 'write', slow)
    recorder = BackgroundRecorder(bag, most_waiting=10_000)
    recorder.declare('/supply', cdr.BATTERY_STATE)
    message = cdr.in_a_list(cdr.battery_block(np.zeros(1, np.int64), [1], [1]))[0]
    for i in range(500):
        recorder.put('/supply', i, message)
    waiting = recorder.progress()
    room = 10_000 // len(message) + 1
    assert waiting.dropped == {'/supply': 500 - room}
    assert waiting.waiting == room * len(message)
    stuck.set()
    recorder.close()
    assert f'{500 - room} messages of /supply were dropped' in recorder.summary()
    assert Recording.open(tmp_path / 'walk').topics['/supply'].count == room


def test_a_disk_that_fails_is_told_at_close_and_stops_the_queue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = BagWriter(tmp_path / 'walk', flush_period=10)

    def fail(*_: Any) -> None:
        raise RecordingError('the disk is full')

    monkeypatch.setattr(bag, 'write', fail)
    recorder = BackgroundRecorder(bag)
    recorder.declare('/supply', cdr.BATTERY_STATE)
    recorder.put('/supply', 0, b'\0\1\0\0')
    wait_for(lambda: recorder.failed)
    recorder.put('/supply', 1, b'\0\1\0\0')
    assert recorder.progress().dropped == {'/supply': 1}
    with pytest.raises(RecordingError, match='the disk is full'):
        recorder.close()
    said = '1 messages of /supply were dropped: writing failed (the disk is full)'
    assert said in recorder.summary()


@pytest.mark.parametrize('frame', ['', 'power_board', 'abcde', 'abcdefghij'])
@pytest.mark.parametrize('size', [1, 5])
def test_losses_are_found_in_the_bytes(frame: str, size: int) -> None:
    stamps = np.arange(100)
    values = np.ones((100, 3))
    block = cdr.in_a_list(
        *cdr.drive_supply_blocks(
            stamps, 2**40, stamps, 'abc', values, values, samples_per_message=size, frame_id=frame
        )
    )
    check = SequenceCheck()
    for message in block:
        check.feed(message)
    assert str(check) == 'all 100 samples of drive_supply came'
    check = SequenceCheck()
    for message in [*block[:3], b'\0\1\0\0', *block[5:]]:
        check.feed(message)
    assert (check.samples, check.lost, check.places) == (100 - 2 * size, 2 * size, 1)


def test_a_rate_counts_from_the_first_message() -> None:
    none = RecordingProgress(0.0, {}, {}, 0, 0, {})
    # 400 Hz from 9.5 s on: messages at 9.5, 9.5025, …, 10.0 s.
    early = RecordingProgress(10.0, {'/imu': 201}, {}, 0, 0, {'/imu': 9.5})
    assert early.rates(none) == {'/imu': pytest.approx(400.0)}
    late = RecordingProgress(11.0, {'/imu': 601}, {}, 0, 0, {'/imu': 9.5})
    assert late.rates(early) == {'/imu': pytest.approx(400.0)}
    assert late.rates(none) == {'/imu': pytest.approx(400.0)}
