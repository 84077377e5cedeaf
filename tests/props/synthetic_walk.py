"""A synthetic recording whose every array a test can change before it is written."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from power_recordings.alignment.align import align
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.messages import cdr
from power_recordings.reading.reader import Recording
from power_recordings.writing.writer import BagWriter

START = 1_700_000_000_000_000_000
NAMES = ('LF_HAA', 'LF_HFE', 'LF_KFE')
FEET = ('LF_FOOT', 'RF_FOOT', 'LH_FOOT', 'RH_FOOT')


def stamps(rate: float, seconds: float) -> np.ndarray:
    return START + np.rint(np.arange(round(rate * seconds)) * 1e9 / rate).astype(np.int64)


def aligned(walk: 'Walk', folder: Path, **options: Any) -> AlignedDataset:
    """Write a walk into a folder and align it."""
    return align(Recording.open(walk.write(folder / 'walk')), **options)


def seconds(data: AlignedDataset) -> np.ndarray:
    """Time since the start of a walk."""
    return data.time - START / 1e9


def spans(data: AlignedDataset) -> list[tuple[float, float]]:
    time = seconds(data)
    return [(time[part][0], time[part][-1]) for part in data.segments()]


def wave(time: np.ndarray, frequency: float, phase: float = 0.0) -> np.ndarray:
    return np.sin(2 * np.pi * frequency * time + phase)


@dataclass
class Walk:
    """
    Three drives at 48 V: electrical samples at 1 kHz, joint states at 400 Hz, commands at 50 Hz.

    Everything is constant until changed. `topics` holds more topics: (type, stamps, messages).
    """

    seconds: float = 3.0
    names: tuple[str, ...] = NAMES
    drive_names: tuple[str, ...] = NAMES
    supply_stamps: np.ndarray = field(init=False)
    sequence: np.ndarray = field(init=False)
    voltage: np.ndarray = field(init=False)
    current: np.ndarray = field(init=False)
    status: np.ndarray = field(init=False)
    joint_stamps: np.ndarray = field(init=False)
    position: np.ndarray = field(init=False)
    velocity: np.ndarray = field(init=False)
    effort: np.ndarray = field(init=False)
    command_stamps: np.ndarray = field(init=False)
    command: np.ndarray = field(init=False)
    topics: dict[str, tuple[str, np.ndarray, list[bytes]]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    late: Callable[[np.ndarray], np.ndarray] = field(default=lambda times: times)

    def __post_init__(self) -> None:
        self.supply_stamps = stamps(1000, self.seconds)
        self.joint_stamps = stamps(400, self.seconds)
        self.command_stamps = stamps(50, self.seconds)
        fast = (len(self.supply_stamps), len(self.drive_names))
        slow = (len(self.joint_stamps), len(self.names))
        self.sequence = np.arange(fast[0])
        self.voltage = np.full(fast, 48.0)
        self.current = np.full(fast, 2.0)
        self.status = np.zeros(fast, np.uint8)
        self.position, self.velocity, self.effort = (np.zeros(slow) for _ in range(3))
        self.command = np.full((len(self.command_stamps), slow[1]), 0.25)

    @property
    def supply_time(self) -> np.ndarray:
        """Seconds since START of the electrical samples, as a column."""
        return ((self.supply_stamps - START) / 1e9)[:, None]

    @property
    def joint_time(self) -> np.ndarray:
        return ((self.joint_stamps - START) / 1e9)[:, None]

    def drop_supply(self, rows: np.ndarray | slice) -> None:
        """Lose electrical samples, as a bus does."""
        for name in ('supply_stamps', 'sequence', 'voltage', 'current', 'status'):
            setattr(self, name, np.delete(getattr(self, name), rows, axis=0))

    def drop_joints(self, rows: np.ndarray | slice) -> None:
        for name in ('joint_stamps', 'position', 'velocity', 'effort'):
            setattr(self, name, np.delete(getattr(self, name), rows, axis=0))

    def all_topics(self) -> dict[str, tuple[str, np.ndarray, list[bytes]]]:
        columns = {
            'sequence': self.sequence,
            'device_time': (self.supply_stamps - START)[:, None],
            'voltage': self.voltage,
            'current': self.current,
            'temperature': np.full(self.voltage.shape, 40.0),
            'status': self.status,
        }
        lengths = {name: np.zeros(x.shape[1]) for name, x in columns.items() if x.ndim == 2}
        supply = cdr.in_a_list(
            cdr.encode_block(
                cdr.DRIVE_SUPPLY,
                self.supply_stamps,
                columns,
                name=list(self.drive_names),
                **lengths,
            )
        )
        joints = cdr.in_a_list(
            cdr.joint_state_block(
                self.joint_stamps, self.names, self.position, self.velocity, self.effort
            )
        )
        commands = cdr.in_a_list(
            cdr.joint_state_block(self.command_stamps, self.names, self.command)
        )
        found = {
            '/drive_supply': (cdr.DRIVE_SUPPLY, self.supply_stamps, supply),
            '/joint_states': (cdr.JOINT_STATE, self.joint_stamps, joints),
            '/joint_commands': (cdr.JOINT_STATE, self.command_stamps, commands),
            **self.topics,
        }
        return {name: topic for name, topic in found.items() if name not in self.left_out}

    def write(self, path: Path) -> Path:
        with BagWriter(path) as bag:
            messages = []
            for name, (type_name, times, data) in self.all_topics().items():
                topic = bag.add_topic(name, type_name)
                messages += [
                    (int(time), topic, message)
                    for time, message in zip(self.late(times), data, strict=True)
                ]
            for time, topic, message in sorted(messages, key=lambda m: m[0]):
                bag.write(topic, time, message)
        return path
