"""Logs of others on the page: a guessed map, the signals that it gives, the import."""

import re
import shutil
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from typing import Any, Final

from wattwalk_core.errors import InputError
from wattwalk_core.files import reason, write_whole
from wattwalk_core.yaml_file import dump_yaml, parse_yaml, read_yaml

from power_workbench.views import maps

Show = Callable[[str, Any], None]
ENDINGS = (
    *('.csv', '.tsv', '.txt', '.dat', '.xlsx', '.xlsm', '.parquet', '.pq', '.feather', '.arrow'),
    *('.mat', '.h5', '.hdf5', '.hdf', '.json', '.jsonl', '.ndjson', '.hebilog', '.bag', '.mcap'),
    '.db3',
)
"""Of the names of files that can be imported."""
_MAP = 'map'
_PLACE = re.compile(rf'^{_MAP}: (?P<place>(?:drives\.[^:]+|supply|time|stamp|card)[^:]*): ')
_FIX = re.compile(r'time: \{(rate|unit): ([\w.]+)\}')
_OF_TIME = re.compile(r'\b(no time|times? (in|reach|goes|of the row)|with a time)\b')


def look(show: Show, file: str) -> dict[str, Any]:
    """Return the columns of a log, a guessed import map with remarks, and the ready maps that fit.

    show: takes ('progress', text); remarks: by entry of the map. InputError for an unreadable log.
    """
    from power_recordings.importing.guess import guess_map  # slow to import
    from power_recordings.importing.listing import list_columns
    from power_recordings.importing.map_file import MAPS
    from power_recordings.importing.plan import fitting_maps
    from power_recordings.importing.sources import open_source

    path = Path(file)
    source = open_source(path)
    show('progress', 'reading the first rows')
    listed = list_columns(source)
    robot = ''.join(c if c.isalnum() else '_' for c in path.stem)[:40] or 'robot'
    text = guess_map(listed, robot, is_bag=source.is_bag)
    return {
        'file': file,
        'is_bag': source.is_bag,
        'columns': [
            {
                'address': item.column.address,
                'unit': item.column.unit,
                'low': maps.short_one(item.low),
                'high': maps.short_one(item.high),
                'changes': item.changes > 0,
            }
            for item in listed
        ],
        'map': parse_yaml(text, 'guessed map'),
        'remarks': _remarks(text),
        'ready': [
            {'name': name, 'map': read_yaml(MAPS / f'{name}.yaml', 'map')}
            for name in fitting_maps(source)
        ],
    }


def preview(show: Show, file: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the signals of a log's first rows in SI units, by the import map `content`.

    A map or log that is wrong gives `misplaced` instead.
    """
    from power_recordings.importing.listing import preview_log  # slow to import
    from power_recordings.importing.map_file import parse_map
    from power_recordings.importing.origin import origin_of_power
    from power_recordings.importing.plan import make_plan
    from power_recordings.importing.sources import open_source

    try:
        mapping = parse_map(content, _MAP)
        source = open_source(Path(file))
        signals = preview_log(source, mapping, _MAP)
        plan = make_plan(mapping, source.columns(), _MAP, source.is_bag)
        formulas, notes = origin_of_power(source, plan)
    except InputError as error:
        return misplaced(error)
    return {
        'computed': formulas,
        'notes': notes,
        'signals': [
            {
                'drive': one.drive,
                'quantity': one.quantity,
                'unit': one.unit,
                'rows': one.rows,
                'low': maps.short_one(one.low),
                'high': maps.short_one(one.high),
                'values': maps.rounded(one.values),
            }
            for one in signals
        ],
    }


def bring_in(
    show: Show, file: str, content: Mapping[str, Any], map_file: Path, output: Path
) -> dict[str, Any]:
    """Write `content` to map_file, and import the log with it as the recording `output`.

    Returns path, counts of messages and notes; for a map or log that is wrong, `misplaced`.
    """
    from power_recordings.importing.convert import import_logs  # slow to import
    from power_recordings.importing.map_file import load_map, parse_map
    from power_recordings.importing.sources import open_source

    try:
        parse_map(content, _MAP)
        source = open_source(Path(file))
        write_whole(map_file, dump_yaml(content))

        def tell(done: int) -> None:
            show('progress', f'{min(done / max(source.size, 1), 1.0):.0%}')

        result = import_logs([source], load_map(str(map_file)), _MAP, output, tell)
    except InputError as error:
        return misplaced(error)
    counts = ', '.join(f'{count} {topic}' for topic, count in result.counts.items())
    return {'path': str(output), 'counts': counts, 'notes': list(result.notes[:20])}


def misplaced(error: InputError) -> dict[str, Any]:
    """Return an error of an import as content of JSON: `error`, `place`, `fix`.

    place: entry of the map, '' for none; fix: key and value that mend it, None without one.
    """
    text = str(error)
    found = _PLACE.match(text)
    place = found['place'] if found else 'time' if _OF_TIME.search(text) else ''
    words = text.removeprefix(f'{_MAP}: ').removeprefix(f'{place}: ')
    if 'without voltage' in words:
        place += '.voltage'
    fix = None
    if place == 'time' and (found := _FIX.search(words)):
        key, value = found.groups()
        fix = {'key': key, 'value': float(value) if key == 'rate' else value}
    return {'error': words, 'place': place, 'fix': fix}


def _remarks(text: str) -> dict[str, str]:
    """Comments of a guessed map, by the entry that they stand beside."""
    found, drive = {}, ''
    for line in text.splitlines():
        if head := re.match(r"  '?([^ ].*?)'?:", line):
            drive = head[1]
        entry, mark, remark = line.partition('   # ')
        if not mark:
            continue
        if quantity := re.match(r'    (\w+):', entry):
            found[f'drives.{drive}.{quantity[1]}'] = remark
        elif word := re.match(r'\s*([^:]+):', entry):
            found[word[1].strip()] = remark
    return found


LARGEST_LOG: Final = 2 << 30
"""Bytes of a log that is handed over; larger ones are named with their folder."""
_ROOM: Final = 1 << 30  # bytes that stay free on the disk
_FOLDER: Final = 'logs'


async def keep_log(
    folder: Path, name: str, length: int, chunks: AsyncIterator[bytes]
) -> dict[str, str]:
    """Write a log from chunks of bytes below a session's folder, or nothing; return {file: path}.

    length: bytes to come. InputError for a name that is no log's, and where the disk has no room.
    """
    if Path(name).name != name or name.startswith('.') or not name.isprintable():
        raise InputError(f'{name!r} is no name of a file')
    if not name.lower().endswith(ENDINGS):
        raise InputError(f'{name}: expected a log ({", ".join(ENDINGS)})')
    path = folder / _FOLDER / name
    part = path.with_name(f'.{name}.part')
    try:
        if shutil.disk_usage(folder).free - length < _ROOM:
            raise InputError(f'{name}: the disk of {folder} has no room for {length / 1e6:.0f} MB')
        path.parent.mkdir(exist_ok=True)
        with part.open('wb') as file:
            async for chunk in chunks:
                file.write(chunk)
        part.replace(path)
    except OSError as error:
        raise InputError(f'cannot write {path}: {reason(error)}') from error
    finally:
        part.unlink(missing_ok=True)
    return {'file': str(path)}
