"""CPU time of `--help` and of a wrong argument of every command, each in a fresh process.

python bench/commands_start.py [--only power_lab…]
"""

import argparse
import os
import subprocess
from collections.abc import Sequence
from configparser import ConfigParser
from pathlib import Path

from wattwalk_core.console import output, print_table
from wattwalk_core.processes import find_program

SOURCES = Path(__file__).resolve().parents[1] / 'src'
LIMIT = 0.6  # s of CPU
ARGUMENTS = ('--help', '--no-such-option')


def entry_points() -> dict[tuple[str, str], tuple[str, str]]:
    """Return (module, function) of each command by (package, name), from all setup.cfg."""
    found = {}
    for file in sorted(SOURCES.glob('*/setup.cfg')):
        config = ConfigParser()
        config.read(file, 'utf-8')
        lines = config.get('options.entry_points', 'console_scripts', fallback='').strip()
        for line in lines.splitlines():
            name, _, target = line.partition(' = ')
            module, _, function = target.partition(':')
            found[file.parent.name, name] = (module, function)
    return found


def cpu_seconds(command: Sequence[str]) -> float:
    """Run a command with its output discarded; return its user plus system time, s."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, _, used = os.wait4(process.pid, 0)
    process.returncode = 0
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Print the table; 1 if a command needs more than the limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--only', nargs='+', metavar='PACKAGE', help='commands of these packages')
    options = parser.parse_args()
    ros2 = find_program('ros2')
    rows, worst = [], 0.0
    for package, name in entry_points():
        if options.only and package not in options.only:
            continue
        used = [cpu_seconds([ros2, 'run', package, name, text]) for text in ARGUMENTS]
        worst = max(worst, *used)
        rows.append((f'{package} {name}', *(f'{seconds:.2f}' for seconds in used)))
    title = f'CPU in s of `ros2 run`; limit {LIMIT} s'
    print_table(output(), ('command', *ARGUMENTS), rows, title)
    print(f'worst: {worst:.2f} s')
    return int(worst > LIMIT)


if __name__ == '__main__':
    raise SystemExit(main())
