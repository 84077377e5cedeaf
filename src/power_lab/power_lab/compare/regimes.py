"""Ranges of state in which a model's error is largest, in words."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.signals.scale import DriveScale
from wattwalk_core.arrays import Floats

_TORQUE_EDGES = (0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0)
_SPEED_EDGES = (0.1, 0.3, 0.6, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
_BINS = 8
_SHOWN = 5  # ranges
_LEAST_ROWS = 25  # half a second
_LEAST_SHARE = 0.01  # of the squared error
_RATE = 50.0  # Hz, of the rows

UNITS = {
    'torque': 'N·m',
    'speed': 'rad/s',
    'acceleration': 'rad/s²',
    'position': 'rad',
    'time': 's',
    'temperature': '°C',
    'voltage': 'V',
}


@dataclass(frozen=True)
class Regime:
    """Range of a drive's state (torque, speed, …) with a model's mean error in it."""

    drive: str
    conditions: tuple[str, ...]  # words
    bounds: Mapping[str, tuple[float, float]]  # by quantity
    error_w: float  # mean of estimated − measured
    seconds: float
    share: float  # of the drive's squared error that this mean makes up

    @property
    def text(self) -> str:
        """Text such as: LF_KFE, driving, 20 to 40 N·m, above 3 rad/s: 14 W too low."""
        size = abs(self.error_w)
        amount = f'{size:.0f}' if size >= 10 else f'{size:.2g}'
        side = 'low' if self.error_w < 0 else 'high'
        return f'{", ".join((self.drive, *self.conditions))}: {amount} W too {side}'

    def json(self) -> dict[str, object]:
        """Return JSON-compatible values, as the commands write them."""
        return {
            'text': self.text,
            'drive': self.drive,
            'bounds': {name: list(bounds) for name, bounds in self.bounds.items()},
            'conditions': list(self.conditions),
            'error_w': round(self.error_w, 4),
            'seconds': round(self.seconds, 2),
            'rows': round(self.seconds * _RATE),
            'share': round(self.share, 4),
        }


class _Range(NamedTuple):
    """Range of state with the sum of a model's error in it."""

    told: Callable[[], tuple[str, ...]]  # its conditions in words, made of the worst range alone
    bounds: Mapping[str, tuple[float, float]]  # by quantity
    summed: float  # estimated − measured, W
    rows: float

    @property
    def square(self) -> float:
        """Squared error that the mean in this range makes up, W²."""
        return self.summed**2 / self.rows


@dataclass(frozen=True)
class Bin:
    """Mean and rms error, W, of the samples in one bin of a quantity."""

    low: float
    high: float
    mean: float
    rmse: float
    count: int


def worst_regimes(
    residual: Floats,
    state: Mapping[str, Floats],
    names: Sequence[str],
    labels: Mapping[str, NDArray[np.str_]] | None = None,
    scale: DriveScale | None = None,
) -> list[Regime]:
    """Ranges of state with the largest mean errors, worst first; a quantity at most once a drive.

    residual: measured − estimated, W [N, D]; state: signals [N, D] by name; labels: words [N, D]
    by name, such as stance; scale: sizes of the drives, which scale the ranges.
    """
    found: list[Regime] = []
    for drive, name in enumerate(names):
        good = np.isfinite(residual[:, drive])
        if good.sum() < _LEAST_ROWS:
            continue
        error = -residual[good, drive]
        rows = {key: values[good, drive] for key, values in state.items()}
        total = max(float(np.square(error).sum()), 1e-12)
        loads, speeds = _edges(scale, drive)
        load, speed = np.abs(rows['torque']), np.abs(rows['velocity'])
        shaft, moves = rows['torque'] * rows['velocity'], speed >= speeds[0]
        modes = {
            'driving': (moves & (shaft > 0), speeds),
            'braking': (moves & (shaft <= 0), speeds),
            'at rest': (speed < speeds[0], (0.0, speeds[0])),
        }
        kinds: list[Iterable[_Range]] = [
            _by_load(mode, error[own], load[own], speed[own], loads, edges)
            for mode, (own, edges) in modes.items()
        ]
        kinds += [
            _by_range(error, key, rows[key])
            for key in ('acceleration', 'position', 'time', 'temperature')
            if key in rows and np.isfinite(rows[key]).all()
        ]
        for key, words in (labels or {}).items():
            kinds += _by_label(error, key, words[good, drive])
        for kind in kinds:
            best = max(kind, key=lambda one: one.square, default=None)
            if best is not None and best.square / total >= _LEAST_SHARE:
                found.append(
                    Regime(
                        drive=name,
                        conditions=best.told(),
                        bounds=best.bounds,
                        error_w=best.summed / best.rows,
                        seconds=best.rows / _RATE,
                        share=best.square / total,
                    )
                )
    found.sort(key=lambda regime: -abs(regime.error_w) * np.sqrt(regime.share * regime.seconds))
    return found[:_SHOWN]


def bins(values: Floats, residual: Floats, count: int = 24) -> list[Bin]:
    """Mean and rms error, estimated − measured in W, over a quantity in count equal ranges.

    values: of the quantity [N]; residual: measured − estimated, W [N]. [] for fewer than 25
    samples.
    """
    good = np.isfinite(values) & np.isfinite(residual)
    values, error = values[good], -residual[good]
    if values.size < _LEAST_ROWS:
        return []
    low, high = np.quantile(values, [0.002, 0.998]).tolist()
    edges = np.linspace(low, high, count + 1).tolist()
    place = np.clip(np.searchsorted(edges, values, side='right') - 1, 0, count - 1)
    rows, sums, squares = (
        np.bincount(place, weights, count) for weights in (None, error, np.square(error))
    )
    return [
        Bin(edges[at], edges[at + 1], float(sums[at] / n), float(np.sqrt(squares[at] / n)), n)
        for at, n in enumerate(rows.tolist())
        if n >= _LEAST_ROWS // 5
    ]


def digits(value: float) -> str:
    """Format with three significant digits and no exponent."""
    return f'{float(f"{value:.3g}"):.10g}'


def standstill(scale: DriveScale, drive: int) -> float:
    """Speed in rad/s below which regimes call a drive at rest."""
    return _edges(scale, drive)[1][0]


def _edges(scale: DriveScale | None, drive: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Borders of ranges of load, N·m, and of speed, rad/s, for a drive's size."""
    times = (1.0, 1.0) if scale is None else scale.of(drive)[:2]
    torques, speeds = (
        tuple(float(f'{factor * edge:.2g}') for edge in edges)
        for factor, edges in zip(times, (_TORQUE_EDGES, _SPEED_EDGES), strict=True)
    )
    return torques, speeds


def _by_load(
    mode: str,
    error: Floats,
    load: Floats,
    speed: Floats,
    loads: Sequence[float],
    speeds: Sequence[float],
) -> Iterator[_Range]:
    """Yield a mode such as driving in each rectangle of load and speed."""
    borders = [np.array([*edges[:-1], np.inf]) for edges in (loads, speeds)]
    tables = (np.histogram2d(load, speed, borders, weights=own)[0] for own in (error, None))
    sums = [  # over all of lower load and speed, for any rectangle at once
        np.pad(table.cumsum(0).cumsum(1), ((1, 0), (1, 0))) for table in tables
    ]
    ranges = (combinations(range(len(edges)), 2) for edges in (loads, speeds))
    for (a, b), (c, d) in product(*ranges):
        summed, rows = (
            float(table[b, d] - table[a, d] - table[b, c] + table[a, c]) for table in sums
        )
        if rows >= _LEAST_ROWS:
            bounds = {'torque': (loads[a], loads[b])}
            if mode != 'at rest':
                bounds['speed'] = speeds[c], speeds[d]
            told = partial(_load_words, mode, bounds, {'torque': loads, 'speed': speeds})
            yield _Range(told, bounds, summed, rows)


def _load_words(
    mode: str,
    bounds: Mapping[str, tuple[float, float]],
    edges: Mapping[str, Sequence[float]],
) -> tuple[str, ...]:
    words = (_words(*ends, UNITS[name], edges[name]) for name, ends in bounds.items())
    return (mode, *filter(None, words))


def _by_range(error: Floats, key: str, values: Floats) -> Iterator[_Range]:
    """Yield ranges of a quantity over at most half of its bins, of about as many rows each."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1))).tolist()
    count = len(edges) - 1
    if count < 3:
        return
    place = np.clip(np.searchsorted(edges, values, side='right') - 1, 0, count - 1)
    sums, rows = (np.bincount(place, own, count) for own in (error, None))
    for a, b in combinations(range(count + 1), 2):
        within = float(rows[a:b].sum())
        if b - a <= count // 2 and within >= _LEAST_ROWS:
            ends = edges[a], edges[b]
            yield _Range(
                partial(_range_words, key, *ends), {key: ends}, float(sums[a:b].sum()), within
            )


def _range_words(key: str, low: float, high: float) -> tuple[str, ...]:
    return (f'{key} {digits(low)} to {digits(high)} {UNITS[key]}',)


def _by_label(error: Floats, key: str, words: NDArray[np.str_]) -> Iterator[list[_Range]]:
    """Yield each label's rows as a list of one range, as every label is a regime of its own."""
    kinds = [str(word) for word in np.unique(words) if word]
    for word in kinds if len(kinds) > 1 else []:
        own = error[words == word]
        if own.size >= _LEAST_ROWS:
            text = word if key == 'phase' else f'{key} {word}'
            yield [_Range(partial(tuple, (text,)), {}, float(own.sum()), own.size)]


def _words(low: float, high: float, unit: str, edges: Sequence[float]) -> str:
    if low <= edges[0] and high >= edges[-1]:
        return ''
    if high >= edges[-1]:
        return f'above {low:g} {unit}'
    if low <= edges[0]:
        return f'below {high:g} {unit}'
    return f'{low:g} to {high:g} {unit}'


_SPAN = 12.0  # s shown of a recording


def worst_stretch(residual: Floats, gap_free: Sequence[slice] = ()) -> slice:
    """Slice of at most 12 s in which the squared residual sums to most; residual: 50 Hz [N].

    gap_free: slices without gaps, in one of which it lies; by default all rows are one.
    """
    best, most = slice(0, 0), -1.0
    for within in gap_free or [slice(0, len(residual))]:
        square = np.square(np.nan_to_num(residual[within]))
        length = min(len(square), round(_SPAN * _RATE))
        summed = np.concatenate([[0.0], np.cumsum(square)])
        spans = summed[length:] - summed[: len(summed) - length]
        start = int(np.argmax(spans))
        if spans[start] > most:
            first = within.start + start
            best, most = slice(first, first + length), float(spans[start])
    return best
