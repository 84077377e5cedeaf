"""Level of full scale from the recording of an acoustic calibrator."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from sound_levels.levels.sound_file import SoundFile

Floats = NDArray[np.float64]

_WINDOW = 0.5  # s
_LONGEST = 120.0  # s, searched for a tone
_STEADY = 0.5  # dB around the median level
_NEEDED = 2.0  # s
_PURE = 0.9  # least share of the tone in the power above 200 Hz
_LOWEST = 200.0  # Hz
_ALIKE = 3.0  # dB between the channels


@dataclass(frozen=True)
class CalibratorTone:
    """
    Recorded tone of a calibrator.

    frequency: Hz. mean_square: of the tone alone, in units of full scale. spread: standard
    deviation of its level over half seconds, dB. seconds: steady duration.
    """

    rate: int
    frequency: float
    mean_square: float
    spread: float
    seconds: float
    level: float  # dB SPL that the calibrator makes

    def decibels(self, mean_square: Floats | float) -> Floats:
        """Return sound pressure levels, dB re 20 µPa, of mean squares in units of full scale."""
        return np.asarray(10.0 * np.log10(np.asarray(mean_square) / self.mean_square) + self.level)


def read_tone(file: SoundFile, level: float, frequency: float = 1000.0) -> CalibratorTone:
    """
    Find the steady tone in a recording of a calibrator of a level in dB SPL.

    InputError if there is none within 10 % of the frequency in Hz for 2 s, if it is clipped, or if
    the channels differ by more than 3 dB (only one was in the calibrator).
    """
    length = round(_WINDOW * file.rate)
    rest: Floats | None = None
    powers: list[Floats] = []
    shares: list[float] = []
    pitches: list[float] = []
    for block in file.blocks():
        rest = block if rest is None else np.concatenate([rest, block])
        while len(rest) >= length and len(powers) * _WINDOW < _LONGEST:
            power, share, pitch = _tone_in(rest[:length], file.rate, frequency)
            powers.append(power)
            shares.append(share)
            pitches.append(pitch)
            rest = rest[length:]
    if file.clipped:
        raise InputError(f'{file.path}: the calibrator is clipped; record it again with less gain')
    if not powers:
        raise InputError(f'{file.path} is too short: record the calibrator for 10 s')
    by_channel = np.array(powers)
    total = by_channel.mean(axis=1)
    pure = (np.array(shares) >= _PURE) & (total > 0)
    if pure.sum() * _WINDOW < _NEEDED:
        raise InputError(
            f'{file.path} holds no pure tone of {frequency:g} Hz for {_NEEDED:g} s '
            f'({pure.sum() * _WINDOW:g} s found); is the calibrator on the microphone?'
        )
    levels = np.full(len(total), -np.inf)
    levels[pure] = 10.0 * np.log10(total[pure])
    steady = np.abs(levels - np.median(levels[pure])) <= _STEADY
    if steady.sum() * _WINDOW < _NEEDED:
        raise InputError(
            f'{file.path}: the tone is not steady to {_STEADY:g} dB for {_NEEDED:g} s'
        )
    means = 10.0 * np.log10(np.maximum(by_channel[steady].mean(axis=0), 1e-30))
    if np.ptp(means) > _ALIKE:
        best = int(np.argmax(means)) + 1
        raise InputError(
            f'{file.path}: the tone is {np.ptp(means):.0f} dB louder on channel {best}; '
            f'choose it with --channel {best}'
        )
    return CalibratorTone(
        rate=file.rate,
        frequency=float(np.median(np.array(pitches)[steady])),
        mean_square=float(total[steady].mean()),
        spread=float(levels[steady].std()),
        seconds=float(steady.sum() * _WINDOW),
        level=level,
    )


def _tone_in(part: Floats, rate: int, frequency: float) -> tuple[Floats, float, float]:
    """Return the tone's mean square by channel, its share of power above 200 Hz, and frequency."""
    window = np.hanning(len(part))
    spectrum = np.abs(np.fft.rfft((part - part.mean(axis=0)) * window[:, None], axis=0)) ** 2
    spectrum *= 2.0 / (np.square(window).sum() * len(part))
    pitch = np.fft.rfftfreq(len(part), 1.0 / rate)
    near = np.abs(pitch - frequency) <= 0.1 * frequency
    summed = spectrum.sum(axis=1)
    peak = int(np.argmax(np.where(near, summed, -1.0)))
    tone = slice(max(0, peak - 8), peak + 9)
    audible = float(summed[pitch >= min(_LOWEST, 0.5 * frequency)].sum())
    share = float(summed[tone].sum()) / audible if audible > 0 else 0.0
    return spectrum[tone].sum(axis=0), share, float(pitch[peak])
