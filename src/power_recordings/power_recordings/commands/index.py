"""`ros2 run power_recordings index`: cards of many recordings, and tables for other programs."""

import argparse

from rich import box
from rich.console import Console
from rich.table import Table
from wattwalk_core.errors import InputError, printable

from power_recordings.index.store import ENVIRONMENT, RecordingIndex, usual_path
from power_recordings.index.tables import FILES, add_cards, export, listed

_MOST = 40  # rows of the table


def run(options: argparse.Namespace) -> None:
    """List recordings in the index, after adding or forgetting some; export it if requested."""
    path = usual_path()
    if path is None:
        raise InputError(f'{ENVIRONMENT} is empty: name the file of the index')
    with RecordingIndex(path) as index:
        if index.off:
            raise InputError(index.off)
        if options.forget_lost:
            print(f'forgotten: {index.forget_lost()}')
        if options.add:
            count, left_out = add_cards(index, options.add)
            print(f'added: {count}')
            for reason in left_out:
                print(f'left out: {printable(reason)}')
        rows = listed(index, options.robot, options.unit, options.since, options.until)
        _print(rows, None if options.all else _MOST)
        if options.export is not None:
            export(index, options.export)
            print(f'{printable(str(options.export))}: {", ".join(FILES)}')


def _print(rows: list[dict[str, object]], most: int | None) -> None:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    columns = ('robot', 'unit', 'created', 'controller', 'seconds', 'path')
    for name in columns:
        table.add_column(name, overflow='fold', justify='right' if name == 'seconds' else 'left')
    for row in rows[:most]:
        shown = (row[name] for name in columns)
        cells = (f'{v:.1f}' if isinstance(v, float) else str(v or '') for v in shown)
        table.add_row(*(printable(cell) for cell in cells))
    console = Console(highlight=False, markup=False)
    console.print(table)
    console.print(
        f'{len(rows)} recordings' + (f', {most} shown' if len(rows) > (most or len(rows)) else '')
    )
