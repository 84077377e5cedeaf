"""Acquisition of a walking robot, with all nodes in processes of their own.

12 drives at 1 kHz and joint states at 400 Hz come over the bus, are stamped, published, estimated
and recorded. Printed: samples lost, the error of the stamps against the plant's own clock, and the
CPU time of each process; with --both the same walk on both runtimes, one after the other.

    python bench/acquisition.py [--seconds 600] [--model ppn:RUN] [--policy baseline] [--both]
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import runtimes
from power_recordings.reading.reader import Recording
from rich.progress import Progress
from wattwalk_core.arrays import Floats
from wattwalk_core.console import output, print_table
from wattwalk_core.processes import ChildProcess, find_program

Runtime = Callable[..., list[str]]
Figures = dict[str, str]


def stamp_error_ms(recording: Recording) -> Floats:
    """Return stamps of joint states minus the plant's true time of the same steps, ms [N].

    True times are the stamps of foot_force, sampled at the same steps; the nearest is taken, which
    is right for errors below 1.25 ms.
    """
    stamps = recording.joint_states().stamp_ns
    truth = recording.foot_force().stamp_ns
    stamps = stamps[(stamps > truth[0]) & (stamps < truth[-1])]
    after = np.clip(np.searchsorted(truth, stamps), 1, len(truth) - 1)
    late, early = stamps - truth[after], stamps - truth[after - 1]
    return np.where(np.abs(late) < np.abs(early), late, early) / 1e6


def walk(ros2: Runtime, seconds: float, policy: Sequence[str], model: str | None) -> Figures:
    """Run the live system, alone in a ROS domain; return figures as text by name.

    ros2: makes the command line of `ros2`. policy: arguments of the policy runner. model: to
    estimate with, or None.
    """
    with (
        tempfile.TemporaryDirectory(prefix='wattwalk') as name,
        runtimes.reserved() as domain,
        ExitStack() as running,
    ):
        bus = ('--ros-args', '-p', 'interface:=unixsocket', '-p', f'channel:={name}/bus')
        nodes: dict[str, ChildProcess] = {}

        def start(package: str, executable: str, *arguments: str) -> None:
            program, *rest = ros2('run', package, executable, *arguments)
            command, log = [find_program(program), *rest], Path(name) / f'{executable}.log'
            process = ChildProcess(command, log, {'ROS_DOMAIN_ID': str(domain)})
            nodes[executable] = running.enter_context(process)

        start('sim_bridge', 'sim', *bus, '-p', 'reset_after_fall:=1.0')
        start('power_daq', 'daq', *bus)
        if model:
            start('power_estimator', 'estimate', '--ros-args', '-p', f'model:={model}')
        start('policy_runner', 'run', *policy, '--start', '--restart-after', '1')
        nodes['run'].wait_for_line('running', 120.0)
        bag, length = f'{name}/bag', str(seconds)
        start('power_daq', 'record', '-o', bag, '--duration', length, '--card', 'robot=anymal_c')
        with Progress(transient=True) as progress:
            task = progress.add_task(f'{seconds:.0f} s live', total=seconds)
            time.sleep(min(2.0, seconds / 4))
            since = time.monotonic()
            before = {node: process.cpu_seconds() for node, process in nodes.items()}
            shares = dict.fromkeys(nodes, 0.0)
            while nodes['record'].running:
                for node, process in nodes.items():
                    used = process.cpu_seconds() - before[node]
                    shares[node] = used / (time.monotonic() - since)
                time.sleep(0.5)
                progress.advance(task, 0.5)
        recorded = figures_of(Recording.open(Path(bag)))
    return recorded | {
        f'CPU of {node}': f'{100 * share:.1f} % of a core' for node, share in shares.items()
    }


def figures_of(recording: Recording) -> Figures:
    """Return losses, rates and stamp errors of a recording as text by name."""
    drives, states = recording.drive_supply(), recording.joint_states()
    steps = np.diff(drives.sequence.astype(np.int64))
    error = stamp_error_ms(recording)
    rows = {
        'recorded': f'{recording.duration:.1f} s, {len(drives.sequence)} samples of '
        f'{len(drives.names)} drives, {len(states)} joint states',
        'drive_supply samples lost': str(int((steps - 1).clip(min=0).sum())),
        'joint states against 400 Hz': f'{len(states) / recording.duration:.2f} Hz',
        'stamp error, median': f'{np.median(error):+.3f} ms',
        'stamp error, p99 of magnitude': f'{np.percentile(np.abs(error), 99):.3f} ms (goal 0.2)',
    }
    return rows | {f'problem {i + 1}': text for i, text in enumerate(recording.problems)}


def main() -> int:
    """Print a table with a column for each runtime; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add('--seconds', type=float, default=600.0)
    add('--model', help='also estimate live, as ppn:runs/first')
    add('--policy', default='trot', help='trot by random commands, another at 0.5 m/s')
    add('--both', action='store_true', help='on the embedded runtime, then on ROS 2')
    options = parser.parse_args()
    ways: dict[str, Runtime] = {'this runtime': lambda *words: ['ros2', *words]}
    if options.both:
        if reason := runtimes.missing():
            parser.error(reason)
        ways = {'embedded': runtimes.embedded_ros2, 'ROS 2': runtimes.real_ros2}
    how = ['--random-commands'] if options.policy == 'trot' else ['--velocity=0.5,0,0']
    policy = ['--policy', options.policy, *how]
    found = [walk(ros2, options.seconds, policy, options.model) for ros2 in ways.values()]
    names = dict.fromkeys(name for figures in found for name in figures)
    rows = [(name, *(figures.get(name, '') for figures in found)) for name in names]
    print_table(output(), ('', *ways), rows, 'acquisition, live')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
