"""
Acquisition of a walking robot, with all nodes in processes of their own.

12 drives at 1 kHz and joint states at 400 Hz come over the bus, are stamped, published, estimated
and recorded. Printed: samples lost, the error of the stamps against the plant's own clock, and the
CPU time of each process.

    python bench/acquisition.py [--seconds 600] [--model ppn:RUN]
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from live_system import LiveSystem
from numpy.typing import NDArray
from power_recordings.reading.reader import Recording
from rich.console import Console
from rich.progress import Progress
from rich.table import Table


def stamp_error_ms(recording: Recording) -> NDArray[np.float64]:
    """
    Stamps of joint states minus the plant's own time of the same steps, ms.

    The plant stamps foot forces with its true time and samples them at the steps of the joint
    states, so that the nearest of them belongs to the same step while errors stay below 1.25 ms.
    """
    stamps = recording.joint_states().stamp_ns
    truth = recording.foot_force().stamp_ns
    stamps = stamps[(stamps > truth[0]) & (stamps < truth[-1])]
    after = np.clip(np.searchsorted(truth, stamps), 1, len(truth) - 1)
    late, early = stamps - truth[after], stamps - truth[after - 1]
    return np.where(np.abs(late) < np.abs(early), late, early) / 1e6


def run(seconds: float, model: str | None) -> dict[str, str]:
    """Run the live system and return a row for each figure."""
    with tempfile.TemporaryDirectory(prefix='wattwalk') as name, LiveSystem(Path(name)) as system:
        folder = Path(name)
        bag = folder / 'bag'
        bus = ['-p', 'interface:=unixsocket', '-p', f'channel:={folder}/bus']
        reset = ['-p', 'reset_after_fall:=1.0']
        nodes = ['sim', 'daq', 'run', 'record']
        system.start('sim_bridge', 'sim', '--ros-args', *bus, *reset)
        system.start('power_daq', 'daq', '--ros-args', *bus)
        if model:
            system.start('power_estimator', 'estimate', '--ros-args', '-p', f'model:={model}')
            nodes.append('estimate')
        walk = ('--policy', 'trot', '--start', '--random-commands', '--restart-after', '1')
        system.start('policy_runner', 'run', *walk)
        system.wait_for('run', 'running')
        record = ('-o', str(bag), '--duration', str(seconds), '--card', 'robot=anymal_c')
        system.start('power_daq', 'record', *record)
        with Progress() as progress:
            task = progress.add_task(f'{seconds:.0f} s live', total=seconds)
            time.sleep(min(2.0, seconds / 4))
            system.mark(nodes)
            shares = {node: 0.0 for node in nodes}
            while system.running('record'):
                shares = {node: system.share(node) for node in nodes}
                time.sleep(0.5)
                progress.advance(task, 0.5)
        recording = Recording.open(bag)
        drives = recording.drive_supply()
        steps = np.diff(drives.sequence.astype(np.int64))
        error = stamp_error_ms(recording)
        states = recording.joint_states()
        worst = np.percentile(np.abs(error), 99)
        rows = {
            'recorded': f'{recording.duration:.1f} s, {len(drives.sequence)} samples of '
            f'{len(drives.names)} drives, {len(states)} joint states',
            'drive_supply samples lost': str(int((steps - 1).clip(min=0).sum())),
            'joint states against 400 Hz': f'{len(states) / recording.duration:.2f} Hz',
            'stamp error, median': f'{np.median(error):+.3f} ms',
            'stamp error, p99 of magnitude': f'{worst:.3f} ms (goal 0.2)',
        }
        rows |= {
            f'CPU of {node}': f'{100 * share:.1f} % of a core' for node, share in shares.items()
        }
        rows |= {f'problem {i + 1}': text for i, text in enumerate(recording.problems)}
        return rows


def main(args: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog='example: python bench/acquisition.py'
    )
    parser.add_argument('--seconds', type=float, default=600.0)
    parser.add_argument('--model', help='also estimate live, as ppn:runs/first')
    options = parser.parse_args(args)
    table = Table(title='acquisition, live', title_justify='left', show_header=False)
    for name, value in run(options.seconds, options.model).items():
        table.add_row(name, value)
    Console().print(table)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
