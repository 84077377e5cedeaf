"""Error over the state of a drive, and the moments that a range of state or time chooses."""

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
