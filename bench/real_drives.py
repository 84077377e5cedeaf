"""Logs of real drives, from guessed map to verdict: the table of docs/results/real_drives.md.

    python bench/real_drives.py [LOG…] [--no-write]

Lines edited: entries of the guessed map that differ from the map that is used, in column, size of
the unit, sign, or the torque's side. The expert's regression is P = a·τω + b·τ² + c·|ω| + d in
sample, of a robot the sum of that over its drives.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from drive_logs import (
    DRIVE_LOGS,
    HERE,
    DriveLog,
    imported,
    is_whole,
    log_files,
    log_map,
    metered,
    residual,
)
from power_lab.session import Session
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.importing.guess import guess_map
from power_recordings.importing.listing import list_columns
from power_recordings.importing.map_file import DriveMap, ImportMap, Signal, parse_map
from power_recordings.importing.sources import open_source
from power_recordings.importing.units import conversion
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.yaml_file import read_yaml

PAGE = HERE.parent / 'docs' / 'results' / 'real_drives.md'
BEGIN, END = '<!-- bench-real: begin -->', '<!-- bench-real: end -->'
HEAD = (
    '| log | lines edited | R² held out | expert regression | verdict | s |',
    '|---|---|---|---|---|---|',
)
_COMPARED = ('velocity', 'torque', 'voltage', 'current', 'power', 'temperature')
_SIMILAR = 0.01  # of scales that are the same unit


def edited(guess: ImportMap, used: ImportMap) -> int:
    """Count entries in which a guessed map differs from the used one, in the closest drive."""
    (drive, *_) = used.drives.values()
    lines = min(_differences(other, drive) for other in guess.drives.values())
    return lines + (guess.time != used.time and _time(guess) != _time(used))


def _time(mapping: ImportMap) -> tuple[object, ...]:
    given = mapping.time
    return () if given is None else (given.column, given.columns, given.steady, given.rate)


def _differences(guess: DriveMap, used: DriveMap) -> int:
    found, wanted = guess.signals(), used.signals()
    power = {'voltage', 'current'} <= found.keys() and 'power' in wanted
    return sum(
        name not in found or _differ(name, found[name], wanted[name])
        for name in _COMPARED
        if name in wanted and not (name == 'power' and power and not wanted[name].computed)
    )


def _differ(quantity: str, one: Signal, other: Signal) -> bool:
    sizes = [_size(quantity, each) for each in (one, other)]
    return (
        one.terms != other.terms
        or (one.at or 'joint') != (other.at or 'joint')
        or one.positive != other.positive
        or abs(sizes[0] / sizes[1] - 1.0) > _SIMILAR
    )


def _size(quantity: str, signal: Signal) -> float:
    """SI units of one of the log; of a torque that is a current, 1."""
    if signal.scale is not None:
        return signal.scale
    try:
        return conversion(signal.unit, quantity).factor if signal.unit else 1.0
    except InputError:
        return 1.0


def expert(data: AlignedDataset) -> str:
    """Return the in-sample R² (and slope a) of a plain regression of each metered power."""
    whole = is_whole(data)
    told = []
    for place, power in enumerate(metered(data).T):
        places = range(len(data.names)) if whole else (place,)
        parts = [_columns(data, one) for one in places]
        table = np.hstack([*parts, np.ones((len(power), 1))])
        power = np.where(np.isfinite(table).all(axis=1), power, np.nan)
        left, solved = residual(power, table)
        share = 1.0 - float(left.var() / np.nanvar(power))
        told.append(f'{share:.3f}' + ('' if whole else f' (a {solved[0]:.2f})'))
    return ', '.join(told)


def _columns(data: AlignedDataset, place: int) -> Floats:
    tau, w = (values[:, place].astype(np.float64) for values in (data.torque, data.velocity))
    return np.stack([tau * w, tau**2, np.abs(w)], axis=1)


def row(name: str, log: DriveLog) -> str:
    """Return a log's row of the table; InputError where it is absent or cannot be read."""
    began = time.monotonic()
    used, source = log_map(log.map), open_source(log_files(log.files)[0], None)
    with tempfile.TemporaryDirectory(prefix='wattwalk') as folder:
        lines = 'ready map'
        if Path(log.map).suffix:
            guess = Path(folder) / 'guess.yaml'
            guess.write_text(guess_map(list_columns(source), 'robot', is_bag=False), 'utf-8')
            lines = str(edited(parse_map(read_yaml(guess, 'map'), 'guess'), used))
        bags = imported(log.files, log.map, Path(folder))
        fitted = ' + '.join([name, *log.known[len(DriveLog.known) :]])
        parts = [fitted, lines, *judged(bags, log)]
    return f'| {" | ".join(parts)} | {time.monotonic() - began:.0f} |'


def judged(bags: list[Path], log: DriveLog) -> list[str]:
    """Return cells: held-out R², the expert's regression and the verdict."""
    try:
        lab = Session.open(*bags)
        slow = ''
    except InputError as error:
        if '--slow-meter' not in str(error):
            raise
        lab, slow = Session.open(*bags, slow=True), ' (`--slow-meter`)'
    regression = expert(lab.recordings.data)
    try:
        lab = lab.fit(' '.join(log.known))
        scores = [f'{score.r2:.3f}' for score in lab.score.drives.values()]
    except InputError as error:
        return ['–', regression, _refused(error)]
    found = [', '.join(scores) + slow, regression]
    try:
        outcome = lab.diagnose()
    except InputError as error:
        return [*found, _refused(error)]
    names = ', '.join(outcome.diagnosis.effects)
    return [*found, f'`{outcome.verdict}` {names}'.strip()]


def _refused(error: InputError) -> str:
    return f'refused: {_inline(str(error)).partition(";")[0]}'


def _inline(text: str) -> str:
    """Text of a cell, without paths of this machine."""
    words = (word.rpartition('/')[2] if word.startswith('/') else word for word in text.split())
    return ' '.join(words).replace('|', '∣')


def main() -> int:
    """Print the table and write it into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('logs', nargs='*', metavar='LOG', help=', '.join(DRIVE_LOGS))
    parser.add_argument('--no-write', action='store_true', help='print alone')
    options = parser.parse_args()
    rows = []
    for name in options.logs or DRIVE_LOGS:
        try:
            rows.append(row(name, DRIVE_LOGS[name]))
        except InputError as error:
            rows.append(f'| {name} | – | – | – | not read: {_inline(str(error))} | – |')
        print(rows[-1], flush=True)
    if not options.no_write and not options.logs:
        text = PAGE.read_text('utf-8')
        before, after = text.split(BEGIN)[0], text.split(END)[1]
        write_whole(PAGE, '\n'.join([f'{before}{BEGIN}', '', *HEAD, *rows, '', END]) + after)
    return 0


if __name__ == '__main__':
    sys.exit(main())
