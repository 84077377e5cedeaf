"""Sampled signals that can be evaluated at any time: low-passed once, then interpolated."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.filters import windowed_sinc
from power_recordings.alignment.stream import cubic
from scipy.ndimage import correlate1d
from scipy.signal import resample_poly

Floats = NDArray[np.float64]
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
        """
        Make a curve from samples [N, K] and the first and last + 1 of each run.

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

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, s; (0, 0) of an empty curve."""
        if not self.runs:
            return 0.0, 0.0
        return float(self.runs[0][0][0]), float(self.runs[-1][0][-1])

    def columns(self, chosen: slice) -> 'Curve':
        """Return some of the signals."""
        return Curve(tuple((time, values[:, chosen]) for time, values in self.runs), self.period)

    def filtered(self, taps: Floats, every: int = 1) -> 'Curve':
        """
        Return the curve through a centred FIR filter, of which every n-th sample is kept.

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
        """
        Return the curve limited to what a signal sampled at `rate` Hz can hold.

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
        return Curve(
            tuple((time, np.gradient(values, time, axis=0)) for time, values in self.runs),
            self.period,
        )


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
    shifted = [
        windowed_sinc(time - 0.5 * mean * shift, 0.375 * rate, half_width, _BETA)
        for shift in _SHIFTS
    ]
    return np.asarray(0.5 * _WEIGHTS @ np.array(shifted))


def _interpolated(time: Floats, values: Floats, factor: int) -> tuple[Floats, Floats]:
    """Return a run at a multiple of its rate, without images and without the filter's ends."""
    mean = values.mean(axis=0)
    dense = resample_poly(values - mean, factor, 1, axis=0) + mean
    index = np.arange(len(dense)) / factor
    edge = min(12 * factor, len(dense) // 4)
    whole = slice(edge, len(dense) - factor - edge)
    return np.interp(index, np.arange(len(time)), time)[whole], dense[whole]
