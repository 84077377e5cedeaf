"""`ros2 run power_recordings index`: cards of many recordings, and tables for other programs."""

from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command, command_parser, own_arguments

_EXAMPLE = """example:
  ros2 run power_recordings index --add bags --robot anymal_c --since 2026-03
  ros2 run power_recordings index --export tables"""
_MOST = 40  # rows of the table


@command
def main(args: Sequence[str] | None = None) -> int:
    """List what the index has; add to it, export it."""
    parser = command_parser(
        'power_recordings index',
        'List the recordings that the index knows. `info` and `power_fleet track` keep in it what '
        'they worked out, so that a second run takes no time; --add reads the cards alone. It is '
        'a cache that may be deleted: a file that WATTWALK_INDEX names, else '
        '~/.cache/wattwalk/recordings.sqlite3.',
        _EXAMPLE,
    )
    add = parser.add_argument
    add('--add', nargs='+', type=Path, default=[], metavar='FOLDER', help='read cards in folders')
    add('--robot', default='', help='only of this robot')
    add('--unit', default='', help='only of this unit of a robot')
    add('--since', default='', metavar='DATE', help='only created on or after it: 2026-03-14')
    add('--until', default='', metavar='DATE', help='only created before it')
    add('--all', action='store_true', help=f'print all rows, not {_MOST}')
    add('--forget-lost', action='store_true', help='forget recordings whose files are gone')
    add(
        '--export',
        type=Path,
        metavar='FOLDER',
        help='write recordings, quality and coefficients as Parquet, for pandas and DuckDB',
    )
    options = parser.parse_args(own_arguments(args))
    from wattwalk_core.errors import InputError
    from wattwalk_core.quoting import printable

    from power_recordings.index.store import ENVIRONMENT, RecordingIndex, usual_path
    from power_recordings.index.tables import FILES, Question, add_cards, export, listed

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
        question = Question(options.robot, options.unit, options.since, options.until)
        _print(listed(index, question), None if options.all else _MOST)
        if options.export is not None:
            export(index, options.export)
            print(f'{printable(str(options.export))}: {", ".join(FILES)}')
    return 0


def _print(rows: list[dict[str, object]], most: int | None) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from wattwalk_core.quoting import printable

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
