"""Phase of a motion that repeats itself, estimated from the positions of the joints."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.signals.reducer import REDUCED_RATE
from wattwalk_core.arrays import Singles

_SHORTEST = 0.16  # s of a period
_LONGEST = 4.0
_ALIKE = 0.5  # least correlation of the positions with those of a period before
_AS_GOOD = 0.92  # share of the best correlation, at which a shorter period is taken
_BAND = 0.3  # of the stride's frequency, standard deviation of the filter
_STILL = 0.25  # share of the usual amplitude, below which there is no stride
_FEWEST = 5  # periods


@dataclass(frozen=True)
class StridePhase:
    """Phase from 0 to 1 of each row [N], NaN where nothing strides; or the reason for none."""

    phase: Singles | None
    period: float  # s
    drive: int  # whose position is largest at phase 0
    reason: str = ''


def stride_phase(position: Singles, slots: NDArray[np.int64]) -> StridePhase:
    """Find the period at which positions rad [N, D] on slots of 20 ms repeat, and the phase in it.

    The period is the shortest whose correlation is about the best; the phase is that of the
    drive that repeats with the largest amplitude, in a band about the frequency, so that it
    follows a cadence that changes.
    """
    if not len(slots):
        return StridePhase(None, 0.0, 0, 'there is no position')
    spread = _on_slots(position, slots)
    longest = min(round(_LONGEST * REDUCED_RATE), len(spread) // _FEWEST)
    shortest = round(_SHORTEST * REDUCED_RATE)
    if longest <= shortest + 2 or not spread.any():
        return StridePhase(None, 0.0, 0, 'the recording is too short, or nothing moves in it')
    each = _correlations(spread, longest + 1)
    total = each.sum(axis=1) / max(float(each[0].sum()), 1e-12)
    inner = total[shortest : longest + 1]
    peaks = shortest + 1 + np.flatnonzero((inner[1:-1] >= inner[:-2]) & (inner[1:-1] > inner[2:]))
    best = float(total[peaks].max()) if len(peaks) else 0.0
    if best < _ALIKE:
        return StridePhase(
            None, 0.0, 0, 'the motion does not repeat itself, so that there is no stride'
        )
    lag = int(peaks[total[peaks] >= _AS_GOOD * best][0])
    drive = int(np.argmax(each[lag]))
    wave = _band(spread[:, drive], 1.0 / lag)[slots]
    phase = (np.angle(wave) / (2 * np.pi)) % 1.0
    size = np.abs(wave)
    phase[size < _STILL * np.median(size)] = np.nan
    return StridePhase(phase.astype(np.float32), lag / REDUCED_RATE, drive)


def _on_slots(position: Singles, slots: NDArray[np.int64]) -> NDArray[np.float64]:
    """Positions without their means [length, D]; zero in the gaps."""
    known = np.isfinite(position)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, position, 0.0).sum(axis=0, dtype=np.float64) / count
    out = np.zeros((int(slots[-1]) + 1, position.shape[1]))
    out[slots] = np.where(known, position - mean, 0.0)
    return out


def _correlations(values: NDArray[np.float64], lags: int) -> NDArray[np.float64]:
    """Autocovariance of each column at lags 0 to lags − 1, [lags, D]."""
    size = 1 << (len(values) + lags).bit_length()
    spectra = np.fft.rfft(values, size, axis=0)
    found: NDArray[np.float64] = np.fft.irfft(np.abs(spectra) ** 2, size, axis=0)[:lags]
    return found


def _band(values: NDArray[np.float64], frequency: float) -> NDArray[np.complex128]:
    """Analytic signal in a band about a frequency (cycles a sample)."""
    size = 1 << len(values).bit_length()
    spectrum = np.fft.fft(values, size)
    at = np.fft.fftfreq(size)
    weight = np.exp(-0.5 * ((at - frequency) / (_BAND * frequency)) ** 2) * (at > 0)
    return 2.0 * np.fft.ifft(spectrum * weight)[: len(values)]
