"""Linear-phase, centred filters: they do not shift a signal in time.

scipy is imported where it is used: it would delay the refusal of wrong arguments.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from wattwalk_core.arrays import Floats, Singles

SMOOTHING = 12.5  # Hz, −3 dB (paper, Section II-A)
_RIPPLE = 60.0  # dB
_POLYORDER = 2


def windowed_sinc(time: Floats, cutoff: float, half_width: float, beta: float) -> Floats:
    """Return the taps at times in s of a low-pass FIR filter, with a gain of exactly 1 at 0 Hz.

    cutoff: −6 dB, in Hz. half_width: of the Kaiser window with shape `beta`, in s.
    """
    window = np.i0(beta * np.sqrt(np.maximum(1.0 - (time / half_width) ** 2, 0.0)))
    taps: Floats = np.where(np.abs(time) <= half_width, window, 0.0) * np.sinc(2 * cutoff * time)
    return taps / taps.sum()


@cache
def low_pass(rate: float, passband: float, stopband: float) -> Floats:
    """Return the taps of a low-pass FIR filter for signals at `rate` Hz.

    It is flat within 0.2 % up to `passband` Hz and at least 58 dB down from `stopband` Hz on.
    """
    from scipy.signal import kaiserord  # slow to import, and nodes import this file

    length, beta = kaiserord(_RIPPLE, (stopband - passband) / (rate / 2))
    half = length // 2
    time = np.arange(-half, half + 1) / rate
    return windowed_sinc(time, (passband + stopband) / 2, half / rate, beta)


def antialias(rate: float, lower: float) -> Floats:
    """Return the taps of an anti-alias filter for resampling from `rate` to `lower` Hz.

    Its passband ends at a quarter of the lower rate and its stopband begins at half of it. A
    single tap of 1 where `lower` is 90 % of `rate` or more.
    """
    return np.ones(1) if lower >= 0.9 * rate else low_pass(rate, lower / 4, lower / 2)


def gain(taps: Floats, frequency: float, rate: float) -> float:
    """Return the (signed) gain of centred taps for a sine of `frequency` Hz sampled at `rate`."""
    steps = np.arange(len(taps)) - len(taps) // 2
    return float(taps @ np.cos(2 * np.pi * frequency / rate * steps))


@cache
def smoothing(rate: float) -> Floats:
    """Return the taps of the quadratic Savitzky-Golay filter with −3 dB nearest to SMOOTHING.

    rate: of the signal, Hz. At 400 Hz, 12.18 Hz is nearest to 12.5 Hz, as windows are odd.
    """
    from scipy.signal import savgol_coeffs  # slow to import, and nodes import this file

    windows = range(5, int(2 * rate / SMOOTHING), 2)
    filters = [np.asarray(savgol_coeffs(n, _POLYORDER), np.float64) for n in windows]
    return min(filters, key=lambda taps: abs(_cutoff(taps, rate) - SMOOTHING))


def _cutoff(taps: Floats, rate: float) -> float:
    from scipy.optimize import brentq  # slow to import, and nodes import this file

    first_null = rate * 1.7 / len(taps)
    return float(
        brentq(lambda f: gain(taps, f, rate) - np.sqrt(0.5), 0, min(first_null, rate / 2))
    )


def centred(values: NDArray[Any], taps: Floats) -> Singles:
    """Filter values [N, …] along time with an odd number of symmetric taps.

    Return [N − len(taps) + 1, …]: only the times for which all taps have samples. A NaN affects
    only the outputs whose taps cover it.
    """
    half = len(taps) // 2
    if not half:
        return np.asarray(values, np.float32)

    from scipy.ndimage import correlate1d  # slow to import, and nodes import this file

    filtered = correlate1d(np.asarray(values, np.float32), taps, axis=0, mode='nearest')
    return np.asarray(filtered[half:-half], np.float32)


_LEAST_VARIANCE = 1e-4  # of the largest over all lags, below which a signal counts as constant


def masked_correlation(
    a: Floats, known_a: Floats, b: Floats, known_b: Floats, *, centred: bool = True
) -> tuple[Floats, Floats, Floats]:
    """Correlate two signals at all lags, each over the samples that both signals have.

    Signals a [A], b [B] and masks known_a, known_b are 0 where unknown; masks are 1 elsewhere.
    Returns, each [A + B − 1]: correlation, number of common samples, and lag in samples, by which
    b starts after a. `centred` removes the means over the overlap. Method: Padfield, "Masked
    object registration in the Fourier domain", IEEE TIP 2012.
    """
    size = next_fast_len(len(a) + len(b), real=True)

    def across(x: Floats, y: Floats) -> Floats:
        product: Floats = irfft(rfft(x, size) * np.conj(rfft(y, size)), size)
        return np.concatenate([product[len(product) - len(b) + 1 :], product[: len(a)]])

    count = np.maximum(np.rint(across(known_a, known_b)), 0.0)
    product, square_a, square_b = across(a, b), across(a * a, known_b), across(known_a, b * b)
    if centred:
        common = np.maximum(count, 1.0)
        sum_a, sum_b = across(a, known_b), across(known_a, b)
        product -= sum_a * sum_b / common
        square_a -= sum_a**2 / common
        square_b -= sum_b**2 / common
    least = [_LEAST_VARIANCE * max(float(x.max()), 1e-12) for x in (square_a, square_b)]
    spread = np.sqrt(np.maximum(square_a, least[0]) * np.maximum(square_b, least[1]))
    lags = np.arange(-len(b) + 1.0, len(a))
    return np.where(count > 0, product / spread, 0.0), count, lags
