"""A guessed import map from a log's columns: their names, units and first rows."""

import json
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from wattwalk_core.errors import printable

from power_recordings.importing.candidates import MECHANICAL, CandidateColumn, candidates
from power_recordings.importing.evidence import (
    Choice,
    choose,
    companion,
    made_of_current,
    metered_pair,
)
from power_recordings.importing.listing import Listed
from power_recordings.importing.map_file import FORMAT, QUANTITIES
from power_recordings.importing.words import words

_GUESSED_UNIT: Final = {
    'position': 'rad',
    'command': 'rad',
    'velocity': 'rad/s',
    'torque': 'N*m',
    'motor_current': 'A',
    'voltage': 'V',
    'current': 'A',
    'power': 'W',
    'temperature': 'degC',
}
_TURN: Final = 400.0  # degrees; a unitless angle from 0 to there is in degrees
_RADIANS: Final = 16 * np.pi  # that an angle without unit may reach before it counts as degrees
_LEAST_RATE: Final = 25.0  # Hz
_TIMES: Final = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
_RATES: Final = (5.0, 2e4)  # Hz
_ODRIVE: Final = 'fet_temp is of an ODrive, which counts turns: check'
_OTHERS: Final = 2  # candidates that are named beside the one that was taken


def guess_map(listed: Sequence[Listed], robot: str, *, is_bag: bool) -> str:
    """Return the YAML of a map that takes what the columns suggest, with the reason by each."""
    found = candidates(listed)
    by_drive: dict[str, dict[str, list[CandidateColumn]]] = defaultdict(lambda: defaultdict(list))
    for c in sorted(found, key=lambda c: (c.held, c.rank)):
        if c.quantity in (*QUANTITIES, 'winding'):
            by_drive[c.drive][c.quantity].append(c)
    drives = {d: q for d, q in by_drive.items() if d and set(MECHANICAL) & set(q)}
    shared = {q: own for d, qs in by_drive.items() if d not in drives for q, own in qs.items()}
    if not drives and set(MECHANICAL) & set(shared):
        drives, shared = {'': shared}, {}
    lines = [f'format: {FORMAT}', 'time: {stamp: header}   # or log' if is_bag else _time(found)]
    lines.append('drives:')
    in_turns = any('fet_temp' in words(c.address) for c in found)
    bodies = {n or 'DRIVE': _Drive(q, shared, in_turns).lines() for n, q in drives.items()}
    for name, body in _folded(bodies).items():
        lines += [f"  '{name}':" if '*' in name else f'  {_quoted(name)}:', *body]
    if not drives:
        lines.append('  DRIVE: {}   # no column looks like a position, speed or torque: fill in')
    lines += _supply_lines(found)
    lines.append(f'card: {{robot: {robot}}}')
    return '\n'.join(lines) + '\n'


class _Drive:
    """The lines of one drive: its own columns, and those that no drive owns."""

    def __init__(
        self,
        own: Mapping[str, list[CandidateColumn]],
        shared: Mapping[str, list[CandidateColumn]],
        in_turns: bool,
    ) -> None:
        self._in_turns = in_turns
        measured = [c for c in own.get('torque', ()) if not c.held]
        if not measured and 'torque' in own and 'torque' in shared:
            own = {**own, 'torque': [*shared['torque'], *own['torque']]}
        self._own, self._shared = own, shared
        self._choice: Choice | None = choose(dict(own))
        self._taken = self._take()

    def _take(self) -> dict[str, CandidateColumn]:
        taken = {q: own[0] for q, own in self._own.items() if own and q != 'winding'}
        if winding := self._own.get('winding'):
            taken['motor_current' if 'torque' in taken else 'torque'] = winding[0]
        if (choice := self._choice) is not None:
            taken |= {'torque': choice.torque, 'velocity': choice.velocity}
            parts = choice.meter.parts
            if len(parts) == 1 and (pair := metered_pair(parts[0], dict(self._own))) is not None:
                parts = pair.parts
            for quantity in ('power', 'current'):
                taken.pop(quantity, None)
            taken |= {part.quantity: part for part in parts}
        for quantity in ('current', 'voltage', 'temperature'):
            others = self._shared.get(quantity, [])
            wanted = quantity == 'temperature' or (
                'power' not in taken if quantity == 'current' else True
            )
            if others and wanted and _better(others[0], taken.get(quantity), quantity):
                taken[quantity] = others[0]
        if 'current' in taken:
            taken.pop('power', None)
            volts = [*self._own.get('voltage', []), *self._shared.get('voltage', [])]
            volts.sort(key=lambda c: c.rank)
            if (own := companion(taken['current'], volts)) is not None:
                taken['voltage'] = own
        if not {'current', 'power'} & set(taken):
            taken.pop('voltage', None)
        if 'velocity' in taken and 'position' in taken and not _follows(taken):
            taken.pop('position')
        return taken

    def lines(self) -> list[str]:
        """Return one line a quantity."""
        return [self._line(q, self._taken[q]) for q in QUANTITIES if q in self._taken]

    def _line(self, quantity: str, taken: CandidateColumn) -> str:
        notes = [taken.why]
        unit = taken.unit
        if quantity == 'velocity' and not unit:
            unit, why = self._speed_unit(taken)
            notes.append(why)
        elif quantity in ('position', 'command') and not unit:
            unit, why = self._angle_unit(taken)
            notes.append(why)
        elif not unit:
            notes.append('unit not stated: check')
        parts = [f'from: {_quoted(taken.address)}', f'unit: {unit or _GUESSED_UNIT[quantity]}']
        if quantity == 'torque':
            at, why = self._at(taken)
            parts[1:] = [f'unit: {unit or "A"}'] if taken.quantity == 'winding' else parts[1:]
            parts.append(f'at: {at}')
            notes.append(why)
        if quantity in ('current', 'power'):
            parts.append('positive: drawn')
            if re.search(r'ibus', words(taken.address).replace('_', '')):
                parts.append('computed: true')
                notes.append('a controller computes it from the currents of its motor')
        if taken in [c for own in self._shared.values() for c in own]:
            notes.append('shared by all drives?')
        others = [c for c in self._rivals(quantity, taken) if c != taken][:_OTHERS]
        if others:
            notes.append('or ' + printable(', '.join(c.address + c.doubt for c in others)))
        return f'    {quantity}: {{{", ".join(parts)}}}   # {"; ".join(notes)}'

    def _rivals(self, quantity: str, taken: CandidateColumn) -> list[CandidateColumn]:
        own = [*self._own.get(taken.quantity, []), *self._shared.get(taken.quantity, [])]
        if quantity == 'current':
            own += self._own.get('power', [])
        return own

    def _speed_unit(self, taken: CandidateColumn) -> tuple[str, str]:
        name = words(taken.address)
        if 'erpm' in name:
            return 'rpm', 'electrical: give scale: 0.1047 / pole pairs instead'
        if 'rpm' in name:
            return 'rpm', 'unit by its name'
        if self._choice is not None and self._choice.velocity == taken:
            unit = self._choice.speed_unit
            return unit, f'unit by physics: in {unit} {self._choice.why}'
        return ('rev/s', _ODRIVE) if self._in_turns else ('rad/s', 'unit not stated: check')

    def _angle_unit(self, taken: CandidateColumn) -> tuple[str, str]:
        if _RADIANS < taken.listed.high <= _TURN:
            return 'deg', 'unit by its range'
        velocity = self._taken.get('velocity')
        if self._choice is not None and velocity is not None and not velocity.unit:
            return self._choice.speed_unit.removesuffix('/s').replace('rpm', 'rev'), 'as the speed'
        return ('rev', _ODRIVE) if self._in_turns else ('rad', 'unit not stated: check')

    def _at(self, taken: CandidateColumn) -> tuple[str, str]:
        if taken.quantity == 'winding':
            return 'motor', 'a current; with its constant: scale: N*m/A, from_unit: A'
        if (made := made_of_current(taken, self._own.get('winding', []))) is not None:
            return 'motor', f'it is {abs(made[1]):.4g} × {printable(made[0].address)}'
        return 'joint', 'at: motor where it is computed from a current'


def _better(other: CandidateColumn, own: CandidateColumn | None, quantity: str) -> bool:
    return own is None or (quantity == 'temperature' and other.rank < own.rank)


def _follows(taken: Mapping[str, CandidateColumn]) -> bool:
    """Tell whether a position that states no unit moves as the velocity says, in some unit."""
    position, velocity = taken['position'], taken['velocity']
    if position.unit or len(position.values) != len(velocity.values):
        return True
    steps, middle = np.diff(position.values), velocity.values[1:]
    good = np.isfinite(steps) & np.isfinite(middle)
    if good.sum() < 20 or not np.var(steps[good]) > 0 or not np.var(middle[good]) > 0:
        return True
    return bool(abs(np.corrcoef(steps[good], middle[good])[0, 1]) > 0.5)


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


def _supply_lines(found: Sequence[CandidateColumn]) -> list[str]:
    parts: list[str] = []
    for quantity in ('voltage', 'current', 'power'):
        own = [c for c in found if c.quantity == f'supply_{quantity}']
        if own and not (quantity == 'power' and len(parts) == 2):
            best = min(own, key=lambda c: c.rank)
            unit = best.unit or _GUESSED_UNIT[quantity]
            parts.append(f'{quantity}: {{from: {_quoted(best.address)}, unit: {unit}}}')
    return [f'supply: {{{", ".join(parts)}}}'] if len(parts) > 1 else []


def _time(found: Sequence[CandidateColumn]) -> str:
    times = [c for c in found if c.quantity == 'time' and _ascends(c)]
    parts = {words(c.address).replace('_', ''): c for c in found if c.quantity == 'time'}
    whole = next((c for n, c in parts.items() if n in ('sec', 'secs', 'seconds', 's')), None)
    rest = next((c for n, c in parts.items() if n in ('nsec', 'nsecs', 'nanosec', 'ns')), None)
    if whole is not None and rest is not None:
        columns = (
            f'{{from: {_quoted(whole.address)}, unit: s}}, '
            f'{{from: {_quoted(rest.address)}, unit: ns}}'
        )
        return f'time: {{columns: [{columns}]}}   # seconds and nanoseconds, by name'
    if not times:
        return (
            'time: {steady: true}   # no column looks like a time: each row an operating point; '
            'of a log at a fixed rate: {rate: 100}'
        )
    best = min(times, key=lambda c: (_counts(c), -round(c.listed.changes, 1), len(c.address)))
    unit, why = (best.unit, '') if best.unit else _time_unit(best)
    known = best.values[np.isfinite(best.values)]
    rows = len(known)
    seconds = float(np.ptp(known)) * _TIMES.get(unit, 1.0) if rows else 0.0
    if best.listed.changes < 0.5 and seconds > 0 and best.listed.changes * rows < seconds * 25:
        return (
            f'time: {{rate: {rows / seconds:.4g}}}   # rows over time: {best.address} changes in '
            f'{best.listed.changes:.0%} of the rows only'
        )
    others = [c.address for c in times if c != best][:_OTHERS]
    notes = [
        text for text in (why, f'or {printable(", ".join(others))}' if others else '') if text
    ]
    note = f'   # {"; ".join(notes)}' if notes else ''
    return f'time: {{column: {_quoted(best.address)}, unit: {unit}}}{note}'


def _ascends(candidate: CandidateColumn) -> bool:
    """Tell whether a column goes on as a time does; dates and what no row tells of count."""
    values = candidate.values[np.isfinite(candidate.values)]
    return len(values) < 2 or bool((np.diff(values) >= 0).mean() > 0.9)


def _counts(candidate: CandidateColumn) -> bool:
    """Tell whether a column numbers the rows."""
    known = candidate.values[np.isfinite(candidate.values)]
    return len(known) > 1 and bool((np.diff(known) == 1.0).all())


def _time_unit(candidate: CandidateColumn) -> tuple[str, str]:
    """The unit in a name, or the one that makes a likely rate."""
    named = [part for part in words(candidate.address).split('_') if part in _TIMES]
    if named:
        return named[0], f'{named[0]} by its name'
    steps = np.diff(candidate.values)
    steps = steps[steps > 0]
    if not len(steps):
        return 's', ''
    for unit, factor in _TIMES.items():
        if _RATES[0] <= (rate := 1 / (float(np.median(steps)) * factor)) <= _RATES[1]:
            return unit, f'{unit} makes {rate:.3g} rows a second'
    return 's', 'unit not stated: check'


def _quoted(text: str) -> str:
    if not text.isprintable():
        return json.dumps(text)
    if re.fullmatch(r'[A-Za-z_/][\w/.:\-]*', text) and not text.endswith(':'):
        return text if ': ' not in text else f"'{text}'"
    return "'" + text.replace("'", "''") + "'"
