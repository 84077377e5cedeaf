"""
Frequency weightings A, C and Z of IEC 61672-1 at any sampling rate.

Libraries were tried against the tests (class 1 at 8 to 192 kHz, filtered block by block) and miss
them. The bilinear filters of PyOctaveBand 2.0.0 (GPL-3.0), of phonometry 3.3.0 (its successor; it
needs Python 3.13), and of python-acoustics 0.2.6 (unmaintained since 2022) pass at 44.1 kHz and
above. A at 11.025 kHz is 1.9 dB low at 4 kHz (limit 1.0), at 16 kHz 5.7 dB low at 6.3 kHz (2.0),
at 22.05 kHz 4.9 dB low at 8 kHz (2.5). Oversampling in the first two removes the error, but needs
the whole file in memory. acoustic-toolbox 0.2.2 uses PyOctaveBand, pandas and numba. Neither
waveform-analysis nor pyfilterbank has a release that pip installs on Python 3.11.
"""

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfreqz
from wattwalk_core.errors import InputError

from sound_levels.levels.settings import WEIGHTINGS

Floats = NDArray[np.float64]

_F1, _F2, _F3, _F4 = 20.598997, 107.65265, 737.86223, 12194.217  # Hz, IEC 61672-1 annex E
_OFFSET = 1.0  # Hz, high-pass against the offset of a converter
_HIGH_PASS: Final = {'A': (_F1, _F1, _F2, _F3), 'C': (_F1, _F1), 'Z': (_OFFSET,)}
_REFERENCE = 1000.0  # Hz
_REACH: Final = 0.45  # of the rate, up to which class 1 is kept
_NOMINAL: Final = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)


@cache
def sections(weighting: str, rate: float) -> Floats:
    """
    Return the weighting as second-order sections [S, 6] for scipy.signal.sosfilt at a rate in Hz.

    Each real pole is matched to the analog gain up to half the rate, where the bilinear transform
    would approach 0. Z is flat except for an offset. InputError for a weighting not A, C or Z.
    """
    if weighting not in WEIGHTINGS:
        raise InputError(f'weighting {weighting!r} is not one of {", ".join(WEIGHTINGS)}')
    first = [(np.array([1.0, 0.0]), np.array([1.0, 0.0]))]
    if weighting != 'Z':
        first = [_low_pass(_F4, rate)] * 2
    first += [_high_pass(corner, rate) for corner in _HIGH_PASS[weighting]]
    rows = [
        np.concatenate([np.convolve(b1, b2), np.convolve(a1, a2)])
        for (b1, a1), (b2, a2) in zip(first[::2], first[1::2], strict=True)
    ]
    found = np.array(rows)
    found[0, :3] /= 10.0 ** (response(found, _REFERENCE, rate) / 20.0)
    return found


def response(rows: Floats, frequency: Floats | float, rate: float) -> Floats:
    """Return the gain of sections in dB at frequencies in Hz."""
    _, gain = sosfreqz(rows, np.atleast_1d(frequency), fs=rate)
    return np.asarray(20.0 * np.log10(np.abs(gain))).reshape(np.shape(frequency))


def reach(rate: float) -> float:
    """Return the highest nominal frequency in Hz up to which class 1 is met at a rate."""
    return nominal(max(n for n in range(12, 44) if 10.0 ** (n / 10.0) <= _REACH * rate))


def nominal(number: int) -> float:
    """Return the nominal frequency in Hz of a third-octave band by its number: 30 is 1 kHz."""
    return float(f'{_NOMINAL[number % 10] * 10.0 ** (number // 10):g}')


def _low_pass(corner: float, rate: float) -> tuple[Floats, Floats]:
    """
    Return a real pole with the analog squared gain at 0 Hz, in between and at half the rate.

    With u = sin²(π f / rate) it is (1 + B u) / (1 + A u), so that A and B follow from two gains.
    """
    middle = min(corner, 0.25 * rate)
    u = float(np.sin(np.pi * middle / rate) ** 2)
    g_middle, g_half = (1.0 / (1.0 + (f / corner) ** 2) for f in (middle, 0.5 * rate))
    a, b = np.linalg.solve([[g_middle * u, -u], [g_half, -1.0]], [1 - g_middle, 1 - g_half])
    pole = 1.0 + 2.0 * (1.0 - np.sqrt(1.0 + a)) / a
    total, difference = 1.0 - pole, (1.0 - pole) * np.sqrt(1.0 + b)
    return np.array([total + difference, total - difference]) / 2.0, np.array([1.0, -pole])


def _high_pass(corner: float, rate: float) -> tuple[Floats, Floats]:
    pole = np.exp(-2.0 * np.pi * corner / rate)
    at_half = (0.5 * rate / corner) / np.hypot(1.0, 0.5 * rate / corner)
    gain = at_half * (1.0 + pole) / 2.0
    return np.array([gain, -gain]), np.array([1.0, -pole])
