"""`ros2 run power_recordings import`: a log that others recorded becomes a recording."""

import argparse
import sys
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from wattwalk_core.errors import InputError, printable

from power_recordings.alignment.align import align
from power_recordings.commands.info import print_quality
from power_recordings.importing.convert import import_logs
from power_recordings.importing.guess import guess_map
from power_recordings.importing.listing import extent, list_columns
from power_recordings.importing.map_file import ImportMap, load_map
from power_recordings.importing.plan import fitting_maps
from power_recordings.importing.sources import open_source
from power_recordings.importing.sources.heads import is_number
from power_recordings.importing.sources.source import LogSource
from power_recordings.index.kept_quality import Checked
from power_recordings.reading.reader import Recording

_MOST_NOTES = 20
_CHECKED = 100_000  # messages of a recording of over twice as many, to check after an import


def run(options: argparse.Namespace) -> None:
    """Print the columns of logs and a guessed map, or import them; InputError where it fails."""
    if options.list:
        first, *others = (open_source(log, options.msgs) for log in options.logs)
        _list(first, others)
        return
    if options.map is None:
        raise InputError(
            f'--map is missing: `import {options.logs[0]} --list` prints what is in the log and a '
            'map to edit'
        )
    if options.output is None:
        raise InputError('-o is missing: give the folder of the recording, such as -o bags/first')
    mapping = load_map(options.map)
    _import([open_source(log, options.msgs) for log in options.logs], mapping, options)


def _import(sources: Sequence[LogSource], mapping: ImportMap, options: argparse.Namespace) -> None:
    total = sum(source.size for source in sources)
    columns = (TextColumn('import'), BarColumn(), TextColumn('{task.percentage:.0f} %'))
    console = Console(stderr=True)
    quiet = not console.is_terminal
    with Progress(
        *columns, TimeRemainingColumn(), console=console, transient=True, disable=quiet
    ) as bar:
        task = bar.add_task('import', total=total)
        result = import_logs(
            sources,
            mapping,
            f'map {options.map}',
            options.output,
            lambda done: bar.update(task, completed=done),
            overwrite=options.overwrite,
        )
    samples = ', '.join(f'{count} {topic}' for topic, count in result.counts.items())
    print(f'{printable(str(result.path))}: {samples}')
    for note in result.notes[:_MOST_NOTES]:
        print(f'note: {printable(note)}')
    if len(result.notes) > _MOST_NOTES:
        print(f'note: and {len(result.notes) - _MOST_NOTES} more, in card.yaml')
    long = result.messages > 2 * _CHECKED
    recording = Recording.open(result.path, _CHECKED if long else None)
    if long:
        print(f'checked: the first {recording.duration:.0f} s; `info {result.path}` checks all')
    checked = Checked.of(recording)
    print_quality(checked)
    errors = {f.code for f in checked.quality.findings if f.severity == 'error'}
    if errors - {'slow_power'}:
        print(
            'next: mend the map as said above, and import again with --overwrite; where it is '
            'right, `power_lab fit` takes the recording with --ignore-unit-conflicts'
        )
        return
    try:
        align(recording, rate=50.0, need_power=recording.has('drive_supply'))
    except InputError as error:
        print(f'next: mend what keeps it from being judged: {printable(str(error))}')
        return
    fit = f'ros2 run power_lab fit {result.path} --effects shaft,copper_loss,idle -o base.yaml'
    print(f'next: {fit}' + (' --slow-meter' if errors else ''))


def _list(source: LogSource, others: Sequence[LogSource]) -> None:
    """Print the columns of a log and one map for it and others."""
    listed = list_columns(source)
    lines = [f'# {printable(str(source.path))}: {len(listed)} columns']
    columns = {item.column.address for item in listed}
    for other in others:
        own = {column.address for column in other.columns()}
        same = 'the same columns' if own == columns else 'other columns: list it by itself'
        lines.append(f'# {printable(str(other.path))}: {same}')
    lines += [f'# rows, min, max, changes: {part}'] if (part := extent(listed)) else []
    width = min(max((len(item.column.address) for item in listed), default=6), 60)
    rates = '    rate' if any(item.rate > 0 for item in listed) else ''
    lines.append(f'# {"column":{width}}  unit     rows        min        max  changes{rates}')
    for item in listed:
        rate = f' {item.rate:6.4g} Hz' if item.rate > 0 else ''
        digits = 10 if item.low < item.high and f'{item.low:.4g}' == f'{item.high:.4g}' else 4
        low, high = ('' if np.isnan(x) else f'{x:z.{digits}g}' for x in (item.low, item.high))
        name, unit = printable(item.column.address, 120), printable(item.column.unit, 12)
        lines.append(
            f'# {name:{width}}  {unit:5} {item.rows:8d} {low:>10} {high:>10} '
            f'{item.changes:7.0%}{rate}'
        )
    lines += [f'# the ready map {name} fits: --map {name}' for name in fitting_maps(source)]
    if sum(is_number(item.column.address) for item in listed) > 0.5 * len(listed):
        lines.append('# its head holds numbers (a map over two quantities?): give one row a point')
    lines.append('# guessed map: edit, save as FILE.yaml, then import with --map FILE.yaml')
    robot = ''.join(c if c.isalnum() else '_' for c in source.path.stem)[:40] or 'robot'
    sys.stdout.write('\n'.join(lines) + '\n')
    sys.stdout.write(guess_map(listed, robot, is_bag=source.is_bag))
