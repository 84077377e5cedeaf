"""
Shares of a core that the nodes of a walking robot take, on the embedded runtime and on ROS 2.

The same walk is run on both runtimes in turn, so that the ratio does not depend on the machine.
Without a ROS 2 beside this Python only the embedded runtime is measured.

    python bench/node_shares.py [--seconds 20] [--rounds 2]
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import mean

import runtimes
from live_system import LiveSystem
from rich.console import Console
from rich.progress import track
from rich.table import Table

NETWORK = Path(__file__).resolve().parents[1] / 'bags' / 'ppn_small'
NODES = {
    'sim': 'simulator',
    'run': 'policy runner',
    'estimate': 'estimator',
    'daq': 'DAQ',
    'record': 'recorder',
}
SETTLING = 5.0  # s


def shares(ros2: Callable[..., list[str]], seconds: float) -> dict[str, float]:
    """Return the share of a core of each node of a robot that walks at 0.5 m/s."""
    with (
        tempfile.TemporaryDirectory(prefix='wattwalk') as name,
        LiveSystem(Path(name), ros2) as system,
    ):
        bus = ('--ros-args', '-p', 'interface:=unixsocket', '-p', f'channel:={name}/bus')
        walk = ('--policy', 'baseline', '--start', '--restart-after', '1', '--velocity=0.5,0,0')
        system.start('sim_bridge', 'sim', *bus)
        system.start('power_daq', 'daq', *bus)
        system.start('policy_runner', 'run', *walk)
        system.start('power_estimator', 'estimate', '--ros-args', '-p', f'model:=ppn:{NETWORK}')
        system.start('power_daq', 'record', '-o', f'{name}/bag')
        system.wait_for('run', 'running', 120.0)
        time.sleep(SETTLING)
        system.mark(list(NODES))
        time.sleep(seconds)
        return {node: system.share(node) for node in NODES}


def main(arguments: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog='example: python bench/node_shares.py --seconds 60'
    )
    parser.add_argument('--seconds', type=float, default=20.0, help='measured in each round')
    parser.add_argument('--rounds', type=int, default=2, help='of each runtime, in turn')
    options = parser.parse_args(arguments)
    ways = {'embedded': runtimes.embedded_ros2, 'ROS 2': runtimes.real_ros2}
    reason = runtimes.missing()
    if reason:
        print(f'only this runtime is measured: {reason}')
        ways = {'this runtime': lambda *words: ['ros2', *words]}
    found: dict[str, list[dict[str, float]]] = {way: [] for way in ways}
    for _ in track(range(options.rounds), 'walking'):
        for way, ros2 in ways.items():
            found[way].append(shares(ros2, options.seconds))
    table = Table(title=f'% of a core, {options.rounds} walks of {options.seconds:g} s')
    table.add_column('node')
    for way in ways:
        table.add_column(way, justify='right')
    if len(ways) > 1:
        table.add_column('ratio', justify='right')
    for node, label in NODES.items():
        means = [mean(walk[node] for walk in found[way]) for way in ways]
        cells = [f'{100 * share:.1f}' for share in means]
        if len(ways) > 1:
            cells.append(f'{means[1] / means[0]:.2f}')
        table.add_row(label, *cells)
    Console().print(table)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
