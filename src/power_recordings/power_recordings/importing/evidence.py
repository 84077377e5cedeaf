"""Choice among columns that compete for a quantity, by the power that they make."""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_recordings.importing.candidates import CandidateColumn
from power_recordings.importing.units import conversion

# Of a speed that states no unit: the most W of power for a W of torque × speed. What is less than
# 0.45 W in rad/s is 4.3 W in rpm: the losses of a drive that mostly holds.
_SPEEDS: Final = {'rad/s': 2.5, 'rpm': 4.3, 'rev/s': 2.5}
_MOST: Final = 8  # candidates of a quantity
_LEAST: Final = 0.45  # W of power for a W of torque × speed: a brake gives back that much
_UNIT_STATED: Final = 10.0  # W, at most
_RANK: Final = 0.02  # R² that makes up for a place in the list
_MECHANICAL: Final = 0.9998  # R² of a power that is torque × speed itself
_SAME: Final = 0.999  # R² of a torque that is a current times a constant
_FEWEST: Final = 30  # rows
_MOVED: Final = 0.2  # share of the power's variance


@dataclass(frozen=True)
class MeterColumns:
    """The columns of a power: voltage and current, or the power itself."""

    parts: tuple[CandidateColumn, ...]

    @property
    def power(self) -> Floats:
        """W [N]."""
        return np.prod([si(part) for part in self.parts], axis=0)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Choice:
    """The columns that fit together, the unit of the speed, and why."""

    torque: CandidateColumn
    velocity: CandidateColumn
    speed_unit: str
    meter: MeterColumns
    why: str


def si(candidate: CandidateColumn, unit: str = '') -> Floats:
    """Return a candidate's first rows in the unit of its quantity."""
    quantity = {'winding': 'current'}.get(candidate.quantity, candidate.quantity)
    try:
        return conversion(unit or candidate.unit, quantity)(candidate.values)
    except InputError:
        return candidate.values


def choose(found: dict[str, list[CandidateColumn]]) -> Choice | None:
    """Return the torque, speed and power that fit together best; None where none do."""
    torques, speeds = (found.get(q, [])[:_MOST] for q in ('torque', 'velocity'))
    torques = [t for t in torques if not t.held] or torques
    best, most = None, 0.0
    for (i, torque), (j, speed), (k, meter) in product(
        enumerate(torques), enumerate(speeds), enumerate(_meters(found))
    ):
        lengths = {len(torque.values), len(speed.values), *(len(p.values) for p in meter.parts)}
        if len(lengths) > 1:
            continue
        for n, unit in enumerate((speed.unit,) if speed.unit else _SPEEDS):
            fit = _fit(meter.power, si(torque), si(speed, unit))
            most_lost = _UNIT_STATED if speed.unit else _SPEEDS[unit]
            if fit is None or not _LEAST < fit[0] < most_lost:
                continue
            score = 1 + fit[1] - _RANK * (i + j + k + n)
            if score > most:
                why = f'torque × speed explains the power, {fit[0]:.2f} W of it for each W'
                best, most = Choice(torque, speed, unit, meter, why), score
    return best


def _meters(found: dict[str, list[CandidateColumn]]) -> list[MeterColumns]:
    """Pairs of voltage and current of one name, and powers; those that are in both once."""
    volts, amps = found.get('voltage', []), found.get('current', [])
    pairs = [MeterColumns((v, i)) for i in amps[:_MOST] if (v := companion(i, volts)) is not None]
    powers = found.get('power', [])[:_MOST]
    return [*pairs, *(MeterColumns((p,)) for p in powers)]


def companion(
    current: CandidateColumn, volts: Sequence[CandidateColumn]
) -> CandidateColumn | None:
    """Return the voltage whose name is most like that of a current; the best ranked of equals."""
    return min(volts, key=lambda v: (-_likeness(v.address, current.address), v.rank), default=None)


def metered_pair(
    power: CandidateColumn, found: dict[str, list[CandidateColumn]]
) -> MeterColumns | None:
    """Return the voltage and current whose product a column of power is."""
    p = si(power)
    for current in found.get('current', []):
        volts = companion(current, found.get('voltage', []))
        if volts is None or not len(p) == len(current.values) == len(volts.values):
            continue
        meter = MeterColumns((volts, current))
        good = np.isfinite(p + meter.power)
        if good.sum() > _FEWEST and np.allclose(meter.power[good], p[good], rtol=0.02, atol=0.02):
            return meter
    return None


def _likeness(a: str, b: str) -> float:
    """How alike two names are, units in brackets apart; 1 of equal ones."""
    plain = [re.sub(r'\s*[\[(][^\[\]()]*[\])]$', '', name) for name in (a, b)]
    return round(difflib.SequenceMatcher(None, plain[0], plain[1], autojunk=False).ratio(), 2)


def _fit(power: Floats, torque: Floats, speed: Floats) -> tuple[float, float] | None:
    """
    Slope of P = a·τω + d, and the R² of P = a·τω + b·τ² + c·|ω| + d.

    None for τω itself, too few rows, or a power that torque × speed hardly moves.
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
    design = np.stack([shaft, np.square(t), np.abs(w), np.ones_like(p)], axis=1)
    scale = np.maximum(np.abs(design).max(axis=0), 1e-12)
    found, *_ = np.linalg.lstsq(design / scale, p, rcond=1e-10)
    r2 = 1 - float(np.var(p - design / scale @ found)) / spread
    return (slope, r2) if slope**2 * float(np.var(shaft)) > _MOVED * spread else None


def made_of_current(
    torque: CandidateColumn, currents: Sequence[CandidateColumn]
) -> tuple[CandidateColumn, float] | None:
    """Return the current that a torque was computed from, and N·m/A."""
    for current in currents:
        x, y = current.values, torque.values
        if len(x) != len(y):
            continue
        good = np.isfinite(x) & np.isfinite(y)
        if good.sum() < _FEWEST or not np.var(x[good]) > 0 or not np.var(y[good]) > 0:
            continue
        if np.corrcoef(x[good], y[good])[0, 1] ** 2 > _SAME:
            return current, float(np.polyfit(x[good], y[good], 1)[0])
    return None
