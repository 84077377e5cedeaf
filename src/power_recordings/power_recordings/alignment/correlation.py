"""Correlation of two signals over all lags, where samples of both are known."""

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

Floats = NDArray[np.float64]
_LEAST_VARIANCE = 1e-4  # of the largest over all lags, below which a signal counts as constant


def masked_correlation(
    a: Floats, known_a: Floats, b: Floats, known_b: Floats, *, centred: bool = True
) -> tuple[Floats, Floats, Floats]:
    """
    Return correlation, number of common samples and lag of b behind a's start, for all lags.

    Signals [A] and [B] are 0 and masks 0 where unknown, masks 1 elsewhere. Not `centred`, the
    means over the overlap are not removed. Method: Padfield, "Masked object registration in the
    Fourier domain", IEEE TIP 2012.
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
