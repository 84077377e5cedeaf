"""Speed and memory of `power_recordings import`, for a table and a bag of a given size.

A seeded log of one drive (the most rows a byte) or of twelve is made in a temporary folder and
imported by a process of its own; printed are its wall and CPU time, MB of log per second, and its
peak memory.

    python bench/import_speed.py [--mb 100] [--drives 12] [--kinds csv bag]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter
from rich.console import Console
from rich.table import Table

_RATE = 1000  # Hz
_ROWS = 20_000


def _signals(rng: np.random.Generator, first: int, drives: int) -> np.ndarray:
    """Time, then position, velocity, torque, voltage and current by drive, [rows, 1 + 5·D]."""
    t = (first + np.arange(_ROWS)) / _RATE
    rate = 2 * np.pi * np.linspace(0.5, 2, drives)  # rad/s
    phase = t[:, None] * rate
    velocity, torque = rate * np.cos(phase), np.sin(3 * phase) + rng.normal(0, 0.01, phase.shape)
    current = (torque * velocity + 2 * torque**2 + 1) / 48
    voltage = 48 - 0.1 * current
    parts = np.stack([np.sin(phase), velocity, torque, voltage, current], axis=2)
    return np.concatenate([t[:, None], parts.reshape(_ROWS, -1)], axis=1)


def make_csv(path: Path, size: int, drives: int) -> str:
    """Write a table of at least `size` bytes and return its map."""
    rng = np.random.default_rng(0)
    names = ('pos', 'vel', 'torque', 'volt', 'amp')
    row = '%.3f,' + ','.join(['%.6f'] * (5 * drives)) + '\n'
    with path.open('w') as file:
        file.write('t,' + ','.join(f'{n}{d}' for d in range(drives) for n in names) + '\n')
        first = 0
        while file.tell() < size:
            table = _signals(rng, first, drives)
            file.write((row * _ROWS) % tuple(table.ravel().tolist()))
            first += _ROWS
    return """format: import/1
time: {column: t, unit: s}
drives:
  'D*':
    position: {from: 'pos*', unit: rad}
    velocity: {from: 'vel*', unit: rad/s}
    torque: {from: 'torque*', unit: N*m}
    voltage: {from: 'volt*', unit: V}
    current: {from: 'amp*', unit: A}
"""


def make_bag(path: Path, size: int, drives: int) -> str:
    """Write a recording of at least `size` bytes of messages and return a map of it."""
    rng = np.random.default_rng(0)
    names = tuple(f'D{i}' for i in range(drives))
    with BagWriter(path, flush_period=10.0) as bag:
        joints = bag.add_topic('joint_states', cdr.JOINT_STATE)
        supply = bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY)
        first = 0
        while bag.size < size:
            table = _signals(rng, first, drives)
            stamps = np.rint(1e18 + table[:, 0] * 1e9).astype(np.int64)
            columns = table[:, 1:].reshape(_ROWS, drives, 5)
            states = cdr.encode_joint_states(stamps, names, *np.moveaxis(columns[:, :, :3], 2, 0))
            watts = cdr.encode_drive_supply(
                stamps, first, stamps.astype(np.uint64), names, columns[:, :, 3], columns[:, :, 4]
            )
            for stamp, state, watt in zip(stamps.tolist(), states, watts, strict=True):
                bag.write(joints, stamp, state)
                bag.write(supply, stamp, watt)
            first += _ROWS
    return """format: import/1
time: {stamp: header}
drives:
  '*':
    position: {from: '/joint_states:position[*]', unit: rad}
    velocity: {from: '/joint_states:velocity[*]', unit: rad/s}
    torque: {from: '/joint_states:effort[*]', unit: N*m}
    voltage: {from: '/drive_supply:voltage[*]', unit: V}
    current: {from: '/drive_supply:current[*]', unit: A}
"""


def measure(log: Path, mapping: str, folder: Path) -> tuple[float, float, float]:
    """Import a log in a process of its own; return seconds, CPU seconds and peak memory in MB."""
    (folder / 'map.yaml').write_text(mapping)
    code = 'from power_recordings.commands.arguments import import_logs as run; exit(run())'
    command = [str(log), '--map', str(folder / 'map.yaml'), '-o', str(folder / 'out')]
    start = time.perf_counter()
    process = subprocess.Popen([sys.executable, '-c', code, *command], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f'the import of {log} ended with {os.waitstatus_to_exitcode(status)}')
    seconds = time.perf_counter() - start
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main() -> None:
    """Print a row for each kind of log."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--mb', type=float, default=100, help='size of the log')
    parser.add_argument('--drives', type=int, default=12)
    parser.add_argument('--kinds', nargs='+', choices=('csv', 'bag'), default=('csv', 'bag'))
    options = parser.parse_args()
    table = Table('log', 'MB', 's', 'CPU s', 'MB/s', 'peak memory')
    for kind in options.kinds:
        with tempfile.TemporaryDirectory(prefix='wattwalk') as name:
            folder = Path(name)
            log = folder / ('log.csv' if kind == 'csv' else 'log')
            make = make_csv if kind == 'csv' else make_bag
            mapping = make(log, round(options.mb * 1e6), options.drives)
            files = [log] if log.is_file() else list(log.iterdir())
            size = sum(file.stat().st_size for file in files) / 1e6
            seconds, busy, memory = measure(log, mapping, folder)
            table.add_row(
                f'{kind}, {options.drives} drives',
                f'{size:.0f}',
                f'{seconds:.1f}',
                f'{busy:.1f}',
                f'{size / seconds:.0f}',
                f'{memory:.0f} MB',
            )
    Console().print(table)


if __name__ == '__main__':
    main()
