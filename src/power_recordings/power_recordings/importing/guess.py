"""A guessed import map from the names of a log's columns, to be edited."""

import json
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from wattwalk_core.quoting import printable

from power_recordings.importing.map_file import FORMAT, QUANTITIES
from power_recordings.importing.sources.heads import unit_of
from power_recordings.importing.sources.source import LogColumn
from power_recordings.importing.units import quantities_of

_WANTED = r'(cmd|command|target|setpoint|desired|demand|(^|_)(ref|des|set|goal)(_|$))'
_ROBOT = r'(robot|main|system|battery|batt|total|pack|(^|_)power_[va](_|$))'
# The first expression that fits decides; among columns of one quantity, the earlier is better.
_RULES: Final = (
    ('time', r'^(time|t|timestamp|stamp|seconds|sec|elapsed\w*)(_?(s|ms|us|ns|sec))?$'),
    (
        '',
        r'(scaling|fraction|limit|mode|error|fault|status|bits?(_|$)|register|sample|tool|tcp|force|accelerometer|imu|inertia|computed|momentum|foc_|receive_time)',
    ),
    ('command', rf'{_WANTED}.*(pos|angle|(^|_)q(_|$))|(pos|angle|(^|_)q(_|$)).*{_WANTED}'),
    ('', rf'{_WANTED}'),
    ('supply_voltage', r'robot.*volt'),
    ('supply_voltage', rf'{_ROBOT}.*(volt|_v(_|$))'),
    ('supply_current', rf'{_ROBOT}.*(curr|(^|_)amps?(_|$)|_a(_|$))'),
    ('supply_power', rf'{_ROBOT}.*(power|watt)'),
    ('temperature', r'(winding|motor).*temp|temp.*(winding|motor)'),
    ('temperature', r'temp'),
    ('voltage', r'(bus|dc|input|supply|board|vbus).*(volt|_v(_|$))|vbus|v_bus'),
    ('current', r'(bus|dc|input|supply|ibus).*(curr|(^|_)amps?(_|$))|ibus|i_bus'),
    ('power', r'(power|watt).*(el|dc|in)|(el|dc|in)\w*_(power|watt)'),
    ('torque', r'(torque|trq|(^|_)tau|effort|moment)'),
    ('winding', r'(q_?current|(^|_)iq|i_?q(_|$)|winding_current|motor_current|phase_current)'),
    ('winding', r'(actual|joint|measured).*current'),
    ('voltage', r'volt|(^|_)v(_|$)'),
    ('current', r'curr|(^|_)amps?(_|$)|(^|_)i(_|$)'),
    ('power', r'power|watt'),
    ('velocity', r'(vel|speed|omega|rpm|(^|_)(qd|dq)(_|$)|(^|_)w(_|$))'),
    ('position', r'(pos|angle|theta|(^|_)q(_|$))'),
)
_GUESSED_UNIT: Final = {
    'position': 'rad',
    'command': 'rad',
    'velocity': 'rad/s',
    'torque': 'N*m',
    'voltage': 'V',
    'current': 'A',
    'power': 'W',
    'temperature': 'degC',
}


@dataclass(frozen=True)
class Guess:
    """Quantity of a column, the rank of the rule that said so, and its pattern by drive."""

    quantity: str
    rank: int
    pattern: str  # the address with * for what tells drives apart
    drive: str
    column: LogColumn


def guess_map(columns: Sequence[LogColumn], robot: str, *, is_bag: bool) -> str:
    """
    Return the YAML of a map that takes what the columns' names suggest.

    columns: those that are worth a guess; leave out what never changes.
    """
    guesses = [g for column in columns for g in _guesses(column)]
    by_drive: dict[str, dict[str, list[Guess]]] = defaultdict(lambda: defaultdict(list))
    for guess in guesses:
        if guess.quantity in (*QUANTITIES, 'winding'):
            by_drive[guess.drive][guess.quantity].append(guess)
    drives = {
        d: q for d, q in by_drive.items() if {'position', 'velocity', 'torque', 'winding'} & set(q)
    }
    lines = [f'format: {FORMAT}']
    if is_bag:
        lines.append('time: {stamp: header}   # or log')
    else:
        lines.append(_time(guesses))
    lines.append('drives:')
    shared = {q: gs for d, qs in by_drive.items() if d not in drives for q, gs in qs.items()}
    bodies = {name or 'DRIVE': _drive_lines(q, shared) for name, q in drives.items()}
    for name, body in _folded(bodies).items():
        lines += [f"  '{name}':" if '*' in name else f'  {_quoted(name)}:', *body]
    if not drives:
        lines.append('  DRIVE: {}   # no column looks like a position, speed or torque: fill in')
    lines += _supply_lines(guesses)
    lines.append(f'card: {{robot: {robot}}}')
    return '\n'.join(lines) + '\n'


def _guesses(column: LogColumn) -> list[Guess]:
    name = _words(column.address)
    for rank, (quantity, rule) in enumerate(_RULES):
        if not re.search(rule, name):
            continue
        fits = quantities_of(column.unit) if column.unit else ()
        plain = quantity.removeprefix('supply_')
        if fits and quantity not in ('', 'winding') and plain not in fits:
            continue
        if not quantity:
            return []
        drive, pattern = _drive(column.address)
        return [Guess(quantity, rank, pattern, drive, column)]
    return []


def _words(address: str) -> str:
    """An address in lower case, words apart by _, without units in brackets and numbers."""
    name = re.sub(r'\s*[\[(][^\[\]()]*[\])]$', '', address) if '[' in address else address
    name = name.rpartition(':')[2]
    name = re.sub(r'([a-z])([A-Z])', r'\1_\2', name).lower()
    name = re.sub(r'[^a-z]+', '_', name).strip('_')
    return re.sub(r'^(motor_data|data|feedback)_', '', name)


def _drive(address: str) -> tuple[str, str]:
    """Return the drive in a column's name (a number, or a name in brackets), and the pattern."""
    in_brackets = re.search(r'\[([^\[\]]+)\](?!.*\[[^\[\]]+\])', address)
    if in_brackets and (':' in address):
        key = in_brackets[1]
        name = key if not key.isdigit() else f'DRIVE_{key}'
        return name, address.replace(f'[{key}]', '[*]')
    numbers = list(re.finditer(r'\d+', address))
    if not numbers:
        return '', address
    last = numbers[-1]
    return f'DRIVE_{last[0]}', f'{address[: last.start()]}*{address[last.end() :]}'


def _drive_lines(
    quantities: Mapping[str, Sequence[Guess]], shared: Mapping[str, Sequence[Guess]]
) -> list[str]:
    lines = []
    for quantity in QUANTITIES:
        found = sorted(quantities.get(quantity, ()), key=lambda g: g.rank)
        note = ''
        if quantity == 'torque' and not found and quantities.get('winding'):
            found = sorted(quantities['winding'], key=lambda g: g.rank)
            address = _quoted(found[0].column.address)
            lines.append(
                f'    torque: {{from: {address}, unit: A, at: motor}}'
                '   # a current; with its constant: scale: N*m/A, from_unit: A'
            )
            continue
        if quantity == 'power' and 'current' in quantities:
            continue
        missing = quantity == 'current' and 'power' not in quantities
        missing |= quantity == 'voltage' and bool({'current', 'power'} & {*quantities, *shared})
        if not found and missing and shared.get(quantity):
            found = sorted(shared[quantity], key=lambda g: g.rank)
            note = 'shared by all drives?'
        if not found:
            continue
        best = found[0]
        unit = best.column.unit or unit_of(best.column.address)
        parts = [
            f'from: {_quoted(best.column.address)}',
            f'unit: {unit or _GUESSED_UNIT[quantity]}',
        ]
        if quantity == 'torque':
            parts.append('at: joint')
            note = 'at: motor where it is computed from a current'
        if quantity in ('current', 'power'):
            parts.append('positive: drawn')
        if not unit and not note:
            note = 'unit not stated: check'
        others = printable(', '.join(g.column.address for g in found[1:3]))
        note = '; '.join(part for part in (note, f'or {others}' if others else '') if part)
        lines.append(f'    {quantity}: {{{", ".join(parts)}}}' + (f'   # {note}' if note else ''))
    return lines


def _folded(bodies: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Drives that differ by their number alone as one with a *."""
    if len(bodies) < 2 or not all(name.startswith('DRIVE_') for name in bodies):
        return dict(bodies)
    stars = {}
    for name, body in bodies.items():
        number = re.escape(name.removeprefix('DRIVE_'))
        body = [re.sub(rf'(   #.*\w_?){number}\b', r'\g<1>*', line) for line in body]
        stars[name] = [
            re.sub(rf"(from: '?[^,'}}]*?){number}(?=[^\d,]*,)", r'\g<1>*', line) for line in body
        ]
    plain = [[line.split('   #')[0] for line in body] for body in stars.values()]
    same = all(body == plain[0] and all('*' in line for line in body) for body in plain)
    return {'DRIVE_*': next(iter(stars.values()))} if same else dict(bodies)


def _supply_lines(guesses: Sequence[Guess]) -> list[str]:
    parts: list[str] = []
    for quantity in ('voltage', 'current', 'power'):
        found = [g for g in guesses if g.quantity == f'supply_{quantity}']
        if found and not (quantity == 'power' and len(parts) == 2):
            best = min(found, key=lambda g: g.rank)
            unit = best.column.unit or _GUESSED_UNIT[quantity]
            parts.append(f'{quantity}: {{from: {_quoted(best.column.address)}, unit: {unit}}}')
    return [f'supply: {{{", ".join(parts)}}}'] if len(parts) > 1 else []


def _time(guesses: Sequence[Guess]) -> str:
    found = [g for g in guesses if g.quantity == 'time']
    if not found:
        return 'time: {rate: 100}   # Hz; no column looks like a time: name one (column, unit)'
    column = min(found, key=lambda g: len(g.column.address)).column
    unit = column.unit or unit_of(column.address) or 's'
    others = [g.column.address for g in found if g.column != column][:2]
    note = f'   # or {printable(", ".join(others))}' if others else ''
    return f'time: {{column: {_quoted(column.address)}, unit: {unit}}}{note}'


def _quoted(text: str) -> str:
    if not text.isprintable():
        return json.dumps(text)
    if re.fullmatch(r'[A-Za-z_/][\w/.:\-]*', text) and not text.endswith(':'):
        return text if ': ' not in text else f"'{text}'"
    return "'" + text.replace("'", "''") + "'"
