"""Third-octave bands (IEC 61260-1, base ten) from a running spectrum."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import get_window

Floats = NDArray[np.float64]

_NOMINAL: Final = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)
_RESOLUTION = 1.5  # Hz
_LOWEST, _HIGHEST = 14, 43  # 25 Hz to 20 kHz


class Spectrum:
    """
    Mean spectrum of a sound in blocks (Welch, Hann, half overlapping).

    Bands are rectangular parts of the power spectrum, not the filters of the standard: half of a
    tone on the edge of two bands counts in each. Filters of class 1 leak more from band to band:
    for a tone of 1 kHz, PyOctaveBand 2.0.0 (6th-order Butterworth) leaves 4.5e-4 of its power in
    other bands, where the tests allow 2e-4.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._length = 1 << int(np.ceil(np.log2(rate / _RESOLUTION)))
        self._window = get_window('hann', self._length)
        self._power = np.zeros(self._length // 2 + 1)
        self._count = 0
        self._rest: Floats | None = None

    def add(self, block: Floats) -> None:
        """Add samples [n, channels]."""
        rest = block if self._rest is None else np.concatenate([self._rest, block])
        half = self._length // 2
        while len(rest) >= self._length:
            part = rest[: self._length]
            part = (part - part.mean(axis=0)) * self._window[:, None]
            self._power += np.mean(np.abs(np.fft.rfft(part, axis=0)) ** 2, axis=1)
            self._count += 1
            rest = rest[half:]
        self._rest = rest

    def bands(self) -> dict[float, float]:
        """Return mean squares by nominal midband frequency in Hz; none for a sound under 0.7 s."""
        if not self._count:
            return {}
        density = 2.0 * self._power / (self._count * np.square(self._window).sum() * self._length)
        step = self._rate / self._length
        edges = (np.arange(len(density) + 1) - 0.5) * step
        total = np.concatenate([[0.0], np.cumsum(density)])
        found = {}
        for number in range(_LOWEST, _HIGHEST + 1):
            low, high = (10.0 ** ((number + side) / 10.0) for side in (-0.5, 0.5))
            if high > 0.5 * self._rate:
                break
            inside = np.interp([low, high], edges, total)
            found[nominal(number)] = float(inside[1] - inside[0])
        return found


def nominal(number: int) -> float:
    """Return the nominal frequency in Hz of a band by its number: 30 is 1 kHz."""
    return float(f'{_NOMINAL[number % 10] * 10.0 ** (number // 10):g}')
