"""Time and memory of `track` with one worker, two, and two of which one is killed; JSON compared.

    python bench/track_workers.py [--recordings 200] [--seconds 150] [--folder runs/track_workers]
                                  [--scheduler tcp://HOST:PORT]

The recordings are of one simulated unit of which all twelve drives are metered. They are made
once, on all cores, and kept in the folder. Each run begins with an empty index. Exit code 1 where
a JSON differs.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil
from power_recordings.index.store import RecordingIndex
from rich.console import Console
from rich.progress import track
from sim_bridge.offline.history import bag_names, record_history
from sim_bridge.plant.ageing import AgeingPlan
from wattwalk_core.console import output, print_table
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.processes import ChildProcess, wait_until
from wattwalk_core.schema import parse

MODEL = """\
format: power_model/1
name: base
effects: [shaft, copper_loss, viscous_friction, coulomb_friction, rotor_inertia, idle]
"""
PROGRAM = 'import sys; from power_fleet.commands.arguments import track as main; sys.exit(main())'
LONGEST = 86_400.0  # s
KILLED_AT = 0.3  # of the recordings


@dataclass
class Measured:
    """One run of `track`: its JSON, its time in s, and its processes' memory in MB."""

    json: str
    seconds: float
    client_mb: float
    worker_mb: float


def recordings(folder: Path, count: int, seconds: float) -> list[Path]:
    """Return the paths of recordings of a unit, one a day, simulating those that are absent."""
    days = [{'day': float(day), 'temperature': 20.0} for day in range(count)]
    content = {'unit': 3, 'seed': 5, 'seconds': seconds, 'start': '2026-01-05', 'days': days}
    plan = parse(AgeingPlan, content, 'plan')
    bags = [folder / name for name in bag_names(plan)]
    if not all((bag / 'metadata.yaml').exists() for bag in bags):
        with TaskEngine() as engine:
            made = record_history(plan, folder, engine)
            for _ in track(made, 'recording', count, console=Console(stderr=True)):
                pass
    return bags


def run(bags: Sequence[Path], model: Path, more: Sequence[str], *, kill: bool) -> Measured:
    """Run `track`, with arguments `more`, from an empty index; kill: a worker at 30 % of fits."""
    with TemporaryDirectory() as name:
        here = Path(name)
        index, told = here / 'index.sqlite3', here / 'track.json'
        command = [sys.executable, '-c', PROGRAM, *map(str, bags), '--model', str(model)]
        command += ['--json', str(told), *more]
        client_mb = worker_mb = 0.0
        due = max(1, round(KILLED_AT * len(bags))) if kill else None
        start = time.monotonic()
        with ChildProcess(command, here / 'track.log', {'WATTWALK_INDEX': str(index)}) as process:

            def look() -> bool:
                nonlocal client_mb, worker_mb, due
                if not process.running:
                    return True
                try:
                    own = psutil.Process(process.pid)
                    client_mb = max(client_mb, own.memory_info().rss / 1e6)
                    workers = [w for w in own.children() if 'spawn_main' in ' '.join(w.cmdline())]
                    sizes = {w.memory_info().rss / 1e6: w for w in workers}
                except psutil.Error:
                    return False
                worker_mb = max(worker_mb, *sizes, 0.0)
                if due is not None and sizes and fits(index) >= due:
                    sizes[max(sizes)].kill()
                    due = None
                time.sleep(0.5)
                return False

            wait_until(look, LONGEST)
            process.succeed()
        seconds = time.monotonic() - start
        if due is not None and kill:
            raise SystemExit('no worker was there to kill')
        return Measured(told.read_text(), seconds, client_mb, worker_mb)


def fits(path: Path) -> int:
    """Return the number of fits in an index; 0 without a file."""
    if not path.exists():
        return 0
    with RecordingIndex(path) as index:
        return len(index.rows("SELECT 1 FROM answers WHERE kind = 'fit'"))


def main() -> int:
    """Run `track` with different workers and print a table; return 1 where a JSON differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add('--recordings', type=int, default=200)
    add('--seconds', type=float, default=150.0)
    add('--folder', type=Path, default=Path('runs/track_workers'))
    add('--scheduler', default='', help='a cluster as well')
    options = parser.parse_args()
    folder = options.folder / f'{options.recordings}_of_{options.seconds:g}_s'
    bags = recordings(folder, options.recordings, options.seconds)
    model = options.folder / 'base.yaml'
    model.write_text(MODEL)
    rows = {
        'one worker': (['--workers', '1'], False),
        'two workers': (['--workers', '2'], False),
        'two, one killed': (['--workers', '2'], True),
    }
    if options.scheduler:
        rows['scheduler'] = (['--scheduler', options.scheduler], False)
    found = {name: run(bags, model, more, kill=kill) for name, (more, kill) in rows.items()}
    first = found['one worker']
    cells = [
        (
            name,
            f'{one.seconds:.1f}',
            f'{first.seconds / one.seconds:.2f} ×',
            f'{one.client_mb:.0f}',
            f'{one.worker_mb:.0f}',
            'the same' if one.json == first.json else 'differs',
        )
        for name, one in found.items()
    ]
    columns = ('run', 's', 'throughput', 'client MB', 'worker MB', 'JSON')
    title = f'track, {options.recordings} recordings of {options.seconds:g} s, 12 drives'
    print_table(output(), columns, cells, title)
    return 0 if all(one.json == first.json for one in found.values()) else 1


if __name__ == '__main__':
    raise SystemExit(main())
