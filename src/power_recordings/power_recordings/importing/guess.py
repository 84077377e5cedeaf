"""A guessed import map from a log's columns: their names, units and first rows."""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import printable

from power_recordings.importing import evidence
from power_recordings.importing.candidates import MECHANICAL, CandidateColumn, candidates
from power_recordings.importing.evidence import ByQuantity, Choice
from power_recordings.importing.ground import along_lines
from power_recordings.importing.listing import Listed
from power_recordings.importing.map_file import FORMAT, JOINT, QUANTITIES
from power_recordings.importing.time_guess import row_times, time_line
from power_recordings.importing.units import SI
from power_recordings.importing.words import words, yaml_text

_GUESSED_UNIT: Final = {**SI, 'efficiency': '1'}
_TURN: Final = 400.0  # degrees; a unitless angle from 0 to there is in degrees
_RADIANS: Final = 16 * np.pi  # that an angle without unit may reach before it counts as degrees
_BY_RATE: Final = 'unit by physics: velocity is then the rate of the position'
_ODRIVE: Final = 'named as by an ODrive, which counts turns: check'
_OF_ODRIVE: Final = r'(^|_)(fet_temp|fet_thermistor)|(pos|vel)_estimate'
_POWERS: Final = {'current', 'power', 'efficiency', 'loss'}  # what a power is known by
_WHOLE: Final = 1.5  # above which an efficiency counts percent
_CHANGES: Final = 0.2  # of the mean speed, by which it changes
_TURNED: Final = {
    'torque': 'power falls as torque × speed rises',
    'power': 'power falls as torque × speed rises, and losses give power',
    'both': 'losses give power',
}
"""What a log says of its signs as they are, by what is turned."""
_NONE: Final = '    # {}: {{from: COLUMN, unit: {}}}   # no column looks like one'
_NO_TORQUE: Final = (
    '    # torque: {{from: COLUMN, unit: N*m}}   # no column looks like one; of the current of a '
    'motor: {{from: {}, unit: {}, at: motor}}'
)
_OTHER_SIDE: Final = (
    '    # motor_current: {{from: {}, unit: A}}   # what was commanded, N·m for A up to a '
    'constant: without the leading #, `fit` holds both sides of the gear against the power'
)
_NO_VOLTAGE: Final = '    # voltage: {value: VOLTS, unit: V}   # no column is in volts: fill in'
_MOTORS: Final = r'(^|_)(motor|mot|rotor)(_|$)'
_COMPUTED: Final = r'(^|_)(est[a-z]*|hat|calc[a-z]*|cur[a-z]*|iq)(_|$)'
_MEASURED: Final = r'sensor|load_?cell|transducer'
_BEHIND: Final = r'joint|output|link'
_AT: Final = (
    '    # at: motor is a torque computed from the current, at: joint that of a sensor behind the '
    'gear; it decides which effects can be found: check'
)
_GEAR: Final = (
    '    # gear_ratio: 1   # fill in: motor turns to one of the joint. at: motor then divides '
    'position and velocity; torque of the shaft of the motor needs scale: RATIO'
)
_METER: Final = 'of a meter? If a firmware computes it from motor currents: computed: true'
_NO_POWER: Final = (
    '    # current: {from: COLUMN, unit: A}   # no column looks like that of a supply; or power: '
    '{from: COLUMN, unit: W}'
)
_UNUSED: Final = '  # not used: {}. Of another drive? Give it an entry; a common meter is a supply'
_METERED: Final = ('voltage', 'current', 'power')
_OTHERS: Final = 2  # candidates that are named beside the one that was taken


def guess_map(listed: Sequence[Listed], robot: str, *, is_bag: bool) -> str:
    """Return the YAML of an import map guessed from columns, each entry with its reason."""
    found = candidates(listed)
    by_drive: dict[str, dict[str, list[CandidateColumn]]] = defaultdict(lambda: defaultdict(list))
    for c in sorted(found, key=lambda c: (c.held, c.rank)):
        if c.quantity in (*QUANTITIES, 'winding'):
            by_drive[c.drive][c.quantity].append(c)
    drives = {
        c.drive: by_drive[c.drive]
        for c in found
        if c.drive and set(MECHANICAL) & set(by_drive[c.drive])
    }
    shared = {q: own for d, qs in by_drive.items() if d not in drives for q, own in qs.items()}
    if not drives and set(MECHANICAL) & set(shared):
        drives, shared = {'': shared}, {}
    whole = {q: [c for c in found if c.quantity == f'supply_{q}'] for q in _METERED}
    metered = any(_POWERS & set(own) for own in drives.values())
    if not metered and len(drives) > 1:  # one meter of all
        whole = {q: [*shared.pop(q, []), *own] for q, own in whole.items()}
    elif not metered and drives and not _POWERS & set(shared):
        (alone,) = drives.values()
        for q in filter(whole.get, _METERED):
            alone[q] = [*alone.get(q, ()), *(replace(c, quantity=q) for c in whole.pop(q))]
    if not shared.get('voltage') and not all(own.get('voltage') for own in drives.values()):
        of_others = [c for c in found if c.quantity in ('voltage', 'supply_voltage')]
        shared['voltage'] = [replace(c, quantity='voltage') for c in of_others]
    lines = [
        f'format: {FORMAT}',
        'time: {stamp: header}   # or log' if is_bag else time_line(found, listed),
        'drives:',
    ]
    in_turns = any(re.search(_OF_ODRIVE, words(one.column.address)) for one in listed)
    along = along_lines(listed)
    time = row_times(found)
    made = {n or 'DRIVE': _Drive(q, shared, in_turns, along, time) for n, q in drives.items()}
    chosen = [drive.choice for drive in made.values() if drive.choice is not None]
    best = evidence.best_told(chosen)
    supply = _supply_lines(whole)
    bodies = {name: drive.lines(best, bool(supply)) for name, drive in made.items()}
    if len(made) == 1:
        lines += next(iter(made.values())).unused()
    for name, body in _folded(bodies).items():
        lines += [f"  '{name}':" if '*' in name else f'  {yaml_text(name)}:', *body]
    if not drives:
        lines.append('  DRIVE: {}   # no column looks like a position, speed or torque: fill in')
    lines += supply
    lines.append(f'card: {{robot: {robot}}}')
    return '\n'.join(lines) + '\n'


class _Drive:
    """The lines of one drive: its own columns, and those that no drive owns."""

    def __init__(
        self,
        own: ByQuantity,
        shared: ByQuantity,
        in_turns: bool,
        along: Mapping[str, str],
        time: Floats,
    ) -> None:
        self._in_turns, self._along, self._time = in_turns, along, time
        measured = [c for c in own.get('torque', ()) if not c.held]
        if not measured and 'torque' in own and 'torque' in shared:
            own = {**own, 'torque': [*shared['torque'], *own['torque']]}
        own = evidence.velocity_apart_from_voltage(own)
        self._own, self._shared = own, shared
        self.choice: Choice | None = evidence.choose(own)
        winding = own.get('winding')
        if winding and not any({'current', 'power'} & set(part) for part in (own, shared)):
            amps = [replace(c, quantity='current') for c in winding]
            self.choice = evidence.choose({**own, 'current': amps})
        self._taken = self._take()

    def _take(self) -> dict[str, CandidateColumn]:
        taken = {q: own[0] for q, own in self._own.items() if own and q != 'winding'}
        if winding := self._own.get('winding'):
            taken['motor_current' if 'torque' in taken else 'torque'] = winding[0]
        if (choice := self.choice) is not None:
            taken |= {'torque': choice.torque, 'velocity': choice.velocity}
            parts = choice.meter
            if len(parts) == 1:
                parts = evidence.metered_pair(parts[0], self._own) or parts
            for quantity in ('power', 'current'):
                taken.pop(quantity, None)
            taken |= {part.quantity: part for part in parts}
            if any(c.listed == part.listed for part in parts if (c := taken.get('motor_current'))):
                del taken['motor_current']
        self._current_of_motor(taken)
        for quantity in ('current', 'voltage', 'temperature'):
            others = self._shared.get(quantity, [])
            if not others or (quantity == 'current' and 'power' in taken):
                continue
            own = taken.get(quantity)
            if own is None or (quantity == 'temperature' and others[0].rank < own.rank):
                taken[quantity] = others[0]
        self._metered_power(taken)
        if 'current' in taken:
            taken.pop('power', None)
            volts = [*self._own.get('voltage', []), *self._shared.get('voltage', [])]
            volts.sort(key=lambda c: c.rank)
            if (companion := evidence.companion(taken['current'], volts)) is not None:
                taken['voltage'] = companion
        of_shaft = [q for q in ('efficiency', 'loss') if q in taken]
        keep = not {'current', 'power'} & set(taken) and {'torque', 'velocity'} <= set(taken)
        for quantity in of_shaft[1:] if keep else of_shaft:
            del taken[quantity]
        if not _POWERS & set(taken):
            taken.pop('voltage', None)
        if (
            'velocity' in taken
            and 'position' in taken
            and not evidence.follows(taken['position'], taken['velocity'])
        ):
            del taken['position']
        return taken

    def _metered_power(self, taken: dict[str, CandidateColumn]) -> None:
        """Leave a current that may be the motor's for a power that no voltage makes of it."""
        current, power = taken.get('current'), taken.get('power')
        if current is None or power is None or not current.is_vague:
            return
        if evidence.metered_pair(power, self._own) is None:
            del taken['current']

    def _current_of_motor(self, taken: dict[str, CandidateColumn]) -> None:
        """Take a current that the torque was computed from, at any speed, for the motor's."""
        current, torque, velocity = (taken.get(q) for q in ('current', 'torque', 'velocity'))
        if current is None or torque is None or velocity is None or 'motor_current' in taken:
            return
        speed = np.abs(velocity.values[np.isfinite(velocity.values)])
        changes = len(speed) and speed.std() > _CHANGES * speed.mean()
        if current.is_vague and changes and evidence.made_of_current(torque, [current]):
            taken['motor_current'] = replace(taken.pop('current'), quantity='winding')

    def _other_side(self) -> list[str]:
        """A commanded torque as what the motor was told, beside one that is measured."""
        measured = self._taken.get('torque')
        if measured is None or measured.held or 'motor_current' in self._taken:
            return []
        commands = [c.address for c in self._own.get('torque', ()) if c.held]
        return [_OTHER_SIDE.format(yaml_text(address)) for address in commands[:1]]

    def lines(self, best: Choice | None, metered: bool) -> list[str]:
        """Return one line a quantity, and what is lacking.

        best: the choice of a drive of the log that decides the unit of speeds. metered: there is
        a supply of the whole robot.
        """
        self.choice = best if self.choice is None else self.choice.with_unit_of(best)
        lines = []
        for quantity in QUANTITIES:
            if (taken := self._taken.get(quantity)) is not None:
                lines += [_AT] if quantity == 'torque' else []
                lines.append(self._line(quantity, taken))
            elif quantity in ('position', 'velocity'):
                none = _NONE.format(quantity, _GUESSED_UNIT[quantity])
                lines.append(self._along.get(quantity, none))
        of_motor = [t for q in JOINT if (t := self._taken.get(q)) and self._at(t)[0] == 'motor']
        lines = [_GEAR, *lines] if of_motor else lines
        lines += self._other_side()
        powered = bool(_POWERS & set(self._taken))
        if powered and 'temperature' not in self._taken:
            lines.append(_NONE.format('temperature', 'degC'))
        left = [c for c in self._own.get('current', ()) if c not in self._taken.values()]
        current = (yaml_text(left[0].address), left[0].unit or 'A') if left else ('COLUMN', 'A')
        lines += [] if 'torque' in self._taken else [_NO_TORQUE.format(*current)]
        if powered and 'voltage' not in self._taken:
            lines.append(_NO_VOLTAGE)
        elif not metered and not powered:
            lines.append(_NO_POWER)
        return lines

    def unused(self) -> list[str]:
        """Return a comment on columns of motion that seem to be of another drive, [] if none."""
        taken = self._taken.values()
        left = [c for q in JOINT for c in self._own.get(q, ()) if not c.held and c not in taken]
        several = len({c.quantity for c in left}) > 1
        return [_UNUSED.format(printable(', '.join(c.address for c in left)))] if several else []

    def _line(self, quantity: str, taken: CandidateColumn) -> str:
        notes = [taken.why]
        unit = taken.unit
        if quantity == 'velocity' and not unit:
            unit, why = self._speed_unit(taken)
            notes.append(why)
        elif quantity in ('position', 'command') and not unit:
            unit, why = self._angle_unit(taken)
            notes.append(why)
        elif quantity == 'efficiency' and not unit:
            unit = '%' if taken.listed.high > _WHOLE else '1'
            notes.append('unit by its range')
        elif not unit:
            notes.append('unit not stated: check')
        stated = unit or _GUESSED_UNIT[quantity]
        # To YAML % and 1 are no texts.
        stated = f"'{stated}'" if stated in ('%', '1', '-') else stated
        parts = [f'from: {yaml_text(taken.address)}', f'unit: {stated}']
        if quantity == 'torque':
            at, said = self._at(taken)
            parts[1:] = [f'unit: {unit or "A"}'] if taken.quantity == 'winding' else parts[1:]
            if why := self._turned('torque', taken):
                parts.append('scale: -1')
                notes.append(why)
            parts.append(f'at: {at}')
            notes += [said] if said else []
        if quantity in ('current', 'power'):
            fed = self._turned('power', taken)
            parts.append('positive: fed' if fed else 'positive: drawn')
            notes += [fed] if fed else []
            if re.search(r'(^|_)i_?bus(_|$)', words(taken.address)):
                parts += ['computed: true'] if self._in_turns else []
                notes.append('an ODrive computes it' if self._in_turns else _METER)
        if taken in [c for own in self._shared.values() for c in own]:
            notes.append('shared by all drives?')
        rivals = [*self._own.get(taken.quantity, []), *self._shared.get(taken.quantity, [])]
        rivals += self._own.get('power', []) if quantity == 'current' else []
        if others := [c for c in rivals if c != taken][:_OTHERS]:
            notes.append('or ' + printable(', '.join(c.address + c.doubt for c in others)))
        return f'    {quantity}: {{{", ".join(parts)}}}   # {"; ".join(notes)}'

    def _turned(self, what: str, taken: CandidateColumn) -> str:
        """Return how physics shows a column to count the other way, '' if it does not."""
        choice = self.choice
        if choice is None or not choice.turned or choice.turned not in (what, 'both'):
            return ''
        own = taken == choice.torque if what == 'torque' else taken in choice.meter
        return f'sign by physics: else {_TURNED[choice.turned]}' if own else ''

    def _speed_unit(self, taken: CandidateColumn) -> tuple[str, str]:
        name = words(taken.address)
        if 'erpm' in name:
            return 'rpm', 'electrical: give scale: 0.1047 / pole pairs instead'
        if 'rpm' in name:
            return 'rpm', 'unit by its name'
        if self.choice is not None and not self.choice.velocity.unit and not self._in_turns:
            unit, other = self.choice.speed_unit, self.choice.velocity
            if other == taken:
                return unit, f'unit by physics: in {unit} {self.choice.why}'
            return unit, f'unit as of {printable(other.address)}'
        if self._in_turns:
            return 'rev/s', _ODRIVE
        position = self._taken.get('position')
        angle = '' if position is None else position.unit or self._angle_unit(position)[0]
        by_rate = self._by_rate(angle, '')
        return (by_rate, _BY_RATE) if by_rate else ('rad/s', 'unit not stated: check')

    def _by_rate(self, angle: str, speed: str) -> str:
        position, velocity = self._taken.get('position'), self._taken.get('velocity')
        if position is None or velocity is None or not (angle or speed):
            return ''
        return evidence.unit_by_rate(self._time, position, velocity, angle, speed)

    def _angle_unit(self, taken: CandidateColumn) -> tuple[str, str]:
        velocity = self._taken.get('velocity')
        choice = self.choice if self.choice and self.choice.velocity == velocity else None
        speed = choice.speed_unit if choice else velocity.unit if velocity else ''
        if taken.quantity == 'position' and (by_rate := self._by_rate('', speed)):
            return by_rate, _BY_RATE
        if _RADIANS < max(taken.listed.high, -taken.listed.low) <= _TURN:
            return 'deg', 'unit by its range'
        if choice is not None and not choice.velocity.unit:
            return choice.speed_unit.removesuffix('/s').replace('rpm', 'rev'), 'as the speed'
        return ('rev', _ODRIVE) if self._in_turns else ('rad', 'unit not stated: check')

    def _at(self, taken: CandidateColumn) -> tuple[str, str]:
        if taken.quantity == 'winding':
            return 'motor', 'a current; with its constant: scale: N*m/A, from_unit: A'
        if (made := evidence.made_of_current(taken, self._own.get('winding', []))) is not None:
            return 'motor', f'it is {abs(made[1]):.4g} × {printable(made[0].address)}'
        name = words(taken.address)
        if re.search(_MEASURED, name) or not (said := re.search(f'{_MOTORS}|{_COMPUTED}', name)):
            known = re.search(f'{_MEASURED}|{_BEHIND}', name)
            return 'joint', '' if known else 'at: joint is a guess'
        return 'motor', f'at: motor, as its name has {said[0].strip("_")}'


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
    said = all('*' in line or not line.strip() for body in plain for line in body)
    same = said and all(body == plain[0] for body in plain)
    return {'DRIVE_*': next(iter(stars.values()))} if same else dict(bodies)


def _supply_lines(whole: ByQuantity) -> list[str]:
    parts, note = list[str](), ''
    pair = whole.get('voltage') and whole.get('current')
    for quantity, own in whole.items():
        if own and quantity != ('power' if pair else 'current'):
            best = min(own, key=lambda c: c.rank)
            unit, sign = best.unit or _GUESSED_UNIT[quantity], ''
            if quantity != 'voltage' and np.nanmean(best.values) < 0:
                sign, note = ', positive: fed', '   # negative in the mean: it counts what is fed'
            elif rivals := [c.address for c in own if c != best and c.rank == best.rank]:
                note = f'   # or {printable(", ".join(rivals))}: a meter of each drive?'
            parts.append(f'{quantity}: {{from: {yaml_text(best.address)}, unit: {unit}{sign}}}')
    return [f'supply: {{{", ".join(parts)}}}{note}'] if pair or whole.get('power') else []
