"""Where a log lies in a recording, by correlation over all offsets and a range of drifts."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.correlation import masked_correlation
from scipy.signal import find_peaks

from power_calibration.analyser.curve import Curve

Floats = NDArray[np.float64]
RATE = 50.0  # Hz, of the coarse search
_MOST_DRIFT = 300e-6
_SMEAR = 0.03  # s of drift from end to end that correlation survives
_LEAST = 3.0  # s of overlap
_CANDIDATES = 5
_APART = 0.04  # s between candidates


@dataclass(frozen=True)
class Match:
    """
    A place of a log in a recording.

    offset: s added to the log's time at `centre` (the log's own time, s); drift: how much too
    fast the log's clock runs (1); correlation over the overlap, whose length is in s.
    """

    offset: float
    drift: float
    correlation: float
    overlap: float
    centre: float


def search(
    ours: Curve, reference: Curve, progress: Callable[[float], None] = lambda share: None
) -> tuple[list[Match], Match]:
    """
    The best places of a one-signal reference curve in ours, best first, and the most opposed.

    Both must be low-passed to RATE. The list is empty where they overlap nowhere for 3 s. Scores
    are Fisher's z of the correlation times the root of the overlap, so that a short overlap that
    fits by chance loses against a long one.
    """
    start = ours.span[0]
    a, mask_a = _grid(ours, *ours.span)
    first, last = reference.span
    centre = 0.5 * (first + last)
    length = min(ours.span[1] - start, last - first)
    count = int(np.ceil(_MOST_DRIFT * length / _SMEAR))
    drifts = np.arange(-count, count + 1) * (_SMEAR / max(length, 1.0))
    found: list[tuple[float, Match]] = []
    opposed = Match(0.0, 0.0, 0.0, 0.0, centre)
    for number, drift in enumerate(sorted(drifts, key=abs)):
        stretched = Curve(
            tuple(((time - centre) / (1.0 + drift), v) for time, v in reference.runs),
            reference.period,
        )
        b, mask_b = _grid(stretched, *stretched.span)
        correlation, overlap, lag = masked_correlation(a, mask_a, b, mask_b)
        seconds = overlap / RATE
        offset = start + lag / RATE - stretched.span[0] - centre
        least = max(_LEAST, 0.2 * length) * RATE
        usable = overlap >= min(least, 0.9 * overlap.max())
        usable &= overlap >= _LEAST * RATE
        if not usable.any():
            continue
        score = np.where(usable, np.arctanh(np.clip(correlation, -0.99999, 0.99999)), -np.inf)
        score *= np.sqrt(np.maximum(overlap, 1.0))
        for peak in _peaks(score):
            match = Match(
                float(offset[peak]), drift, float(correlation[peak]), float(seconds[peak]), centre
            )
            found.append((float(score[peak]), match))
        worst = int(np.argmin(np.where(usable, correlation, 1.0)))
        if correlation[worst] < opposed.correlation:
            opposed = Match(
                float(offset[worst]),
                drift,
                float(correlation[worst]),
                float(seconds[worst]),
                centre,
            )
        progress((number + 1) / len(drifts))
    found.sort(key=lambda pair: -pair[0])
    best: list[Match] = []
    for _, match in found:
        if all(abs(match.offset - other.offset) > _APART for other in best):
            best.append(match)
        if len(best) == _CANDIDATES:
            break
    return best, opposed


def _grid(curve: Curve, first: float, last: float) -> tuple[Floats, Floats]:
    """A signal at RATE less its mean, 0 where it is unknown, and where it is known."""
    times = first + np.arange(int((last - first) * RATE)) / RATE
    values = curve.at(times)[:, 0]
    known = np.isfinite(values)
    if known.any():
        values = values - values[known].mean()
    return np.where(known, values, 0.0), known.astype(np.float64)


def _peaks(score: Floats) -> list[int]:
    """Places of the highest local maxima."""
    finite = np.where(np.isfinite(score), score, -1e9)
    peaks, _ = find_peaks(np.concatenate([[-2e9], finite, [-2e9]]))
    order = np.argsort(-finite[peaks - 1])[:_CANDIDATES]
    return [int(peak - 1) for peak in peaks[order]]
