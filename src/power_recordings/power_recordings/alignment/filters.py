"""The filters of alignment: all linear-phase and centred, so that none delays a signal."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.optimize import brentq
from scipy.signal import firwin, kaiserord, savgol_coeffs

SMOOTHING = 12.5  # Hz, −3 dB (paper, Section II-A)
_RIPPLE = 60.0  # dB
_POLYORDER = 2


@cache
def antialias(rate: float, lower: float) -> NDArray[np.float64]:
    """
    Taps of a FIR low-pass for going from `rate` to `lower` [Hz]; a single 1 if nothing is to do.

    Flat within 0.2 % up to a quarter of the lower rate, at least 58 dB down from half of it on;
    its gain at 0 Hz is exactly 1, so it keeps the mean.
    """
    if lower >= 0.9 * rate:
        return np.ones(1)
    length, beta = kaiserord(_RIPPLE, (lower / 4) / (rate / 2))
    taps = firwin(length | 1, lower * 3 / 8, window=('kaiser', beta), fs=rate)
    return np.asarray(taps, np.float64)


def gain(taps: NDArray[np.float64], frequency: float, rate: float) -> float:
    """The gain of centred taps for a sine of `frequency` Hz sampled at `rate` Hz; may be < 0."""
    steps = np.arange(len(taps)) - len(taps) // 2
    return float(taps @ np.cos(2 * np.pi * frequency / rate * steps))


@cache
def smoothing(rate: float, cutoff: float = SMOOTHING) -> NDArray[np.float64]:
    """
    Taps of the quadratic Savitzky-Golay filter whose −3 dB point comes closest to `cutoff` Hz.

    The window is a whole number of samples, which leaves 12.18 Hz for 12.5 Hz at 400 Hz.
    """
    best = min(range(5, int(2 * rate / cutoff), 2), key=lambda n: abs(_cutoff(n, rate) - cutoff))
    return np.asarray(savgol_coeffs(best, _POLYORDER), np.float64)


def _cutoff(window: int, rate: float) -> float:
    taps = np.asarray(savgol_coeffs(window, _POLYORDER), np.float64)
    first_null = rate * 1.7 / window
    return float(
        brentq(lambda f: gain(taps, f, rate) - np.sqrt(0.5), 0, min(first_null, rate / 2))
    )


def centred(values: NDArray[Any], taps: NDArray[np.float64]) -> NDArray[np.float32]:
    """
    Filter values [N, …] along time, where the whole filter has samples: [N − len(taps) + 1, …].

    A NaN spoils only what the filter covers.
    """
    half = len(taps) // 2
    if not half:
        return np.asarray(values, np.float32)
    filtered = correlate1d(np.asarray(values, np.float32), taps, axis=0, mode='nearest')
    return np.asarray(filtered[half:-half], np.float32)
