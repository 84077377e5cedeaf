"""Sound level meter: levels over time from blocks of samples, in constant memory."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from scipy.signal import get_window, lfilter, sosfilt, sosfilt_zi, sosfreqz
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from sound_levels.levels.settings import TIMES, WEIGHTINGS

_F1, _F2, _F3, _F4 = 20.598997, 107.65265, 737.86223, 12194.217  # Hz, IEC 61672-1 annex E
_OFFSET = 1.0  # Hz, high-pass against the offset of a converter
_HIGH_PASS: Final = {'A': (_F1, _F1, _F2, _F3), 'C': (_F1, _F1), 'Z': (_OFFSET,)}
_REFERENCE = 1000.0  # Hz
_REACH: Final = 0.45  # of the rate, up to which class 1 is kept
_NOMINAL: Final = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)


@cache
def sections(weighting: str, rate: float) -> Floats:
    """Return a frequency weighting as sections [S, 6] for scipy.signal.sosfilt at a rate in Hz.

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
    """Return the gain of `sections` in dB at frequencies in Hz; rate: of sampling, Hz."""
    _, gain = sosfreqz(rows, np.atleast_1d(frequency), fs=rate)
    return np.asarray(20.0 * np.log10(np.abs(gain))).reshape(np.shape(frequency))


def reach(rate: float) -> float:
    """Return the highest nominal frequency in Hz up to which class 1 is met at a rate."""
    return nominal(max(n for n in range(12, 44) if 10.0 ** (n / 10.0) <= _REACH * rate))


def nominal(number: int) -> float:
    """Return the nominal frequency in Hz of a third-octave band by its number: 30 is 1 kHz."""
    return float(f'{_NOMINAL[number % 10] * 10.0 ** (number // 10):g}')


def _low_pass(corner: float, rate: float) -> tuple[Floats, Floats]:
    """Return a real pole with the analog squared gain at 0 Hz, in between and at half the rate.

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


_RESOLUTION = 1.5  # Hz
_LOWEST, _HIGHEST = 14, 43  # 25 Hz to 20 kHz


class Spectrum:
    """Mean spectrum of a sound in blocks (Welch, Hann, half overlapping).

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


SETTLED: Final = 5.0  # time constants until the detector no longer depends on its start
_BINS = 200.0  # Hz
_SILENCE = 1e-18


@dataclass(frozen=True)
class Sound:
    """Mean squares of a sound in units of full scale, in N bins of `step` s from its start.

    energy: of the weighted signal in each bin. detector: at the end of each bin, with the time
    weighting; highest: its largest value within the bin. bands: mean square in third-octave bands
    of the unweighted signal, by nominal frequency in Hz. Channels are averaged.
    """

    rate: float  # Hz
    step: float  # s
    energy: Floats  # [N]
    detector: Floats  # [N]
    highest: Floats  # [N]
    bands: dict[float, float]

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return len(self.energy) * self.step

    @property
    def time(self) -> Floats:
        """Middle of each bin, s after the start [N]."""
        return np.asarray((np.arange(len(self.energy)) + 0.5) * self.step)


def measure(
    blocks: Iterable[Floats], rate: float, weighting: str = 'A', time: str = 'fast'
) -> Sound:
    """Measure the levels of consecutive blocks of samples [n, channels], full scale 1.

    InputError for an unknown weighting or time weighting, less than ten time constants (and at
    least 1 s) of sound, or silence.
    """
    if time not in TIMES:
        raise InputError(f'time weighting {time!r} is not one of {", ".join(TIMES)}')
    rows, tau = sections(weighting, rate), TIMES[time]
    decay = float(np.exp(-1.0 / (rate * tau)))
    length = round(rate / _BINS)
    spectrum = Spectrum(rate)
    state: Floats | None = None
    level = np.zeros(1)
    rest = np.zeros((2, 0))
    found: list[Floats] = []  # energy, detector and highest of bins, [3, n]
    count = 0
    for block in blocks:
        if state is None:
            state = sosfilt_zi(rows)[:, :, None] * block[0]
        weighted, state = sosfilt(rows, block, axis=0, zi=state)
        spectrum.add(block)
        squares = np.mean(np.square(weighted), axis=1)
        held, level = lfilter([1.0 - decay], [1.0, -decay], squares, zi=level)
        count += len(held)
        rest = np.concatenate([rest, [squares, held]], axis=1)
        whole = rest.shape[1] // length * length
        power, levels = rest[:, :whole].reshape(2, -1, length)
        # Copies: a view would keep every sample.
        found.append(np.stack([power.mean(axis=1), levels[:, -1], levels.max(axis=1)]))
        rest = rest[:, whole:]
    least = max(1.0, 2.0 * SETTLED * tau)
    if count < least * rate:
        raise InputError(
            f'{count / rate:.2f} s are too short: {time} levels need {least:g} s of sound at least'
        )
    energy, detector, highest = np.concatenate(found, axis=1)
    if float(energy.mean()) < _SILENCE:
        raise InputError('silent from start to end: was the microphone connected?')
    return Sound(
        rate=rate,
        step=length / rate,
        energy=energy,
        detector=detector,
        highest=highest,
        bands=spectrum.bands(),
    )
