"""Speed of alignment, from a bag to a dataset, as a multiple of real time.

The ratio counts CPU time, so that it is that of one core whatever else runs.

    python bench/alignment.py [BAG] [--seconds 120]
"""

import argparse
import tempfile
import time
from pathlib import Path

from power_recordings.alignment.align import load_aligned
from power_recordings.reading.reader import Recording
from sim_bridge.offline.run import run_offline

TARGET = 200.0


def main() -> None:
    """Print a row for each way to align."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('bag', nargs='?', type=Path, help='by default a walk is simulated')
    parser.add_argument('--seconds', type=float, default=120.0, help='length of that walk')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = options.bag or run_offline(Path(folder) / 'walk', duration=options.seconds, seed=0)
        length = Recording.open(path).duration
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
            print(f'{label:<34}{wall:>8.2f}{cpu:>8.2f}{length / cpu:>13.0f}{TARGET:>8.0f}')


if __name__ == '__main__':
    main()
