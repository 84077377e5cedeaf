"""
Cost of the index of recordings with many cards: adding, opening, querying, exporting.

    python bench/index.py [--cards 5000]

Each recording has a card, a quality and a fit of 12 drives with 13 coefficients each; its files
hold nothing else, as the index never reads them.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from power_fleet.track.kept_fit import from_bytes, to_bytes
from power_fleet.track.recording_fit import Occasion, RecordingFit
from power_recordings.card import Card
from power_recordings.index.stamp import Stamp
from power_recordings.index.store import DriveFigure, IndexAnswer, RecordingFacts, RecordingIndex
from power_recordings.index.tables import Question, add_cards, export, listed
from rich.console import Console
from rich.table import Table
from wattwalk_core.anymal import JOINT_NAMES

TERMS = tuple((f'effect_{i}', 0) for i in range(13))


def fit() -> RecordingFit:
    """A fit of the size that the lab makes."""
    drives, m = len(JOINT_NAMES), len(TERMS)
    ones = np.ones((drives, m))
    return RecordingFit(
        occasion=Occasion(
            'day', 1.7e9, 'anymal_c 1', {'temperature': 20.0}, {'controller': 'trot'}
        ),
        drives=tuple(JOINT_NAMES),
        labels=TERMS,
        values=ones,
        covariance=np.ones((drives, m, m)),
        responses={name: ones for name, _ in TERMS},
        watts=ones,
        rms=ones,
        conditions={name: np.ones(drives) for name in ('load', 'speed', 'supply voltage')},
        error=np.ones(drives),
        power=np.ones((drives, 2)),
    )


def make(folder: Path, count: int) -> list[Path]:
    """Folders with cards and no data."""
    bags = []
    for place in range(count):
        bag = folder / f'unit{place % 10}' / f'day{place // 10:04d}'
        bag.mkdir(parents=True)
        (bag / 'metadata.yaml').write_text('rosbag2_bagfile_information: {}\n')
        date = f'2026-{1 + place // 10 % 12:02d}-{1 + place // 120 % 28:02d}'
        Card(robot='anymal_c', unit=str(place % 10), created=f'{date}T08:00:00').save(bag)
        bags.append(bag)
    return bags


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--cards', type=int, default=5000)
    options = parser.parse_args()
    table = Table('what', 's', 'CPU s', title=f'{options.cards} recordings of 12 drives')

    def timed(name: str, act: Callable[[], object]) -> None:
        start, used = time.perf_counter(), time.process_time()
        act()
        spent = time.perf_counter() - start, time.process_time() - used
        table.add_row(name, *(f'{value:.2f}' for value in spent))

    with tempfile.TemporaryDirectory() as work:
        folder, file = Path(work) / 'bags', Path(work) / 'index.sqlite3'
        bags = make(folder, options.cards)
        content, figures = (
            to_bytes(fit()),
            [
                DriveFigure(drive, name, 1.0, error=0.1)
                for drive in JOINT_NAMES
                for name, _ in TERMS
            ],
        )

        def fill() -> None:
            for bag in bags:
                index.keep(
                    Stamp.of(bag),
                    RecordingFacts(Card()),
                    IndexAnswer('fit', 'k', content, figures),
                )

        with RecordingIndex(file) as index:
            timed('read all cards into it', lambda: add_cards(index, [folder]))
            timed('see that no card changed', lambda: add_cards(index, [folder]))
            timed('keep a fit of each, one by one', fill)
        os.sync()

        def read_all() -> None:
            with RecordingIndex(file) as opened:
                for bag in bags:
                    kept = opened.answer(Stamp.of(bag), 'fit', 'k')
                    assert kept is not None
                    from_bytes(kept)

        question = Question('anymal_c', '3', '2026-03', '2026-05')
        timed('open it, and all fits', read_all)
        with RecordingIndex(file) as index:
            timed('list a unit in two months', lambda: listed(index, question))
            timed('list all cards', lambda: listed(index, Question()))
            timed('export as Parquet', lambda: export(index, Path(work) / 'out'))
        table.add_row('MB of the file', f'{file.stat().st_size / 1e6:.0f}')
    Console().print(table)


if __name__ == '__main__':
    main()
