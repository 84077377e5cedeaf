"""Rates of sampled signals without the noise of their sensors."""

from dataclasses import replace
from typing import Final

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects import Signals

_TAPS: Final = 64
_WINDOW: Final = np.hanning(2 * _TAPS + 1)[:-1]
_OF_BENDS: Final = 0.6745 * np.sqrt(6.0)  # median of second differences of noise of 1
_MOST: Final = 3.0  # standard deviations that are noise; beyond, the filter rounds off a step


def with_quiet_rates(signals: Signals) -> Signals:
    """Signals whose rates are those of the signals through a Wiener filter.

    Through a spring, noise of the torque comes into the motor's torque with its second rate.
    """
    velocity, noise = _denoised(signals.velocity, signals)
    acceleration = _rate(velocity, signals)
    return replace(
        signals,
        velocity_noise=np.clip(signals.velocity - velocity, -_MOST * noise, _MOST * noise),
        acceleration=acceleration,
        motor_acceleration=acceleration,
        torque_rate=_rate(_denoised(signals.torque, signals)[0], signals),
    )


def _rate(values: Floats, signals: Signals) -> Floats:
    """Time derivative [T, D] by central differences over five samples.

    An antisymmetric stencil keeps energy: the sum of w·dw telescopes. Three samples lose a tenth
    of the rate at an eighth of the sampling rate, five lose a hundredth.
    """
    out = np.zeros_like(values)
    for part in signals.stretches():
        if part.stop - part.start > 2:
            own = values[part]
            out[part] = np.gradient(own, 1.0 / signals.rate, axis=0)
            if len(own) > 4:
                near, far = own[3:-1] - own[1:-3], own[4:] - own[:-4]
                out[part][2:-2] = (8.0 * near - far) * (signals.rate / 12.0)
    return out


def _denoised(values: Floats, signals: Signals) -> tuple[Floats, Floats]:
    """Wiener filter of each signal [T, D], with its white noise's standard deviation [D].

    The spectrum's end gives the level of the noise.
    """
    deviation = np.zeros(values.shape[1])
    parts = [part for part in signals.stretches() if part.stop - part.start >= 4 * _TAPS]
    if not parts:
        return values, deviation
    out = values.copy()
    for drive in range(values.shape[1]):
        spectra = [_spectrum(values[part, drive]) for part in parts]
        power = np.average(spectra, axis=0, weights=[part.stop - part.start for part in parts])
        noise = float(np.median(power[-_TAPS // 6 :]))
        # Steps reach to the spectrum's end, and fast motion bends; the smaller of both is noise.
        bends = np.concatenate([np.diff(values[part, drive], n=2) for part in parts])
        robust = float(np.median(np.abs(bends))) / _OF_BENDS
        deviation[drive] = min(np.sqrt(noise / (2.0 * np.sum(_WINDOW**2))), robust)
        keep = np.maximum(power - noise, 0.0) / np.maximum(power, 1e-300)
        keep = np.maximum.accumulate(keep[::-1])[::-1]
        taps = np.roll(np.fft.irfft(keep), _TAPS)[_TAPS // 2 : _TAPS + _TAPS // 2 + 1]
        taps = taps * np.hanning(len(taps) + 2)[1:-1]
        if not taps.any():
            continue  # it stands still
        taps /= taps.sum()
        half = len(taps) // 2
        for part in parts:
            own = values[part, drive]
            ends = 2 * own[0] - own[half:0:-1], 2 * own[-1] - own[-2 : -half - 2 : -1]
            out[part, drive] = np.convolve(np.concatenate([ends[0], own, ends[1]]), taps, 'valid')
    return out, deviation


def _spectrum(values: Floats) -> Floats:
    """Welch's mean periodogram of a signal [n], of any scale.

    scipy's goes through the segments in Python: fifteen times as long.
    """
    segments = np.lib.stride_tricks.sliding_window_view(values, 2 * _TAPS)[::_TAPS]
    centred = segments - segments.mean(axis=1, keepdims=True)
    power = np.square(np.abs(np.fft.rfft(centred * _WINDOW))).mean(axis=0)
    power[1:-1] *= 2.0
    return np.asarray(power)
