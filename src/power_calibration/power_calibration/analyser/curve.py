"""Sampled signals that can be evaluated at any time: low-passed once, then interpolated."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from power_recordings.alignment.filters import masked_correlation, windowed_sinc
from power_recordings.alignment.stream import Stream, cubic
from power_recordings.reading.reader import Recording
from scipy.ndimage import correlate1d
from scipy.signal import find_peaks, resample_poly
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError

_FAST = 4000.0  # Hz, rate to which faster signals are averaged
_SLOW = 1000.0  # Hz, rate to which slow signals are interpolated before filtering
_BETA = 5.653  # of Kaiser's window for 60 dB
_WIDTH = 7.25  # half the length of the low-pass, in periods of its rate
_OVERSAMPLING = 5.0  # samples of a low-passed curve per sample of its rate
_SHIFTS, _WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True)
class Curve:
    """K signals in R runs without gaps: times s [N] and values [N, K] of each run."""

    runs: tuple[tuple[Floats, Floats], ...]
    period: float  # s between samples
    rows: int = 1  # rows averaged into each sample

    @classmethod
    def of(
        cls,
        time: Floats,
        values: Floats,
        starts: Iterable[int],
        stops: Iterable[int],
        period: float,
    ) -> 'Curve':
        """Make a curve from samples [N, K] and the first and last + 1 of each run.

        Signals faster than 8 kHz are averaged to 4 kHz or a little more.
        """
        every = max(1, int(1.0 / period / _FAST))
        runs = []
        for start, stop in zip(starts, stops, strict=True):
            count = (stop - start) // every
            if count < 4:
                continue
            rows = slice(start, start + count * every)
            means = time[rows].reshape(count, every).mean(axis=1)
            runs.append((means, values[rows].reshape(count, every, -1).mean(axis=1)))
        return cls(tuple(runs), period * every, every)

    @classmethod
    def of_samples(
        cls, time: Floats, values: Floats, bad: Bools, apart: Bools | None = None
    ) -> 'Curve':
        """Make a curve from samples [N, K] less those marked bad, cut at gaps as by `Stream`."""
        stream = Stream.of(time, np.zeros((len(time), 0), np.float32), bad, apart)
        return cls.of(stream.time, values[~bad], stream.starts, stream.stops, stream.period)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, s; (0, 0) of an empty curve."""
        if not self.runs:
            return 0.0, 0.0
        return float(self.runs[0][0][0]), float(self.runs[-1][0][-1])

    def mapped(self, change: Callable[[Floats, Floats], Floats]) -> 'Curve':
        """Return the curve of what a function makes of the times and values of each run."""
        return Curve(tuple((time, change(time, v)) for time, v in self.runs), self.period)

    def columns(self, chosen: slice) -> 'Curve':
        """Return the curve of a slice of the K signals."""
        return self.mapped(lambda _, values: values[:, chosen])

    def filtered(self, taps: Floats, every: int = 1) -> 'Curve':
        """Return the curve filtered by centred FIR taps; every `every`-th sample is kept.

        Each run loses half the filter at both ends; runs that are too short are left out.
        """
        half = len(taps) // 2
        runs = []
        for time, values in self.runs:
            if len(time) < len(taps) + 4 * every:
                continue
            inside = slice(half, len(time) - half, every)
            smooth = correlate1d(values, taps, axis=0, mode='nearest')[inside]
            runs.append((time[inside], smooth))
        return Curve(tuple(runs), self.period * every)

    def low_passed(self, rate: float, *, mean: float = 0.0, interpolate: bool = True) -> 'Curve':
        """Return the curve limited to what a signal sampled at `rate` Hz can hold.

        The filter is a windowed sinc, flat to a quarter of the rate and 60 dB down from half of it
        on. It is the same function of time at any period of the curve, so that two curves are
        filtered alike (taps by whole numbers would differ by 1e-3). mean: width in s of a moving
        average in addition. Curves under 500 Hz are interpolated to about 1 kHz first, which `at`
        needs to be exact, unless `interpolate` is False.
        """
        curve = self
        if interpolate and self.period > 2.0 / _SLOW:
            factor = round(_SLOW * self.period)
            raised = tuple(_interpolated(*run, factor) for run in self.runs)
            curve = Curve(raised, self.period / factor)
        every = max(1, int(1.0 / curve.period / (_OVERSAMPLING * rate)))
        return curve.filtered(_low_pass(curve.period, rate, mean), every)

    def at(self, times: Floats) -> Floats:
        """Return the values at ascending times, [T, K]; NaN outside the runs."""
        width = self.runs[0][1].shape[1] if self.runs else 1
        result = np.full((len(times), width), np.nan)
        for time, values in self.runs:
            low, high = np.searchsorted(times, [time[0], time[-1]]).tolist()
            if high > low:
                result[low:high] = cubic(time, values, times[low:high])
        return result

    def derivative(self) -> 'Curve':
        """Return the derivatives of all signals, per s."""
        return self.mapped(lambda time, values: np.gradient(values, time, axis=0))


def _low_pass(period: float, rate: float, mean: float) -> Floats:
    """Return the taps for `rate` Hz at a period in s; a single 1 where that is no less."""
    if rate >= 0.9 / period:
        return np.ones(1)
    half_width = _WIDTH / rate
    count = int((half_width + 0.5 * mean) / period)
    time = period * np.arange(-count, count + 1, dtype=np.float64)
    if not mean:
        return windowed_sinc(time, 0.375 * rate, half_width, _BETA)
    # The mean over a width of the continuous filter, by Gauss's quadrature.
    starts = 0.5 * mean * _SHIFTS
    shifted = [windowed_sinc(time - at, 0.375 * rate, half_width, _BETA) for at in starts]
    return np.asarray(0.5 * _WEIGHTS @ np.array(shifted))


def _interpolated(time: Floats, values: Floats, factor: int) -> tuple[Floats, Floats]:
    """Return a run at a multiple of its rate, without images and without the filter's ends."""
    mean = values.mean(axis=0)
    dense = resample_poly(values - mean, factor, 1, axis=0) + mean
    index = np.arange(len(dense)) / factor
    edge = min(12 * factor, len(dense) // 4)
    whole = slice(edge, len(dense) - factor - edge)
    return np.interp(index, np.arange(len(time)), time)[whole], dense[whole]


RATE = 50.0  # Hz
_LARGEST_DRIFT = 300e-6
_SMEAR = 0.03  # s of drift from end to end that correlation tolerates
_LEAST_OVERLAP = 3.0  # s
_CANDIDATES = 5
_SEPARATION = 0.04  # s between candidates


@dataclass(frozen=True)
class Match:
    """A possible position of a log in a recording.

    offset: s added to the log's time at `centre` (the log's own time, s); drift: by how much the
    log's clock runs too fast (1); correlation over the overlap, whose length is in s.
    """

    offset: float
    drift: float
    correlation: float
    overlap: float
    centre: float


def matches(ours: Curve, reference: Curve) -> tuple[list[Match], Match]:
    """Return the best matches of a reference with ours, best first, and the most anticorrelated.

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
        moved = tuple(((time - centre) / (1.0 + drift), v) for time, v in reference.runs)
        stretched = Curve(moved, reference.period)
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


_MOST_BAD = 0.05


@dataclass(frozen=True)
class MeasuredDrive:
    """Voltage V and current A of a drive, at times in s after start_ns."""

    path: Path
    drive: str
    start_ns: int
    curve: Curve  # voltage, current
    calibration: str  # that the recording was made with, as its card names it
    notes: tuple[str, ...]

    @property
    def power(self) -> Curve:
        """Power as recorded, W."""
        return self.corrected(np.ones(2), np.zeros(2))

    def corrected(self, gain: Floats, offset: Floats) -> Curve:
        """Return power, W, with voltage and current each · gain [2] + offset [2]."""
        return self.curve.mapped(lambda _, v: np.prod(v * gain + offset, axis=1, keepdims=True))

    @classmethod
    def of(cls, recording: Recording, drive: str | None) -> 'MeasuredDrive':
        """Take one measured drive of a recording; None takes the only one.

        InputError for a drive that was not measured, whose current is constant, or whose samples
        are out of range or NaN in over 5 %.
        """
        path, supply = recording.path, recording.drive_supply()
        measured = ', '.join(supply.names)
        if drive is None and len(supply.names) != 1:
            raise InputError(
                f'{path} measures {measured}: name the drive that the analyser measured, as '
                '--drive NAME'
            )
        name = supply.names[0] if drive is None else drive
        if name not in supply.names:
            raise InputError(f'--drive {name!r}: {path} measures {measured}')
        column = supply.names.index(name)
        values = np.column_stack([supply.voltage[:, column], supply.current[:, column]])
        flagged, bad = supply.status[:, column] != 0, ~supply.good[:, column]
        if bad.mean() > _MOST_BAD:
            what = 'were out of range' if flagged.mean() > _MOST_BAD else 'are NaN'
            raise InputError(
                f'{path}: {bad.mean():.0%} of the samples of {name} {what}; record again with '
                'less load'
            )
        if len(supply) < 100:
            raise InputError(f'{path} has only {len(supply)} samples of {name}')
        amps = values[~bad, 1]
        if float(np.ptp(amps)) < 1e-6:
            raise InputError(
                f'{path}: the current of {name} is constant ({amps[0]:g} A); record it in motion'
            )
        notes = []
        if bad.any():
            notes.append(f'{int(bad.sum())} of our samples are flagged or NaN and left out')
        if supply.lost:
            notes.append(f'{supply.lost} of our samples were lost')
        start = int(supply.stamp_ns[0])
        time = (supply.stamp_ns - start) / 1e9
        curve = Curve.of_samples(time, values.astype(np.float64), bad, supply.after_gap)
        return cls(path, name, start, curve, recording.card.calibration, tuple(notes))
