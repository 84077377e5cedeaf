"""Choice among columns that compete for a quantity, by the power that they make."""

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Literal

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, printable

from power_recordings.importing.candidates import (
    CandidateColumn,
    correlation,
    is_mere_angle,
    plain,
)
from power_recordings.importing.units import conversion
from power_recordings.importing.words import words
from power_recordings.quality.physics import solve, velocity_slope

# Of a speed that states no unit: the most W of power for a W of torque × speed. What is less than
# 0.45 W in rad/s is 4.3 W in rpm: the losses of a drive that mostly holds; and of one that drives
# all the time, less than 0.9 W is 8.6 W.
_SPEEDS: Final = {'rad/s': 2.5, 'rpm': 4.3, 'rev/s': 2.5}
_DRIVES: Final = 0.95  # share of rows with torque × speed above 0,
_SHOWN: Final = 0.05  # of those with so much of the largest
_SURE: Final = 0.9  # R² at which a sign is turned round
_MOST: Final = 8  # candidates of a quantity
_LEAST: Final = 0.45  # W of power for a W of torque × speed: a brake gives back that much
_LEAST_DRIVING: Final = 0.9
_UNIT_STATED: Final = 10.0  # W, at most
_RANK: Final = 0.02  # R² that makes up for a place in the list
_MECHANICAL: Final = 0.9998  # R² of a power that is torque × speed itself
_SAME: Final = 0.999  # R² of a torque that is a current times a constant
_FEWEST: Final = 30  # rows
_ANGLES: Final = ('rad', 'deg', 'rev', 'arcsec')
_ALIKE: Final = 1.1  # times a velocity may be off the rate of its position
_FOLLOWS: Final = 0.9  # their correlation
_GAINED: Final = 0.1  # of the power (rms), that a shaft gives beyond it: no offset of a meter
_MOVED: Final = 0.2  # share of the power's variance


Turned = Literal['torque', 'power', 'both', '']
ByQuantity = Mapping[str, list[CandidateColumn]]
Meter = tuple[CandidateColumn, ...]  # voltage and current, or power: what makes it by product


@dataclass(frozen=True)
class Choice:
    """The torque, speed and power columns that fit together best.

    slope: W of power for a W of torque × speed, as large. turned: the one whose sign is to be
    inverted, '' if none. why: the reason, for the map.
    """

    torque: CandidateColumn
    velocity: CandidateColumn
    speed_unit: str
    meter: Meter
    slope: float
    turned: Turned
    why: str
    score: float  # R², less for each place in the lists

    def with_unit_of(self, best: 'Choice | None') -> 'Choice':
        """Return the choice with the unit of another drive's speed of a like name.

        Losses make a slope large, and never as small as that of a unit which is too small.
        """
        if best is None or self.velocity.unit or self.speed_unit == best.speed_unit:
            return self
        own, other = (words(one.velocity.address).split('_')[-1] for one in (self, best))
        sizes = [conversion(one.speed_unit, 'velocity').factor for one in (self, best)]
        if own != other or self.slope * sizes[0] / sizes[1] < _LEAST:
            return self
        why = f'as {printable(best.velocity.address)}, where {best.why}'
        return replace(self, speed_unit=best.speed_unit, why=why)


def best_told(chosen: Sequence[Choice]) -> Choice | None:
    """Return the best choice of several drives' that has the unit of most of them, or None."""

    def told(choice: Choice) -> tuple[float, float]:
        alike = [one.score for one in chosen if one.speed_unit == choice.speed_unit]
        return sum(alike), choice.score

    return max(chosen, key=told, default=None)


def si(candidate: CandidateColumn, unit: str = '') -> Floats:
    """Return a candidate's first rows [N] in SI; as they are if the unit does not fit.

    unit: the unit to convert from, in place of the log's.
    """
    try:
        return conversion(unit or candidate.unit, plain(candidate.quantity))(candidate.values)
    except InputError:
        return candidate.values


def choose(found: ByQuantity) -> Choice | None:
    """Return torque, speed and power that fit together best, of a drive's candidates, or None."""
    torques, speeds = (found.get(q, [])[:_MOST] for q in ('torque', 'velocity'))
    torques = [t for t in torques if not t.held] or torques
    best: Choice | None = None
    for (i, torque), (j, speed), (k, meter) in product(
        enumerate(torques), enumerate(speeds), enumerate(_meters(found))
    ):
        lengths = {len(torque.values), len(speed.values), *(len(p.values) for p in meter)}
        if len(lengths) > 1:
            continue
        for n, unit in enumerate((speed.unit,) if speed.unit else _SPEEDS):
            fit = _fit(_power(meter), si(torque), si(speed, unit))
            if fit is None or not _likely(fit, unit, stated=bool(speed.unit)):
                continue
            score = fit.r2 - _RANK * (i + j + k + n + 2 * bool(fit.turned))
            if best is None or score > best.score:
                slope = abs(fit.slope)
                why = f'torque × speed explains the power, {slope:.2f} W of it for each W'
                best = Choice(torque, speed, unit, meter, slope, fit.turned, why, score)
    return best


def _power(meter: Meter) -> Floats:
    """Power of the first rows, W [N]."""
    return np.prod([si(part) for part in meter], axis=0)  # type: ignore[no-any-return]


def _meters(found: ByQuantity) -> list[Meter]:
    """Pairs of voltage and current of one name, and powers; those that are in both once."""
    volts, amps = found.get('voltage', []), found.get('current', [])
    pairs = [(v, i) for i in amps[:_MOST] if (v := companion(i, volts)) is not None]
    return [*pairs, *((p,) for p in found.get('power', [])[:_MOST])]


def companion(
    current: CandidateColumn, volts: Sequence[CandidateColumn]
) -> CandidateColumn | None:
    """Return the voltage whose name is most like that of a current; None without voltages."""
    return min(volts, key=lambda v: (-_likeness(v.address, current.address), v.rank), default=None)


def metered_pair(power: CandidateColumn, found: ByQuantity) -> Meter | None:
    """Return the voltage and current whose product is a power, within 2 %; None if none."""
    p = si(power)
    for current in found.get('current', []):
        volts = companion(current, found.get('voltage', []))
        if volts is None or not len(p) == len(current.values) == len(volts.values):
            continue
        watts = _power((volts, current))
        good = np.isfinite(p + watts)
        if good.sum() > _FEWEST and np.allclose(watts[good], p[good], rtol=0.02, atol=0.02):
            return volts, current
    return None


def _likeness(a: str, b: str) -> float:
    """How alike two names are, units in brackets apart; 1 of equal ones."""
    plain = [re.sub(r'\s*[\[(][^\[\]()]*[\])]$', '', name) for name in (a, b)]
    return round(difflib.SequenceMatcher(None, plain[0], plain[1], autojunk=False).ratio(), 2)


@dataclass(frozen=True)
class _Fit:
    """Slope of P = a·τω + d, R² of P = a·τω + b·τ² + c·|ω| + d, and whose sign is wrong."""

    slope: float
    r2: float
    turned: Turned
    drives: bool  # all the time


def _likely(fit: _Fit, unit: str, stated: bool) -> bool:
    slope = abs(fit.slope)
    if stated:
        return _LEAST < slope < _UNIT_STATED
    more = _LEAST_DRIVING / _LEAST if fit.drives else 1.0
    return _LEAST * more < slope < _SPEEDS[unit] * (more if unit == 'rpm' else 1.0)


def _fit(power: Floats, torque: Floats, speed: Floats) -> _Fit | None:
    """Fit the power of a drive.

    None for τω itself, too few rows, or a power that torque × speed hardly moves. Where the power
    falls as τω rises, the sign of the power is wrong if losses would be fed by it, else that of
    the torque. Where it rises, and all losses would be fed, too, both are.
    """
    good = np.isfinite(power) & np.isfinite(torque) & np.isfinite(speed)
    p, t, w = power[good], torque[good], speed[good]
    spread = float(np.var(p)) if len(p) else 0.0
    shaft = t * w
    if len(p) < _FEWEST or not spread > 0 or not np.var(shaft) > 0:
        return None
    alone = float(shaft @ p / (shaft @ shaft))
    if 1 - float(np.mean(np.square(p - alone * shaft))) / spread > _MECHANICAL:
        return None
    slope = float(np.cov(shaft, p)[0, 1] / np.var(shaft, ddof=1))
    if not slope**2 * float(np.var(shaft)) > _MOVED * spread:
        return None
    found, _, rest = solve(np.stack([shaft, t**2, np.abs(w), np.ones_like(p)], axis=1), p)
    r2 = 1 - float(np.var(rest)) / spread
    losses = float(np.mean(p - shaft * found[0]))
    turned: Turned = '' if slope > 0 else ('torque' if losses > 0 else 'power')
    if turned and (r2 < _SURE or not found[0] < 0):
        return None
    gained = float(np.mean(shaft - p)) > _GAINED * float(np.sqrt(np.mean(p**2)))
    fed = max(losses, found[1], found[3]) < 0
    if not turned and gained and fed and r2 > _SURE and found[0] > 0:
        turned = 'both'
    way = -1 if turned in ('torque', 'both') else 1
    ahead = shaft[np.abs(shaft) > _SHOWN * np.abs(shaft).max()] * way
    return _Fit(slope, r2, turned, float(np.mean(ahead > 0)) > _DRIVES)


def velocity_apart_from_voltage(own: ByQuantity) -> ByQuantity:
    """Take a column called v for a velocity where a voltage has another name."""
    volts = own.get('voltage', [])
    v = next((c for c in volts if words(c.address) == 'v' and not c.unit), None)
    if v is None or len(volts) < 2 or 'velocity' in own:
        return own
    return {
        **own,
        'voltage': [c for c in volts if c != v],
        'velocity': [replace(v, quantity='velocity')],
    }


def follows(position: CandidateColumn, velocity: CandidateColumn) -> bool:
    """Tell whether a position that lacks a unit or a name moves as the velocity says."""
    told = position.unit and not is_mere_angle(position)
    if told or len(position.values) != len(velocity.values):
        return True
    steps, middle = np.diff(position.values), velocity.values[1:]
    good = np.isfinite(steps) & np.isfinite(middle)
    good &= np.abs(steps) <= np.percentile(np.abs(steps[good]), 99) if good.any() else good
    found = correlation(steps[good], middle[good], 20)
    return found is None or abs(found) > 0.5


def unit_by_rate(
    time: Floats, position: CandidateColumn, velocity: CandidateColumn, angle: str, speed: str
) -> str:
    """Return the unit that makes a velocity the rate of a position, '' if none does.

    time: s [N]. angle, speed: unit of the position and of the velocity; '' for the one wanted.
    """
    if not len(time) == len(position.values) == len(velocity.values):
        return ''
    found = velocity_slope(time, position.values, velocity.values)
    if found is None or found.correlation < _FOLLOWS:
        return ''
    speeds = (speed,) if speed else ('rad/s', 'deg/s', 'rpm', 'rev/s', 'arcsec/s')
    for one, other in product((angle,) if angle else _ANGLES, speeds):
        ratio = conversion(other, 'velocity').factor / conversion(one, 'position').factor
        if 1 / _ALIKE < found.slope * ratio < _ALIKE:
            return other if angle else one
    return ''


def made_of_current(
    torque: CandidateColumn, currents: Sequence[CandidateColumn]
) -> tuple[CandidateColumn, float] | None:
    """Return the current that is proportional to a torque, and its factor in N·m/A, or None."""
    for current in currents:
        x, y = current.values, torque.values
        if (correlation(x, y, _FEWEST) or 0.0) ** 2 > _SAME:
            good = np.isfinite(x) & np.isfinite(y)
            return current, float(np.polyfit(x[good], y[good], 1)[0])
    return None
