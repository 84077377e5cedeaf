"""
Imports of mutated tables: each ends in one line of error, or in the recording that it should be.

Tables of one drive with other heads, separators, decimal marks, encodings, rows of units and
dates, gaps, sentinels, clocks and damaged bytes.
"""

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from power_recordings.commands.arguments import import_logs as import_main
from power_recordings.importing.times import START
from power_recordings.reading.reader import Recording

MAP = """
format: import/1
time: {column: t, unit: s}
drives:
  A:
    velocity: {from: w, unit: rad/s}
    torque: {from: 'm °', unit: N*m}
    voltage: {value: 24}
    current: {from: i, unit: A}
"""
_ROWS = 150
_TOLERANCE = 2e-3  # N·m
_MOST = 3  # mutations of a table


@dataclass
class MutatedTable:
    """A table on its way to bytes."""

    rng: np.random.Generator
    rows: np.ndarray  # [N, 4]: t, w, m, i
    names: list[str] = field(default_factory=lambda: ['t', 'w', 'm °', 'i'])
    above: list[str] = field(default_factory=list)
    below: list[str] = field(default_factory=list)
    delimiter: str = ','
    decimal: str = '.'
    missing: str = ''
    ending: str = '\n'
    encoding: str = 'utf8'
    tails: tuple[str, str] = ('', '')  # at the end of the head, of the rows
    damage: Callable[['MutatedTable', bytes], bytes] | None = None
    readable: bool = True  # is to be imported
    done: list[str] = field(default_factory=list)

    def some(self, count: int) -> np.ndarray:
        """Return rows by index, none the first."""
        return self.rng.integers(1, len(self.rows), count)

    def bytes(self) -> bytes:
        """Return the file."""
        tail = tuple(self.delimiter if t else '' for t in self.tails)
        lines = [*self.above, self.delimiter.join(self.names) + tail[0]]
        lines += [self.delimiter.join(units.split(',')) + tail[0] for units in self.below]
        for row in self.rows:
            fields = [self.missing if np.isnan(x) else f'{x:.9g}' for x in row]
            if self.decimal == ',':
                fields = [text.replace('.', ',') for text in fields]
            lines.append(self.delimiter.join(fields) + tail[1])
        raw = self.ending.join([*lines, '']).encode(self.encoding, 'replace')
        return self.damage(self, raw) if self.damage is not None else raw


def torque_at(t: np.ndarray) -> np.ndarray:
    """Return the torque of a table at its times in s, N·m."""
    return 2 + np.cos(0.7 * t)


def _separators(table: MutatedTable) -> None:
    table.delimiter = str(table.rng.choice([',', ';', '\t', '|']))
    table.decimal = str(table.rng.choice(['.', ','])) if table.delimiter != ',' else '.'


def _endings(table: MutatedTable) -> None:
    table.ending = str(table.rng.choice(['\r\n', '\r']))


def _encodings(table: MutatedTable) -> None:
    table.encoding = str(table.rng.choice(['utf-8-sig', 'latin-1', 'utf-16']))


def _tails(table: MutatedTable) -> None:
    choices = [(',', ''), ('', ','), (',', ',')]
    table.tails = choices[table.rng.integers(3)]


def _titles(table: MutatedTable) -> None:
    choices = ['2019-05-11 15:22:21.2', '# bench 3', '% a; b, c', 'Log of a drive', '']
    table.above = [str(c) for c in table.rng.choice(choices, table.rng.integers(1, 4))]


def _unit_rows(table: MutatedTable) -> None:
    table.below = [
        str(table.rng.choice(['s,rad/s,N*m,A', 's,rad/s,Nm,A', '[s],[rad/s],[Nm],[A]']))
    ]


def _empty_cells(table: MutatedTable) -> None:
    table.missing = str(table.rng.choice(['', 'nan', 'NaN', 'NA', 'null']))
    table.rows[table.some(12), table.rng.integers(1, 4, 12)] = np.nan


def _sentinels(table: MutatedTable) -> None:
    table.rows[table.some(6), table.rng.integers(1, 4, 6)] = 9.91e37


def _sparse(table: MutatedTable) -> None:
    table.rows[np.arange(len(table.rows)) % table.rng.integers(3, 8) != 0, 2] = np.nan


def _gaps(table: MutatedTable) -> None:
    start = table.rng.integers(10, len(table.rows) - 40)
    table.rows = np.delete(table.rows, np.s_[start : start + 25], axis=0)


def _repeats(table: MutatedTable) -> None:
    table.rows = np.repeat(table.rows, table.rng.integers(1, 3, len(table.rows)), axis=0)


def _disorder(table: MutatedTable) -> None:
    for i in table.some(2) - 1:
        table.rows[[i, i + 1]] = table.rows[[i + 1, i]]


def _blank_lines(table: MutatedTable) -> None:
    def damage(own: MutatedTable, raw: bytes) -> bytes:
        end = own.ending.encode(own.encoding.replace('utf-16', 'utf-16-le'))
        return raw + end * int(own.rng.integers(1, 5))

    table.damage = damage


def _head_lost(table: MutatedTable) -> None:
    table.names, table.readable = table.names[: table.rng.integers(1, 4)], False


def _other_names(table: MutatedTable) -> None:
    table.names[table.rng.integers(len(table.names))] = str(
        table.rng.choice(['', 'x', '3', 'm °'])
    )
    table.readable = False


def _bytes_replaced(table: MutatedTable) -> None:
    def damage(own: MutatedTable, raw: bytes) -> bytes:
        array = np.frombuffer(raw, np.uint8).copy()
        places = own.rng.integers(0, len(array), own.rng.integers(1, 40))
        array[places] = own.rng.integers(0, 256, len(places))
        return array.tobytes()

    table.damage, table.readable = damage, False


def _cut(table: MutatedTable) -> None:
    def damage(own: MutatedTable, raw: bytes) -> bytes:
        start, stop = sorted(own.rng.integers(0, len(raw), 2).tolist())
        return raw[:start] + (raw[stop:] if own.rng.random() < 0.5 else b'')

    table.damage, table.readable = damage, False


def _shuffled(table: MutatedTable) -> None:
    table.rows, table.readable = table.rng.permutation(table.rows), False


MUTATIONS = {
    name.removeprefix('_'): mutate
    for name, mutate in globals().copy().items()
    if name.startswith('_') and callable(mutate) and not name.startswith('__')
}


def mutated(seed: int) -> MutatedTable:
    """Return the table of a seed."""
    rng = np.random.default_rng(seed)
    t = np.arange(_ROWS) * 0.02
    rows = np.stack([t, 5 + np.sin(t), torque_at(t), 1 + 0.1 * np.sin(3 * t)], axis=1)
    table = MutatedTable(rng, rows)
    for name in rng.choice(sorted(MUTATIONS), rng.integers(1, _MOST + 1), replace=False):
        MUTATIONS[name](table)
        table.done.append(str(name))
    return table


def fault(table: MutatedTable, folder: Path) -> tuple[int, str]:
    """Import a table; return the exit code, and what is wrong with the result ('': nothing)."""
    folder.mkdir(parents=True)
    log, mapping, out = folder / 'log.csv', folder / 'map.yaml', folder / 'bag'
    log.write_bytes(table.bytes())
    mapping.write_text(MAP)
    said, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(error):
        code = import_main([str(log), '--map', str(mapping), '-o', str(out)])
    text = error.getvalue()
    if code:
        if code != 2 or text.count('\n') != 1:
            return code, f'exit code {code}, error {text!r}'
        if left := [path.name for path in folder.iterdir() if path not in (log, mapping)]:
            return code, f'{left} left behind'
        return code, f'refused: {text.strip()}' if table.readable else ''
    if not table.readable:
        return 0, ''
    joints = Recording.open(out).joint_states()
    t, found = (joints.stamp_ns - START * 10**9) / 1e9, joints.effort[:, 0]
    known = np.isfinite(found)
    if known.sum() < 0.1 * len(table.rows):
        return 0, f'{known.sum()} of {len(found)} torques known'
    worst = float(np.abs(found - torque_at(t))[known].max())
    return 0, f'torque is off by {worst:.3g} N·m' if worst > _TOLERANCE else ''
