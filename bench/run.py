"""All benchmarks, one after the other, each in a process of its own.

python bench/run.py [--quick] [--only NAME…]
"""

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
BENCHMARKS: dict[str, tuple[str, ...]] = {
    'commands_start': (),
    'speed': ('--mb', '1000'),
    'real_runtime': (),
    'estimator': (),
    'policies': (),
    'acquisition': (),
}
QUICK: dict[str, tuple[str, ...]] = {
    'acquisition': ('--seconds', '30'),
    'speed': (),
}


def main() -> int:
    """Run the benchmarks; 1 if one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__, epilog='example: make bench')
    parser.add_argument('--quick', action='store_true', help='30 s of acquisition, not 10 min')
    parser.add_argument('--only', nargs='+', choices=BENCHMARKS, default=list(BENCHMARKS))
    options = parser.parse_args()
    failed = []
    for name in options.only:
        extra = QUICK.get(name, ()) if options.quick else BENCHMARKS[name]
        print(f'\n── {name} ' + '─' * (76 - len(name)), flush=True)
        command = [sys.executable, str(HERE / f'{name}.py'), *extra]
        if subprocess.run(command, check=False).returncode != 0:
            failed.append(name)
    if failed:
        print(f'failed: {", ".join(failed)}', file=sys.stderr)
    return 1 if failed else 0


if __name__ == '__main__':
    raise SystemExit(main())
