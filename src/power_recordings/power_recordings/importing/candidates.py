"""Columns of a log as candidates for the quantities of its drives, by name and unit."""

import re
from collections import defaultdict
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from power_recordings.importing.ground import is_along
from power_recordings.importing.listing import Listed
from power_recordings.importing.sources.heads import unit_of
from power_recordings.importing.units import quantities_of
from power_recordings.importing.words import WANTED, words

MECHANICAL: Final = ('position', 'velocity', 'torque', 'winding')
_MOTION: Final = MECHANICAL[:3]  # a current alone may be one of three phases
_MOSTLY_BY_ONE: Final = 0.9  # of the steps of a count of rows
_ROBOT = r'(robot|main|system|battery|batt|total|pack|(^|_)power(?=_[va](_|$)))'
_DC = r'(bus|dc|zk|input|supply|board|(^|_)ina|(^|_)in(?=_(volt|curr|amp)))'
_WATTS = r'(power|watt|pwr)'
_AT = r'(dc|zk|bus|in|sup\w*|batt?)'  # behind a symbol of what a supply gives
_ELECTRONICS = (
    r'(esc|fets?|mos(fets?)?|igbt|driver|inverter|controller|mcu|cpu|pcb|board|module|heatsink)'
)
"""Of a drive, whose temperature is not that of its motor."""
_OTHER = (
    r'scaling|fraction|limits?|mode|errors?|faults?|status|bits?|register|samples?|tool|tcp|force|'
    r'accelerometer|acc|imu|gnss|inertia|computed|momentum|receive|accuracy|hours|levels?|'
    r'ambient|umgebung|room|coolant|tacho|index|count(er)?s?|max|min|serial|pwm|duty|gain|t_ff|'
    r'(sampl\w*|flow|frame|loop|refresh|update)_rate'
)
"""Words of columns that tell nothing of what is wanted."""
# The first expression that fits decides; among columns of one quantity, the earlier is better.
_RULES: Final = (
    (
        'time',
        r'^(t|ms|us|sec|ms_\w+|millis|micros|ticks?|\w*time(_?stamp)?|stamp|seconds|secs?|elapsed\w*)'
        r'(_?(s|ms|us|ns|sec|min))?$',
    ),
    (
        '',
        rf'(^|_)({_OTHER})(_|$)|differ|_per_'
        r'|(^|_)d_?(axis)?_?curr|(^|_)i?d(_axis)?_?(current|volt|measured)|(^|_)[iuv]_?d(_|$)'
        r'|(^|_)(q|phase)_(axis_)?volt|(^|_)[uv]_?q(_|$)'
        rf'|(^|_)(mech|out|shaft)\w*_{_WATTS}|{_WATTS}\w*_(mech|out|shaft|good)'
        r'|(^|_)p_?(m|mech\w*|out|shaft)(_|$)',
    ),
    ('efficiency', r'(total|system|overall|drive)_.*(effic|(^|_)eta(_|$))'),
    ('efficiency', r'effic|(^|_)eta(_|$)'),
    ('loss', r'(total|system|overall|drive)_.*loss'),
    ('loss', r'loss'),
    ('command', rf'{WANTED}.*(pos|angle|(^|_)q(_|$))|(pos|angle|(^|_)[pq](_|$)).*{WANTED}'),
    ('', rf'{WANTED}'),
    ('', rf'(^|_){_ELECTRONICS}(_|$).*(temp|ntc)|(temp|ntc).*(^|_){_ELECTRONICS}(_|$)'),
    ('supply_voltage', r'robot.*volt'),
    ('supply_voltage', rf'{_ROBOT}.*(volt|_v(_|$))'),
    ('supply_current', rf'{_ROBOT}.*(curr|(^|_)amps?(_|$)|_a(_|$))'),
    ('supply_power', rf'{_ROBOT}.*{_WATTS}'),
    ('temperature', r'(^|_)t_\w*(wind(ing|_|$)|mot|wdg|wick|stator|coil)(?!.*_(in|out)$)'),
    (
        'temperature',
        r'(winding|motor).*temp(?!.*(fet|mos|_in$|_out$))'
        r'|(?<!fet_)(^|_)temp.*(winding|motor)|motor_thermistor',
    ),
    ('temperature', r'(^|_)temp|(^|_)t_(housing|case|geh)'),
    ('temperature', r'(^|_)(ntc|ptc|kty)(_|$)|(^|_)(coil|winding|wdg|stator)_c$'),
    (
        'voltage',
        rf'{_DC}.*(volt|_v(_|$))|v_?bus|(^|_)([uv]_?{_AT}|dc_?[uv])(_|$)|volt\w*_(dc|in)(_|$)',
    ),
    (
        'current',
        rf'{_DC}.*(curr|(^|_)amps?(_|$))|i_?bus|(^|_)(i_?{_AT}|dc_?i)(_|$)|curr\w*_(dc|in)(_|$)',
    ),
    (
        'power',
        rf'{_WATTS}.*_(el\w*|dc|in)(_|$)|(el|dc|in)\w*_{_WATTS}'
        rf'|(^|_)p_?(el\w*|{_AT})(_|$)',
    ),
    ('torque', r'(load_?cell|sensor|transducer).*torque|torque.*(load_?cell|sensor|transducer)'),
    ('torque', r'(torque|trq|(^|_)tau|(^|_)tq(_|$)|effort|moment)'),
    (
        'winding',
        r'(q_?(axis_)?current|(^|_)q_axis(_|$)|(^|_)iq|i_?q(_|$)|winding_current|phase_current)',
    ),
    ('winding', r'motor_?current|current_?motor(_|$)|(^|_)i_?mot(or)?(_|$)|(^|_)motor_a$'),
    ('winding', r'(actual|joint|measured|present).*current|current.*(actual|measured|present)'),
    ('winding', r'(^|_)i_?rms(_|$)'),
    ('voltage', r'volt|(^|_)[uv](_|$)'),
    ('current', r'curr|(^|_)amps?(_|$)|(^|_)i(_|$)'),
    ('power', rf'{_WATTS}|(^|_)pow(_|$)'),
    ('velocity', r'(vel|speed|omega|rpm|(^|_)(qd|dq)(_|$)|(^|_)w(_|$))'),
    ('position', r'(pos|angle|theta|(^|_)q(_|$)|^phi(_|$))'),
    ('torque', r'^m(_|$)'),
    ('velocity', r'^n(_[a-z]+)?$|(^|_)rate(_|$)'),
    ('position', r'(^|_)(ang|enc|encoder)(_|$)|^revs?$'),
)
_LETTER_P: Final = r'(?<![A-Za-z])P(?![A-Za-z])'  # a power beside q, dq and tau of its drive
_TIMED: Final = r'_t(_(s|ms|us|ns))?$'  # behind a group's name, of a column that rises
_VAGUE: Final = _RULES.index(('voltage', r'volt|(^|_)[uv](_|$)'))  # from here not whose it is
_BY_UNIT: Final = len(_RULES)  # rank of columns that only their unit speaks for
_OF_UNIT: Final = ('torque', 'velocity', 'power', 'voltage', 'current', 'temperature', 'position')
_OF_NO_SIZE: Final = ('1/s', 's-1', 's^-1', 's⁻¹', '1/sec')  # rad/s to some, rev/s to others
_PLAIN: Final = {'winding': 'current'}
_STILL: Final = ('voltage', 'supply_voltage', 'temperature')  # that may be constant
_SIDES: Final = (
    r'[a-km-qs-z]|motor|joint|link|gear|rotor|shaft|out\w*|in|input|meas\w*|act\w*|est\w*|raw|filt\w*|'
    r'mean|avg|std|rms|var|peak|sim\w*|model|pred\w*|true|old|new|last|prev\w*'
)
"""Words that tell sides of a drive, or kinds of a signal, apart."""
_NO_DRIVE: Final = rf'(?!.$)({_SIDES})|load|brake|dyno|ref\w*|set\w*'  # a letter may be one
_BUT_LAST: Final = slice(0, -1)  # of the words in a name
_BUT_FIRST: Final = slice(1, None)
_SECOND: Final = slice(1, 2)
_NEGATIVE: Final = 0.1  # of the highest, below 0: no offset of a meter
_ONE: Final = 0.999  # correlation of speeds on one shaft
_COMPARED: Final = 24  # columns of a kind, each with each
_BRACKETS = re.compile(r'[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$')
_FEW, _MANY = 0.2, 0.6  # share of rows in which a command changes, and a measurement


@dataclass(frozen=True)
class CandidateColumn:
    """A column of a log that may hold a quantity of a drive.

    drive: the part of its name that tells drives apart, '' if none.
    """

    quantity: str
    rank: int  # of the rule that says so; the lower, the better
    drive: str
    listed: Listed
    held: bool = False  # over many rows, as a command is

    @property
    def address(self) -> str:
        """The column's name in the log; in bags `topic:field`."""
        return self.listed.column.address

    @property
    def unit(self) -> str:
        """The unit that the log states, '' if none."""
        return self.listed.column.unit or unit_of(self.address)

    @property
    def values(self) -> Floats:
        """The column's first rows, [N], in the log's unit."""
        return self.listed.values

    @property
    def is_vague(self) -> bool:
        """True if the name does not say whose current or voltage it is."""
        return self.rank >= _VAGUE

    @property
    def why(self) -> str:
        """Reason for the quantity, for a comment in a map: by name or by unit, then `doubt`."""
        return ('by its unit' if self.rank >= _BY_UNIT else 'by its name') + self.doubt

    @property
    def doubt(self) -> str:
        """Reason against the quantity, in brackets after a space; '' if none."""
        changes = f'{self.listed.changes:.0%}'
        return f' (changes in {changes} of the rows: a command?)' if self.held else ''


def candidates(listed: Sequence[Listed]) -> list[CandidateColumn]:
    """Return the columns that vary and may hold a quantity, each with its drive."""
    names = {item.column.address for item in listed}
    found = [c for item in listed if (c := _candidate(item, names)) is not None]
    angles = [c for c in found if is_mere_angle(c)]
    rest = [_held(c, found) for c in found if not is_mere_angle(c)]
    found = _by_word(_by_number(rest), angles)
    drives = {c.drive for c in found} - {''}
    found, angles = ([_named(c, drives) for c in part] for part in (found, angles))
    found = [c for c in found if not _of_phase(c, names)]
    placed = [c.drive for c in (*found, *angles) if c.quantity == 'position']
    angles = [c for c in angles if bool(c.drive) == bool(drives) and placed.count(c.drive) == 1]
    return [*found, *angles]


def _of_phase(candidate: CandidateColumn, names: Set[str]) -> bool:
    """Tell whether names of no drive go on from A to C, as those of three phases do."""
    start, end = candidate.address[:-1], candidate.address[-1]
    phases = 'ABC' if end.isupper() else 'abc'
    electric = not candidate.drive and candidate.quantity in ('voltage', 'current', 'temperature')
    return electric and end in phases and {f'{start}{phase}' for phase in phases} <= names


def _named(candidate: CandidateColumn, drives: Set[str]) -> CandidateColumn:
    """Give a column without a drive to the only one that its name tells."""
    key = drive_key(candidate.address)
    said = {word.upper() for word in words(_stem(candidate.address)).split('_')}
    own = drives & (said | {key, f'DRIVE_{key}'} - {''})
    alone = len(own) == 1 and not candidate.drive
    return replace(candidate, drive=min(own)) if alone else candidate


def is_mere_angle(candidate: CandidateColumn) -> bool:
    """Return whether only its unit makes a column a position."""
    return candidate.quantity == 'position' and candidate.rank >= _BY_UNIT


def by_ones(steps: Floats) -> bool:
    """Return whether nearly all steps [N - 1] are 1, as of a count of rows, some of them lost."""
    return bool(np.mean(steps == 1.0) > _MOSTLY_BY_ONE) if len(steps) else False


def _candidate(item: Listed, names: Set[str]) -> CandidateColumn | None:
    column = item.column
    still = item.low == item.high or (item.rows > 1 and not item.changes > 0)
    if still and not (np.isfinite(item.low) and item.low != 0):
        return None
    unit = column.unit or unit_of(column.address)
    apart = '/' in column.address + unit or 'power' in quantities_of(unit)  # p_mW is no p_m
    name = words(_stem(column.address) if apart else column.address)
    beside = {re.sub(_LETTER_P, symbol, column.address) for symbol in ('q', 'dq', 'tau', 'M')}
    if column.address not in beside and len(beside & names) > 2:
        name = 'power'
    of_state = column.address.removesuffix('eff')
    if of_state != column.address and {f'{of_state}pos', f'{of_state}vel'} <= names:
        name = 'effort'  # as joint states have it
    bracket = _BRACKETS.search(column.address)
    said = bracket[1] if bracket else ''
    fits = ('velocity',) if said in _OF_NO_SIZE else quantities_of(unit) if unit else ()
    foreign = bool(said) and not fits and ':' not in column.address and not said.isdigit()
    known = item.values[np.isfinite(item.values)]
    rises = len(known) > 1 and bool((np.diff(known) > 0).all())
    if rises and re.search(_TIMED, name) and (not unit or 'time' in fits):
        return CandidateColumn('time', 0, '', item)
    by_name = (
        (i, q)
        for i, (q, rule) in enumerate(_RULES)
        if re.search(rule, name) and (not q or not fits or plain(q) in fits) and not foreign
    )
    letter = not bracket and unit in ('C', 'F', 'K')  # which end the names of phases, too
    by_unit = (_BY_UNIT, '' if letter else next((q for q in _OF_UNIT if q in fits), ''))
    rank, quantity = next(by_name, by_unit)
    if not quantity or (still and quantity not in _STILL):
        return None
    if quantity in ('velocity', 'position') and is_along(column.address):
        return None
    if quantity == 'velocity' and not unit and by_ones(np.diff(item.values)):
        return None  # it counts the rows
    u = quantity == 'voltage' and not unit and name.startswith('u')
    if u and -item.low > _NEGATIVE * item.high:
        return None  # of a control law, as no supply turns round
    return CandidateColumn(quantity, rank, '', item)


def _stem(address: str) -> str:
    """Return a column's name without the unit in words at its end."""
    unit = '[_ ](?:per[_ ])?'.join(map(re.escape, re.split(r'[/*]', unit_of(address))))
    return re.sub(rf'([_ ]|\s*/\s*){unit}$', '', address) if unit else address


def plain(quantity: str) -> str:
    """Return the quantity that a unit says: the voltage of a supply is a voltage."""
    return _PLAIN.get(quantity, quantity.removeprefix('supply_'))


def _held(candidate: CandidateColumn, others: Sequence[CandidateColumn]) -> CandidateColumn:
    """Put a torque that is held over many rows behind others: a command."""
    busy = any(other.quantity == 'torque' and other.listed.changes > _MANY for other in others)
    if candidate.quantity != 'torque' or not busy or candidate.listed.changes > _FEW:
        return candidate
    return replace(candidate, held=True)


def drive_key(address: str) -> str:
    """Return the part of an address that tells drives apart: last number or name in brackets."""
    in_brackets = re.search(r'\[([^\[\]]+)\](?!.*\[[^\[\]]+\])', address)
    if in_brackets and ':' in address:
        return in_brackets[1]
    plain = re.sub(r'\s*[\[(][^\[\]()]*[\])]$', '', address)
    numbers = re.findall(r'\d+', plain)
    return numbers[-1] if numbers else ''


def _by_number(found: Sequence[CandidateColumn]) -> list[CandidateColumn]:
    """Name drives by numbers that motion and another quantity, or a row of columns, share."""
    kinds: dict[str, set[str]] = defaultdict(set)
    alike: dict[tuple[str, str], set[str]] = defaultdict(set)
    for c in found:
        if key := drive_key(c.address):
            kinds[key].add(c.quantity)
            if c.quantity in _MOTION:
                alike[c.quantity, c.address.replace(key, '*')].add(key)
    rows = {key for keys in alike.values() if len(keys) > 1 for key in keys}
    drives = {
        key: f'DRIVE_{key}' if key.isdigit() else key
        for key, own in kinds.items()
        if (len(own) > 1 or key in rows) and own & set(_MOTION)
    }
    if len(drives) < 2 and all(key.isdigit() for key in drives):
        return list(found)
    return [replace(c, drive=drives.get(drive_key(c.address), '')) for c in found]


def _by_word(
    found: Sequence[CandidateColumn], angles: Sequence[CandidateColumn]
) -> list[CandidateColumn]:
    """Name drives by words that columns of several quantities share.

    By the first or the last: either of motion and of power, or two of motion that are there of
    another word, too, and go their own way; a letter also of a torque. By all words but the last
    or the first, or by the second, as in `fl_hip_dq` and `hip_l_rate`, `bus_l_u`: of motion and of
    power. angles: further columns that tell of it. Beside drives with numbers, those with a torque
    and a power of their own: J1, J2 and Z.
    """
    if any(c.drive for c in found):
        return _beside_numbers(found)
    names = {c.address: words(_stem(c.address)).split('_') for c in (*found, *angles)}
    while len({name[0] for name in names.values()}) == 1 and all(
        len(n) > 1 for n in names.values()
    ):
        names = {address: name[1:] for address, name in names.items()}  # a group that holds all
    for place in (_BUT_LAST, _BUT_FIRST, slice(0, 1), slice(-1, None), _SECOND):
        inner = place in (_BUT_LAST, _BUT_FIRST, _SECOND)
        own_of = {
            address: '' if place == _SECOND and len(name) < 3 else '_'.join(name[place])
            for address, name in names.items()
        }
        kinds: dict[str, set[str]] = defaultdict(set)
        rows: dict[tuple[str, ...], list[CandidateColumn]] = defaultdict(list)
        for c in (*found, *angles):
            rest = [*names[c.address]]
            del rest[place]
            kinds[own_of[c.address]].add(c.quantity)
            rows[c.quantity, *rest].append(c)
        several: dict[str, set[str]] = defaultdict(set)
        for (quantity, *_), row in rows.items():
            if quantity in _MOTION and len(row) > 1 and not inner and not _coupled(row):
                for c in row:
                    several[own_of[c.address]].add(quantity)
        drives = {
            word
            for word, own in kinds.items()
            if ({'velocity', 'position'} & own and {'current', 'power'} & own and len(own) > 2)
            or (len(several[word]) > 1 and not re.fullmatch(_SIDES, word))
            or ('torque' in several[word] and re.fullmatch('[abcxyz]', word))
        } - {''}
        if inner:
            drives = {w for w in drives if not re.fullmatch(_NO_DRIVE, w.split('_')[-1])}
        firsts = {word.split('_')[0] for word in drives}
        if len(drives) > (len(firsts) if inner and place != _SECOND else 1):
            names_of = {word: word.upper() for word in drives}
            return [replace(c, drive=names_of.get(own_of[c.address], '')) for c in found]
    return list(found)


def _beside_numbers(found: Sequence[CandidateColumn]) -> list[CandidateColumn]:
    """Name drives without a number by the first word of a speed, a torque and a meter."""
    kinds: dict[str, set[str]] = defaultdict(set)
    firsts = [words(_stem(c.address)).split('_')[0] for c in found]
    for first, c in zip(firsts, found, strict=True):
        if not c.drive:
            kinds[first].add(c.quantity)
    drives = {
        first
        for first, own in kinds.items()
        if own >= {'velocity', 'torque'} and own & {'power', 'current'}
        if not re.fullmatch(_NO_DRIVE, first)
    }
    return [
        replace(c, drive=first.upper()) if first in drives and not c.drive else c
        for first, c in zip(firsts, found, strict=True)
    ]


def _coupled(row: Sequence[CandidateColumn]) -> bool:
    """Tell whether columns go as one shaft does, whose two ends or sides of a gear they are."""
    pairs = combinations([c.values for c in row[:_COMPARED]], 2)
    return any(abs(correlation(x, y) or 0.0) > _ONE for x, y in pairs)


def correlation(x: Floats, y: Floats, fewest: int = 1) -> float | None:
    """Return the correlation of two columns [N] over rows where both are numbers.

    None for columns of other lengths, fewer than `fewest` such rows, or one that is still.
    """
    good = np.isfinite(x) & np.isfinite(y) if len(x) == len(y) else np.zeros(0, np.bool_)
    if good.sum() < fewest or not min(np.ptp(x[good]), np.ptp(y[good])) > 0:
        return None
    return float(np.corrcoef(x[good], y[good])[0, 1])
