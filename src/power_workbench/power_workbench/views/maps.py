"""Error over the state of a drive: maps, chosen moments, spikes, and stretches far worse."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_lab.compare.regimes import UNITS, bins, digits
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_workbench.views.view import PowerView

_CELLS = 8, 26  # of a map along one quantity
_FILL = 8  # rows in a cell, were they spread evenly
_LEAST, _SHARE = 3, 2000  # rows in a cell that is shown, and the least of so many
_SHOWN = 1500  # points on a map
_TAIL = 0.002  # of the values, beyond the map's edges
STRIDE = 'stride_phase'
"""Quantity of all drives: the phase of the stride, 0 to 1."""
UNITS_OF = {**UNITS, 'velocity': 'rad/s', 'torque_rate': 'N·m/s'}
_MODULI = {'torque': 'torque', 'speed': 'velocity'}
"""Quantities of a regime whose magnitude counts, by the state that they are of."""


@dataclass(frozen=True)
class Chosen:
    """Rows of one drive that a range chooses; content: errors inside and outside, for the page."""

    rows: Bools  # [N]
    content: Mapping[str, Any]


def state_column(view: PowerView, drive: str) -> int:
    """Return the column of a drive in the state; InputError, with the known names, for another."""
    if drive not in view.drives:
        raise InputError(f'no drive {drive!r}; there are {", ".join(view.drives)}')
    return view.drives.index(drive)


def values_of(view: PowerView, name: str, drive: str) -> Singles:
    """Return a quantity of a drive's state [N]; InputError for a quantity that is not there."""
    if name == STRIDE and view.stride.phase is not None:
        state_column(view, drive)
        return view.stride.phase
    if name not in view.state:
        raise InputError(f'no quantity {name!r}; there are {", ".join(view.state)}')
    values: Singles = view.state[name][:, state_column(view, drive)]
    return values


def error_of(view: PowerView, drive: str) -> Singles:
    """Return a drive's error (estimate − measured) W [N], or the robot's; NaN without a model."""
    column = state_column(view, drive)
    if view.residual is None:
        return np.full(len(view.slots), np.nan, np.float32)
    return -view.residual[:, column if len(view.meters) > 1 or len(view.drives) == 1 else 0]


def error_map(view: PowerView, drive: str, x: str, y: str) -> dict[str, Any]:
    """Return the error of a drive over the quantities x and y, and over x alone.

    Cells with fewer than three rows, or under 1/2000 of all, are empty. Keys are middles `x` and
    `y`; as [y][x] `mean` and `rms` of the error in W and `seconds`; `limits` of the colours in W,
    for 97 % of the time. `curve` has middle, mean, rms and seconds of ranges of x.
    """
    across, up, error = values_of(view, x, drive), values_of(view, y, drive), error_of(view, drive)
    good = np.isfinite(across) & np.isfinite(up) & np.isfinite(error)
    least = max(_LEAST, int(good.sum()) // _SHARE)
    if good.sum() < least:
        return {'x': [], 'y': [], 'mean': [], 'rms': [], 'seconds': [], 'curve': [], 'limits': {}}
    across, up, error = across[good], up[good], error[good]
    count = int(np.clip(np.sqrt(len(error) / _FILL), *_CELLS))
    x_edges, y_edges = _edges(across, count), _edges(up, count)
    rows, sums, squares = (
        np.histogram2d(up, across, bins=[y_edges, x_edges], weights=weights)[0]
        for weights in (None, error, np.square(error))
    )
    with np.errstate(invalid='ignore', divide='ignore'):
        mean = np.where(rows >= least, sums / rows, np.nan)
        root = np.where(rows >= least, np.sqrt(squares / rows), np.nan)
    curve = bins(across.astype(np.float64), -error.astype(np.float64))
    return {
        'x': rounded(0.5 * (x_edges[1:] + x_edges[:-1])),
        'y': rounded(0.5 * (y_edges[1:] + y_edges[:-1])),
        'mean': [rounded(row) for row in mean],
        'rms': [rounded(row) for row in root],
        'seconds': [rounded(row) for row in rows / REDUCED_RATE],
        'limits': {'mean': _limit(np.abs(mean), rows), 'rms': _limit(root, rows)},
        'curve': [
            rounded([0.5 * (b.low + b.high), b.mean, b.rmse, b.count / REDUCED_RATE])
            for b in curve
        ],
        'x_unit': UNITS_OF.get(x, ''),
        'y_unit': UNITS_OF.get(y, ''),
    }


def in_box(view: PowerView, drive: str, bounds: Mapping[str, tuple[float, float]]) -> Chosen:
    """Choose the rows whose state lies within bounds {quantity: (low, high)}."""
    rows = np.ones(len(view.slots), bool)
    for name, limits in bounds.items():
        rows &= _within(values_of(view, name, drive), limits)
    words = (
        f'{name.replace("_", " ")} {digits(min(limits))} to {digits(max(limits))} '
        f'{UNITS_OF.get(name, "")}'.rstrip()
        for name, limits in bounds.items()
    )
    return _chosen(view, drive, rows, ', '.join(words))


def in_regime(view: PowerView, regime: Mapping[str, Any]) -> Chosen:
    """Choose the rows of a regime: drive, conditions and bounds as `compare --json` has them."""
    drive = str(regime['drive'])
    conditions = list(regime['conditions'])
    rows = np.ones(len(view.slots), bool)
    torque, speed = (values_of(view, name, drive) for name in ('torque', 'velocity'))
    for name, limits in regime['bounds'].items():
        values = values_of(view, _MODULI.get(name, name), drive)
        if name not in _MODULI:
            rows &= _within(values, limits)
            continue
        (low, high), unit = sorted(limits), UNITS[name]
        is_open = any(c.startswith('above') and c.endswith(unit) for c in conditions)
        rows &= (np.abs(values) >= low) & (is_open | (np.abs(values) < high))
    if 'at rest' in conditions:
        rows &= np.abs(speed) < view.still[state_column(view, drive)]
    elif 'driving' in conditions:
        rows &= torque * speed > 0
    elif 'braking' in conditions:
        rows &= torque * speed <= 0
    for words in view.words.values():
        for condition in conditions:
            said = words.rows(condition.removeprefix('controller '), state_column(view, drive))
            if said.any():
                rows &= said
    return _chosen(view, drive, rows, ', '.join(conditions))


def in_span(view: PowerView, drive: str, start: float, stop: float) -> Chosen:
    """Choose the rows from start to stop, in seconds as they are shown."""
    rows = _within(view.slots / REDUCED_RATE, (start, stop))
    return _chosen(view, drive, rows, f'{min(start, stop):.1f} to {max(start, stop):.1f} s')


def _within(values: NDArray[Any], limits: Sequence[float]) -> Bools:
    return np.asarray((values >= min(limits)) & (values <= max(limits)))


def scatter_points(view: PowerView, drive: str, rows: Bools, x: str, y: str) -> dict[str, Singles]:
    """Return quantities x and y of the marked rows [N], evenly thinned out to 1500 at most."""
    found = np.flatnonzero(rows)
    found = found[:: max(1, -(-len(found) // _SHOWN))]
    return {
        'points_x': values_of(view, x, drive)[found],
        'points_y': values_of(view, y, drive)[found],
    }


def _chosen(view: PowerView, drive: str, rows: Bools, words: str) -> Chosen:
    error = error_of(view, drive)
    known = np.isfinite(error)
    inside, outside = error[rows & known], error[~rows & known]
    seconds = float(rows.sum() / REDUCED_RATE)
    content: dict[str, Any] = {'drive': drive, 'seconds': round(seconds, 2), 'where': words}
    where = f'{drive}, {words}' if words else drive
    if not inside.size:
        why = 'nothing that was judged lies there'
        if view.residual is None:
            why = f'{seconds:.1f} s, without a model to compare'
        content['sentence'] = f'{where}: {why}.'
        return Chosen(rows, content)
    mean, within = float(inside.mean()), rms(inside)
    side = 'too low' if mean < 0 else 'too high'
    content |= {'bias_w': round(mean, 5), 'rmse_w': round(within, 5)}
    sentence = f'{where}: the model is {digits(abs(mean))} W {side} on average, '
    sentence += f'{digits(within)} W rms'
    if outside.size:
        content['rmse_outside_w'] = round(rms(outside), 5)
        sentence += f' inside against {digits(rms(outside))} W outside'
    held, whole = (float(np.square(e, dtype=np.float64).sum()) for e in (inside, error[known]))
    share = held / max(whole, 1e-12)
    content['share'] = round(share, 4)
    sentence += f'. These {seconds:.1f} s hold {share:.0%} of the squared error of {drive}.'
    content['sentence'] = sentence
    return Chosen(rows, content)


def rms(values: Singles) -> float:
    """Return the root of the mean square of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(known, dtype=np.float64)))) if known.size else np.nan


def _limit(values: Floats, rows: Floats) -> float | None:
    """Value that 97 % of the rows in the shown cells do not exceed."""
    known = np.isfinite(values)
    if not known.any():
        return None
    how: Any = {'weights': rows[known], 'method': 'inverted_cdf'}
    return short_one(float(np.quantile(values[known], 0.97, **how)))


def _edges(values: Singles, count: int) -> Floats:
    low, high = np.quantile(values, [_TAIL, 1.0 - _TAIL]).tolist()
    return np.linspace(low, high + 1e-9, count + 1)


def rounded(values: Sequence[float] | NDArray[np.floating[Any]]) -> list[float | None]:
    """Return values with five significant digits, None for what is not finite."""
    return [short_one(float(value)) for value in values]


def short_one(value: float) -> float | None:
    """Return a value with five significant digits, None if it is not finite."""
    return float(f'{value:.5g}') if np.isfinite(value) else None


_SPIKE = 4.0  # times the usual error
_NOISE = 3.0  # times the meter's noise
_MATTERS = 0.15  # of the squared error, that spikes hold where they are worth a sentence
_RARE = 0.08  # of the time
_KINDS = 6  # of torque, of speed and of acceleration, by which states are alike
_REGULAR = 0.6  # mean resultant length of phases that recur
_STRETCH, _WORSE, _MOST = 1.0, 3.0, 3  # s, times the usual error, stretches that are told


def moments(view: PowerView, drive: str) -> dict[str, Any]:
    """Return a sentence on the `spikes` of a drive's error, and `stretches` of large error.

    Stretches have start and stop in s and words. Both are empty where the error is spread evenly,
    or without a model.
    """
    error = error_of(view, drive).astype(np.float64)
    known = np.isfinite(error)
    if known.sum() < 2 * REDUCED_RATE:
        return {'spikes': '', 'stretches': []}
    return {'spikes': _spikes(view, drive, error, known), 'stretches': _stretches(view, error)}


def _spikes(view: PowerView, drive: str, error: Floats, known: Bools) -> str:
    usual = 1.4826 * float(np.median(np.abs(error[known])))
    column = state_column(view, drive)
    noise = view.noise[min(column, len(view.noise) - 1)]
    least = max(_SPIKE * usual, _NOISE * float(np.nan_to_num(noise)))
    high = known & (np.abs(error) > least)
    held = float(np.square(error[high]).sum() / max(np.square(error[known]).sum(), 1e-12))
    if held < _MATTERS or high.sum() > _RARE * known.sum():
        return ''
    starts = np.flatnonzero(high & ~np.r_[False, high[:-1]])
    ends = np.flatnonzero(high & ~np.r_[high[1:], False]) + 1
    peaks = [np.abs(error[a:b]).max() for a, b in zip(starts, ends, strict=True)]
    length = 1e3 * float(np.median(ends - starts)) / REDUCED_RATE
    told = (
        f'{len(starts)} spikes of {digits(float(np.median(peaks)))} to {digits(max(peaks))} W, '
        f'most of them {length:.0f} ms long, hold {held:.0%} of the squared error of {drive} in '
        f'{high.sum() / known.sum():.1%} of the time'
    )
    phase = view.stride.phase
    if phase is not None and np.isfinite(phase[starts]).any():
        turns = np.exp(2j * np.pi * phase[starts][np.isfinite(phase[starts])])
        middle = complex(turns.mean())
        if abs(middle) > _REGULAR:
            told += f', near phase {np.angle(middle) / (2 * np.pi) % 1.0:.2f} of the stride'
    without = _alike(view, column, high, known)
    if without is not None:
        told += (
            f'. In the same torque, speed and acceleration the drive spends {without:.0%} of the '
            'time without a spike, so that no effect of the state claims them: look for impacts '
            '(landing) and for what changes between two samples'
        )
    return f'{told}.'


def _alike(view: PowerView, column: int, high: Bools, known: Bools) -> float | None:
    """Share of the time in the states of the spikes that has none; None where they are its own."""
    cell = np.zeros(len(high), np.int64)
    for name in ('torque', 'velocity', 'acceleration'):
        if name not in view.state:
            continue
        values = view.state[name][:, column]
        inner = np.quantile(values[np.isfinite(values)], np.linspace(0, 1, _KINDS + 1)[1:-1])
        cell = cell * _KINDS + np.searchsorted(inner, np.nan_to_num(values))
    rows = np.bincount(cell[known], minlength=_KINDS**3)
    spiked = np.bincount(cell[high], minlength=_KINDS**3)
    # Of each spike's own cell, so that states that are always bad do not hide behind the others.
    share = float(np.sum(spiked * (1.0 - spiked / np.maximum(rows, 1))) / max(spiked.sum(), 1))
    return share if share > 0.5 else None


def _stretches(view: PowerView, error: Floats) -> list[dict[str, Any]]:
    """Seconds whose error is far above that of the others, neighbours joined, the worst first."""
    second = (view.slots / (_STRETCH * REDUCED_RATE)).astype(np.int64)
    squares, known = np.square(np.nan_to_num(error)), np.isfinite(error)
    count = np.bincount(second, known)
    with np.errstate(invalid='ignore', divide='ignore'):
        size = np.sqrt(np.bincount(second, squares) / count)
    size[count < 0.5 * _STRETCH * REDUCED_RATE] = np.nan
    usual = float(np.nanmedian(size)) if np.isfinite(size).any() else 0.0
    bad = np.nan_to_num(size) > _WORSE * usual
    starts = np.flatnonzero(bad & ~np.r_[False, bad[:-1]])
    ends = np.flatnonzero(bad & ~np.r_[bad[1:], False]) + 1
    found = []
    for a, b in zip(starts.tolist(), ends.tolist(), strict=True):
        share = squares[(second >= a) & (second < b)].sum() / max(squares.sum(), 1e-12)
        worst = float(np.nanmax(size[a:b]))
        words = (
            f'{a * _STRETCH:.0f} to {b * _STRETCH:.0f} s: {digits(worst)} W rms, '
            f'{digits(worst / usual)} times the usual, {share:.0%} of the squared error'
        )
        span = {'start': a * _STRETCH, 'stop': b * _STRETCH, 'words': words}
        found.append((share, span))
    found.sort(key=lambda one: -one[0])
    return [span for _, span in found[:_MOST]]
