"""From an ODrive or moteus on the bus to a recording with its card: docs/how-to/own_bus.md."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from moteus_emulator import MoteusEmulator, ServoBus
from odrive_emulator import ODriveEmulator
from power_recordings.reading.reader import Recording


@pytest.fixture
def channel(tmp_path: Path) -> str:
    return str(tmp_path / 'bus')


@pytest.fixture
def host(channel: str) -> Iterator[can.BusABC]:
    with can.Bus(interface='unixsocket', channel=channel, host=True) as bus:
        yield bus


def send(bus: can.BusABC, axes: list[ODriveEmulator], stop: threading.Event) -> None:
    start = time.monotonic()
    sent = sorted((p for a in axes for p in a.schedule(90.0)), key=lambda pair: pair[0])
    for t, message in sent:
        if stop.wait(max(0.0, start + t - time.monotonic())):
            return
        bus.send(message)


def recorded(node_process: Any, folder: Path, channel: str, *words: str) -> Recording:
    """Run the DAQ with a ready bus and record until it has some seconds."""
    there = ('--ros-args', '-p', 'interface:=unixsocket', '-p', f'channel:={channel}')
    daq = node_process('power_daq', 'daq', *words, *there)
    daq.wait_for_output('reading unixsocket')
    recorder = node_process('power_daq', 'record', '-o', str(folder), '--duration', '5')
    recorder.wait()
    daq.interrupt()
    assert daq.wait() == 0, daq.output
    return Recording.open(folder)


def test_odrives_are_recorded_under_the_names_of_their_drives(
    node_process: Any, host: can.BusABC, channel: str, tmp_path: Path
) -> None:
    hip, knee, stop = ODriveEmulator(0), ODriveEmulator(3), threading.Event()
    axes = threading.Thread(target=send, args=(host, [hip, knee], stop))
    axes.start()
    try:
        recording = recorded(
            node_process,
            tmp_path / 'bag',
            channel,
            '--bus',
            'odrive',
            '--drives',
            'hip=0',
            'knee=3',
        )
    finally:
        stop.set()
        axes.join()
    card, joints, supply = recording.card, recording.joint_states(), recording.drive_supply()
    assert card.drives == joints.names == ('hip', 'knee')
    assert card.torque == {'hip': 'motor', 'knee': 'motor'}
    turns = joints.position / (2 * np.pi)
    assert np.nanmax(np.abs(turns - [0, 3])) <= 0.5 + 1e-6
    assert np.nanmean(turns, axis=0) == pytest.approx([0, 3], abs=0.3)
    assert len(supply) > 300
    apart = supply.current[:, 1] - supply.current[:, 0]
    assert np.nanmedian(apart) == pytest.approx(3.0, abs=0.05)


def test_moteus_servos_are_polled_and_recorded(
    node_process: Any, host: can.BusABC, channel: str, tmp_path: Path
) -> None:
    servos = ServoBus(host, MoteusEmulator(1), MoteusEmulator(12))
    servos.start()
    try:
        recording = recorded(
            node_process,
            tmp_path / 'bag',
            channel,
            '--bus',
            'moteus',
            '--drives',
            'hip=1',
            'knee=12',
        )
    finally:
        servos.stop.set()
        servos.join()
    supply = recording.drive_supply()
    assert recording.card.torque == {'hip': 'motor', 'knee': 'motor'}
    assert len(supply) > 500
    good = (supply.status == 0).all(axis=1)
    assert good.mean() > 0.8, 'replies are late on a busy machine, and flagged then'
    np.testing.assert_allclose(supply.current[good], [[0.5, 6.0]] * good.sum())


@pytest.mark.parametrize(
    ('words', 'line'),
    [
        (['--bus', 'odriv'], "no bus 'odriv': expected one of odrive, moteus"),
        (['--bus', 'odrive', '--drives', 'hip'], "there is 'hip'"),
        (['--bus', 'odrive', '--drives', 'hip=64'], 'expected a node from 0 to 63, there is 64'),
        (['--drives', 'hip=1'], 'has no nodes'),
        (['--bus', "o'drive"], 'expected names without quotes'),
    ],
)
def test_wrong_words_end_the_daq_with_one_line(
    node_process: Any, words: list[str], line: str
) -> None:
    daq = node_process('power_daq', 'daq', *words)
    assert daq.wait() == 2
    assert line in daq.output
    assert len([text for text in daq.output.splitlines() if 'daq: ' in text]) == 1
