"""Signals that can be asked for at any time: low-passed once, then interpolated."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.filters import windowed_sinc
from power_recordings.alignment.stream import cubic
from scipy.ndimage import correlate1d
from scipy.signal import resample_poly

Floats = NDArray[np.float64]
_FAST = 4000.0  # Hz, what a faster signal is averaged down to
_SLOW = 1000.0  # Hz, what a slower one is brought up to
_BETA = 5.653  # of Kaiser's window for 60 dB
_WIDTH = 7.25  # half the length of the low-pass, in periods of its rate
_BESIDE = 5.0  # samples of a low-passed curve per sample of its rate


@dataclass(frozen=True)
class Curve:
    """K signals in R runs without gaps: times s [N] and values [N, K] of each."""

    runs: tuple[tuple[Floats, Floats], ...]
    period: float  # s between samples
    rows: int = 1  # that each sample is the mean of

    @classmethod
    def of(
        cls,
        time: Floats,
        values: Floats,
        starts: Iterable[int],
        stops: Iterable[int],
        period: float,
    ) -> 'Curve':
        """
        A curve from samples and the first and last + 1 of each run.

        What is sampled faster than 8 kHz is averaged down to 4 kHz or a little more.
        """
        every = max(1, int(1.0 / period / _FAST))
        runs = []
        for start, stop in zip(starts, stops, strict=True):
            count = (stop - start) // every
            if count < 4:
                continue
            rows = slice(start, start + count * every)
            runs.append(
                (
                    time[rows].reshape(count, every).mean(axis=1),
                    values[rows].reshape(count, every, -1).mean(axis=1),
                )
            )
        return cls(tuple(runs), period * every, every)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, s; (0, 0) of an empty curve."""
        if not self.runs:
            return 0.0, 0.0
        return float(self.runs[0][0][0]), float(self.runs[-1][0][-1])

    def low_passed(self, rate: float, *, raised: bool = True) -> 'Curve':
        """
        Without what a signal sampled at `rate` Hz cannot hold.

        A windowed sinc, flat to a quarter of the rate and 60 dB down from half of it on, that is
        the same function of time whatever the curve's own period, so that two curves are filtered
        alike (taps by whole numbers differ by 1e-3). Each run loses half the filter at both ends;
        those that are too short are left out. What is slower than 500 Hz is brought up to about
        1 kHz first, for `at` to be exact; without `raised` it is not.
        """
        slow = raised and self.period > 2.0 / _SLOW
        rising = round(_SLOW * self.period) if slow else 1
        period = self.period / max(1, rising)
        taps = _taps(period, rate)
        half = len(taps) // 2
        every = max(1, int(1.0 / period / (_BESIDE * rate)))
        runs = []
        for time, values in self.runs:
            if rising > 1:
                time, values = _raised(time, values, rising)
            if len(time) < len(taps) + 4 * every:
                continue
            smooth = correlate1d(values, taps, axis=0, mode='nearest')
            inside = slice(half, len(time) - half, every)
            runs.append((time[inside], smooth[inside]))
        return Curve(tuple(runs), period * every)

    def averaged(self, width: float) -> 'Curve':
        """Every sample replaced by the mean over a width in s around it."""
        count = max(1, round(width / self.period))
        taps = np.full(count, 1.0 / count)
        if count % 2 == 0:
            taps = np.concatenate([[0.5 / count], np.full(count - 1, 1.0 / count), [0.5 / count]])
        half = len(taps) // 2
        runs = []
        for time, values in self.runs:
            if len(time) <= len(taps) + 4:
                continue
            smooth = correlate1d(values, taps, axis=0, mode='nearest')
            inside = slice(half, len(time) - half)
            runs.append((time[inside], smooth[inside]))
        return Curve(tuple(runs), self.period)

    def at(self, times: Floats) -> Floats:
        """Values at ascending times, [T, K]; NaN outside the runs."""
        width = self.runs[0][1].shape[1] if self.runs else 1
        result = np.full((len(times), width), np.nan)
        for time, values in self.runs:
            low, high = np.searchsorted(times, [time[0], time[-1]]).tolist()
            if high > low:
                result[low:high] = cubic(time, values, times[low:high])
        return result

    def derivative(self) -> 'Curve':
        """Derivatives of all signals, per s."""
        return Curve(
            tuple((time, np.gradient(values, time, axis=0)) for time, values in self.runs),
            self.period,
        )


def _taps(period: float, rate: float) -> Floats:
    """The low-pass for `rate` Hz at a period in s; a single 1 where that is no less."""
    if rate >= 0.9 / period:
        return np.ones(1)
    half_width = _WIDTH / rate
    count = int(half_width / period)
    time = period * np.arange(-count, count + 1)
    return windowed_sinc(time, 0.375 * rate, half_width, _BETA)


def _raised(time: Floats, values: Floats, factor: int) -> tuple[Floats, Floats]:
    """At a multiple of the rate, without images; the ends, which see the filter, cut off."""
    mean = values.mean(axis=0)
    dense = resample_poly(values - mean, factor, 1, axis=0) + mean
    index = np.arange(len(dense)) / factor
    edge = min(12 * factor, len(dense) // 4)
    whole = slice(edge, len(dense) - factor - edge)
    return np.interp(index, np.arange(len(time)), time)[whole], dense[whole]
