"""Coarse alignment of a log with a recording, by correlation over offsets and clock drifts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.correlation import masked_correlation
from scipy.signal import find_peaks

from power_calibration.analyser.curve import Curve

Floats = NDArray[np.float64]
RATE = 50.0  # Hz
_LARGEST_DRIFT = 300e-6
_SMEAR = 0.03  # s of drift from end to end that correlation tolerates
_LEAST_OVERLAP = 3.0  # s
_CANDIDATES = 5
_SEPARATION = 0.04  # s between candidates


@dataclass(frozen=True)
class Match:
    """
    A possible position of a log in a recording.

    offset: s added to the log's time at `centre` (the log's own time, s); drift: by how much the
    log's clock runs too fast (1); correlation over the overlap, whose length is in s.
    """

    offset: float
    drift: float
    correlation: float
    overlap: float
    centre: float


def matches(ours: Curve, reference: Curve) -> tuple[list[Match], Match]:
    """
    Return the best matches of a reference curve with ours, best first, and the most negative.

    Both hold one signal, low-passed to RATE. The list is empty where they overlap nowhere for 3 s.
    Scores are Fisher's z of the correlation times the root of the overlap, so that a short overlap
    that fits by chance loses against a long one.
    """
    start = ours.span[0]
    a, known_a = _grid(ours, *ours.span)
    first, last = reference.span
    centre = 0.5 * (first + last)
    length = min(ours.span[1] - start, last - first)
    count = int(np.ceil(_LARGEST_DRIFT * length / _SMEAR))
    drifts = np.arange(-count, count + 1) * (_SMEAR / max(length, 1.0))
    found: list[tuple[float, Match]] = []
    opposed = Match(0.0, 0.0, 0.0, 0.0, centre)
    for drift in sorted(drifts, key=abs):
        stretched = Curve(
            tuple(((time - centre) / (1.0 + drift), v) for time, v in reference.runs),
            reference.period,
        )
        b, known_b = _grid(stretched, *stretched.span)
        correlation, overlap, lag = masked_correlation(a, known_a, b, known_b)
        usable = overlap >= min(max(_LEAST_OVERLAP, 0.2 * length) * RATE, 0.9 * overlap.max())
        usable &= overlap >= _LEAST_OVERLAP * RATE
        if not usable.any():
            continue
        score = np.where(usable, np.arctanh(np.clip(correlation, -0.99999, 0.99999)), -np.inf)
        score *= np.sqrt(np.maximum(overlap, 1.0))
        offset = start + lag / RATE - stretched.span[0] - centre
        places = [*_peaks(score), int(np.argmin(np.where(usable, correlation, 1.0)))]
        *best, worst = (
            Match(float(offset[i]), drift, float(correlation[i]), float(overlap[i]) / RATE, centre)
            for i in places
        )
        found += zip(score[places[:-1]].tolist(), best, strict=True)
        opposed = min(opposed, worst, key=lambda match: match.correlation)
    found.sort(key=lambda pair: -pair[0])
    apart: list[Match] = []
    for _, match in found:
        if all(abs(match.offset - other.offset) > _SEPARATION for other in apart):
            apart.append(match)
    return apart[:_CANDIDATES], opposed


def _grid(curve: Curve, first: float, last: float) -> tuple[Floats, Floats]:
    """Return a signal at RATE less its mean, 0 where unknown, and the mask of what is known."""
    times = first + np.arange(int((last - first) * RATE)) / RATE
    values = curve.at(times)[:, 0]
    known = np.isfinite(values)
    if known.any():
        values = values - values[known].mean()
    return np.where(known, values, 0.0), known.astype(np.float64)


def _peaks(score: Floats) -> list[int]:
    """Return the places of the highest local maxima."""
    finite = np.where(np.isfinite(score), score, -1e9)
    peaks, _ = find_peaks(np.concatenate([[-2e9], finite, [-2e9]]))
    order = np.argsort(-finite[peaks - 1])[:_CANDIDATES]
    return [int(peak - 1) for peak in peaks[order]]
