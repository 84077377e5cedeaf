"""Moments of large error: spikes that recur, and stretches far worse than the rest."""

from typing import Any

import numpy as np
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_lab.compare.regimes import digits
from wattwalk_core.arrays import Bools, Floats

from power_workbench.views import maps
from power_workbench.views.view import PowerView

_SPIKE = 4.0  # times the usual error
_NOISE = 3.0  # times the meter's noise
_MATTERS = 0.15  # of the squared error, that spikes hold where they are worth a sentence
_RARE = 0.08  # of the time
_CELLS = 6  # of torque, of speed and of acceleration, by which states are alike
_REGULAR = 0.6  # mean resultant length of phases that recur
_STRETCH, _WORSE, _MOST = 1.0, 3.0, 3  # s, times the usual error, stretches that are told


def moments(view: PowerView, drive: str) -> dict[str, Any]:
    """Return a sentence on the `spikes` of a drive's error, and `stretches` of large error.

    Stretches have start and stop in s and words. Both are empty where the error is spread evenly,
    or without a model.
    """
    error = maps.error_of(view, drive).astype(np.float64)
    known = np.isfinite(error)
    if known.sum() < 2 * REDUCED_RATE:
        return {'spikes': '', 'stretches': []}
    return {'spikes': _spikes(view, drive, error, known), 'stretches': _stretches(view, error)}


def _spikes(view: PowerView, drive: str, error: Floats, known: Bools) -> str:
    usual = 1.4826 * float(np.median(np.abs(error[known])))
    column = maps.state_column(view, drive)
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
        inner = np.quantile(values[np.isfinite(values)], np.linspace(0, 1, _CELLS + 1)[1:-1])
        cell = cell * _CELLS + np.searchsorted(inner, np.nan_to_num(values))
    rows = np.bincount(cell[known], minlength=_CELLS**3)
    spiked = np.bincount(cell[high], minlength=_CELLS**3)
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
