"""
Speed of alignment, from a bag to a dataset, as a multiple of real time.

The ratio counts CPU time, so that it is that of one core whatever else runs.

    python bench/alignment.py [--seconds 120] [--keep BAG]
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from power_recordings.alignment.align import load_aligned
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter

TARGET = 200.0
START = 1_700_000_000_000_000_000
JOINTS = [f'{leg}_{joint}' for leg in ('LF', 'RF', 'LH', 'RH') for joint in ('HAA', 'HFE', 'KFE')]
FEET = [f'{leg}_FOOT' for leg in ('LF', 'RF', 'LH', 'RH')]


def write_bag(path: Path, seconds: float) -> int:
    """Write a synthetic recording with all topics of a walking robot; the number of messages."""
    random = np.random.default_rng(0)

    def stamps(rate: float) -> np.ndarray:
        return START + (np.arange(seconds * rate) * 1e9 / rate).astype(np.int64)

    def waves(rate: float, columns: int) -> np.ndarray:
        phase = 2 * np.pi * 1.7 * np.arange(seconds * rate)[:, None] / rate + np.arange(columns)
        return np.sin(phase) + 0.05 * random.normal(size=phase.shape)

    fast, joint, slow, supply = stamps(1000), stamps(400), stamps(50), stamps(100)
    current = 3 * waves(1000, 12)
    unit = np.tile([0.0, 0.0, 0.0, 1.0], (len(joint), 1))
    blocks = {
        'drive_supply': cdr.encode_drive_supply(
            fast, 0, fast - START, JOINTS, 48 - 0.1 * current, current, np.full(12, 40.0)
        ),
        'joint_states': cdr.encode_joint_states(
            joint, JOINTS, waves(400, 12), waves(400, 12), 20 * waves(400, 12)
        ),
        'joint_commands': cdr.encode_joint_states(slow, JOINTS, waves(50, 12)),
        'foot_force': cdr.encode_joint_states(joint, FEET, effort=100 * waves(400, 4)),
        'imu': cdr.encode_imu(joint, unit, waves(400, 3), waves(400, 3)),
        'supply': cdr.encode_batteries(supply, np.full(len(supply), 48.0), -waves(100, 1)[:, 0]),
    }
    times = {
        'drive_supply': fast,
        'joint_states': joint,
        'joint_commands': slow,
        'foot_force': joint,
        'imu': joint,
        'supply': supply,
    }
    types = {
        'drive_supply': cdr.DRIVE_SUPPLY,
        'imu': cdr.IMU,
        'supply': cdr.BATTERY_STATE,
    }
    with BagWriter(path) as bag:
        topics = {name: bag.add_topic(name, types.get(name, cdr.JOINT_STATE)) for name in blocks}
        messages = [
            (int(stamp), topics[name], message)
            for name in blocks
            for stamp, message in zip(times[name], blocks[name], strict=True)
        ]
        messages.sort(key=lambda entry: entry[0])
        for stamp, topic, message in messages:
            bag.write(topic, stamp, message)
    return len(messages)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=120.0, help='length of the recording')
    parser.add_argument('--keep', type=Path, metavar='BAG', help='keep the bag there')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = options.keep or Path(folder) / 'synthetic'
        started = time.perf_counter()
        messages = write_bag(path, options.seconds)
        print(
            f'bag: {options.seconds:g} s, 12 drives, {messages} messages, written in '
            f'{time.perf_counter() - started:.2f} s'
        )
        load_aligned([path])
        print(f'{"aligned dataset":<34}{"wall s":>8}{"CPU s":>8}{"x real time":>13}{"target":>8}')
        for label, rate, smooth in (
            ('200 Hz, Savitzky-Golay', 200.0, True),
            ('200 Hz, unsmoothed', 200.0, False),
            ('50 Hz, unsmoothed', 50.0, False),
        ):
            started, cpu = time.perf_counter(), time.process_time()
            load_aligned([path], rate=rate, smooth=smooth)
            wall, cpu = time.perf_counter() - started, time.process_time() - cpu
            ratio = options.seconds / cpu
            print(f'{label:<34}{wall:>8.2f}{cpu:>8.2f}{ratio:>13.0f}{TARGET:>8.0f}')


if __name__ == '__main__':
    main()
