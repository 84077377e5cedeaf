"""
Time and memory of `diagnose` by the length of a walk and its drives.

    python bench/diagnose_cost.py [--seconds 150 600] [--drives 3 6 12] [--keep DIR]

Each row is a process of its own: reading, diagnosis and JSON, as the command does it. Walks are
simulated once and kept in DIR.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

ORDER = [f'{leg}_{joint}' for leg in ('LF', 'RF', 'LH', 'RH') for joint in ('HAA', 'HFE', 'KFE')]
EFFECTS = 'shaft, copper_loss, rotor_inertia, idle, viscous_friction, coulomb_friction'
JUDGE = """
import resource, sys, time
begin = time.perf_counter()
from power_lab.commands.arguments import diagnose as main
code = main(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_SELF)
wall = time.perf_counter() - begin
print('COST', used.ru_utime + used.ru_stime, wall, used.ru_maxrss / 1024)
sys.exit(code)
"""


def walk(folder: Path, seconds: float) -> Path:
    """Simulate a walk of all drives, or take the one that is there."""
    from sim_bridge.offline.run import run_offline

    path = folder / f'walk_{seconds:g}s'
    if not path.exists():
        run_offline(path, duration=seconds, seed=8)
    return path


def cost(bag: Path, model: Path, drives: list[str]) -> tuple[float, float, float, str]:
    """CPU s, s, MB and the first line of the verdict of one diagnosis."""
    arguments = [str(bag), '--model', str(model), '--drives', *drives]
    done = subprocess.run(
        [sys.executable, '-c', JUDGE, *arguments],
        capture_output=True,
        text=True,
        check=True,
    )
    found = re.search(r'COST (\S+) (\S+) (\S+)', done.stdout)
    if found is None:
        raise RuntimeError(done.stdout + done.stderr)
    told = next((line.strip() for line in done.stdout.splitlines() if line.strip()), '')
    return float(found[1]), float(found[2]), float(found[3]), told


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add('--seconds', type=float, nargs='+', default=[150.0, 600.0])
    add('--drives', type=int, nargs='+', default=[3, 6, 12])
    add('--keep', type=Path, default=Path('runs/diagnose_cost'))
    options = parser.parse_args()
    options.keep.mkdir(parents=True, exist_ok=True)
    model = options.keep / 'base.yaml'
    model.write_text(f'format: power_model/1\nname: base\neffects: [{EFFECTS}]\n')
    table = Table(title='cost of diagnose')
    for column in ('walk', 'drives', 'CPU', 'on all cores', 'memory', 'verdict'):
        table.add_column(column, justify='left' if column == 'verdict' else 'right')
    for seconds in options.seconds:
        bag = walk(options.keep, seconds)
        for count in options.drives:
            used, wall, memory, told = cost(bag, model, ORDER[:count])
            row = (f'{used:.1f} s', f'{wall:.1f} s', f'{memory:.0f} MB', told[:60])
            table.add_row(f'{seconds:g} s', str(count), *row)
    Console().print(table)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
