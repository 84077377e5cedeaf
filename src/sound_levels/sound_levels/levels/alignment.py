"""Where a sound lies on the time of a recording: by a clap, the first step, or the gait."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.correlation import masked_correlation
from scipy.signal import correlate
from scipy.stats import theilslopes
from wattwalk_core.errors import InputError

from sound_levels.levels.events import RATE, Events
from sound_levels.levels.meter import Sound

Floats = NDArray[np.float64]

METHODS: Final = ('auto', 'clap', 'step', 'gait', 'none')
_FLOOR = 1e-14
_CLAP = 12.0  # dB that a clap stands over what came before and over every other onset's half
_UNIQUE = 6.0  # dB over the next largest peak
_APART = 0.5  # s
_STEP = 10.0  # dB over the background
_BACKGROUND = 1.0  # s
_OVERLAP = 5.0  # s
_SURE, _CLEAR = 0.25, 0.9
_NEAR = 0.15  # s by which the gait may correct a clap
_PIECE = 20.0  # s
_DRIFTS = 500.0  # ppm at most


@dataclass(frozen=True)
class Alignment:
    """
    A sound's time t lies at offset + t · (1 + drift · 1e-6) s after the recording's start.

    correlation: of the sound's level with the loading of the feet there, NaN if not known. clear:
    its nearest rival elsewhere, relative to it; towards 1 the offset may be whole strides off.
    """

    method: str
    offset: float
    drift: float
    correlation: float
    rival: float
    notes: tuple[str, ...] = ()

    def of(self, time: Floats) -> Floats:
        """Times of the sound as times of the recording."""
        return np.asarray(self.offset + time * (1.0 + 1e-6 * self.drift))


def align_sound(
    sound: Sound, events: Events, method: str = 'auto', clap_at: float | None = None
) -> Alignment | None:
    """
    Lay a sound on a recording; None for the method `none`, or where `auto` finds nothing.

    `clap` lays the outstanding impulse of the sound on the outstanding jolt of the IMU, or on
    clap_at [s after the recording's start]; `step` the first sound over the background on the
    first landing; `gait` the level's ups and downs on those of the feet's loading. `auto` takes
    the first of clap, gait and step that works. InputError where the method asked for does not.
    """
    if method not in METHODS:
        raise InputError(f'alignment {method!r} is not one of {", ".join(METHODS)}')
    if method == 'none':
        return None
    ways = {'clap': _by_clap, 'gait': _by_gait, 'step': _by_step}
    wanted = list(ways) if method == 'auto' else [method]
    refused = []
    for name in wanted:
        try:
            found = ways[name](sound, events, clap_at)
        except InputError as error:
            refused.append(str(error))
            continue
        return _refined(found, sound, events)
    if method == 'auto':
        return None
    raise InputError(refused[0])


def _by_clap(sound: Sound, events: Events, clap_at: float | None) -> Alignment:
    at = events.knock if clap_at is None else clap_at
    if at is None:
        raise InputError(
            'the recording has no single jolt of the IMU that a clap could be: say when it was '
            'with --clap-at S, or align by gait'
        )
    heard = _clap(sound)
    if heard is None:
        raise InputError('the sound has no impulse that stands out as a clap: align by gait')
    return Alignment('clap', at - heard, 0.0, np.nan, np.nan)


def _by_step(sound: Sound, events: Events, clap_at: float | None) -> Alignment:
    if not len(events.landings):
        raise InputError('the recording has no landing of a foot: align by clap')
    level = _level(sound)
    quiet = max(1, round(_BACKGROUND / sound.step))
    over = level > np.median(level[:quiet]) + _STEP
    if not over.any() or over[:quiet].any():
        raise InputError('the sound does not begin with a second of quiet: align by clap or gait')
    first = float(sound.time[int(np.argmax(over))])
    return Alignment('step', float(events.landings[0]) - first, 0.0, np.nan, np.nan)


def _by_gait(sound: Sound, events: Events, clap_at: float | None) -> Alignment:
    lags, values = _correlation(*_shapes(sound, events))
    if not len(lags):
        raise InputError('sound and foot_force overlap by less than 5 s: align by clap')
    best = int(np.argmax(values))
    if values[best] < _SURE:
        raise InputError(
            f'level and foot_force correlate by {values[best]:.2f} only: align by clap'
        )
    away = np.abs(lags - lags[best]) > 0.1
    rival = float(values[away].max(initial=0.0) / values[best])
    notes: tuple[str, ...] = ()
    if rival > _CLEAR:
        other = float(lags[away][int(np.argmax(values[away]))] - lags[best])
        notes = (f'nearly as good {other:+.2f} s away: clap once to be sure',)
    offset = _vertex(lags, values, best) + events.first
    return Alignment('gait', offset, 0.0, float(values[best]), rival, notes)


def _refined(found: Alignment, sound: Sound, events: Events) -> Alignment:
    """With what the gait says near the offset: a correction, and the drift of the clocks."""
    shapes = _shapes(sound, events)
    lags, values = _correlation(*shapes)
    if not len(lags):
        return found
    near = np.abs(lags + events.first - found.offset) <= _NEAR
    if not near.any():
        return found
    best = int(np.argmax(np.where(near, values, -np.inf)))
    if values[best] < _SURE:
        note = f'the gait does not confirm it (correlation {values[best]:.2f})'
        return replace(found, correlation=float(values[best]), notes=(*found.notes, note))
    offset = _vertex(lags, values, best) + events.first
    offset, drift = _drift(*shapes, offset - events.first)
    return replace(
        found,
        offset=offset + events.first,
        drift=drift,
        correlation=float(values[best]),
    )


def _shapes(sound: Sound, events: Events) -> tuple[Floats, Floats]:
    """Ups and downs of level and loading at 200 Hz."""
    if len(events.loading) < 2:
        return np.zeros(0), np.zeros(0)
    grid = np.arange(sound.time[0], sound.time[-1], 1.0 / RATE)
    heard = np.interp(grid, sound.time, _level(sound))
    felt = 10.0 * np.log10(np.square(_smooth(events.loading, 3)) + 1.0)
    return _ups(np.maximum(heard, np.median(heard) - 10.0)), _ups(felt)


def _ups(level: Floats) -> Floats:
    wide = round(RATE)
    return level - _smooth(level, min(wide, len(level)))


def _smooth(values: Floats, length: int) -> Floats:
    total = np.cumsum(np.concatenate([[0.0], values]))
    index = np.arange(len(values))
    low = np.clip(index - length // 2, 0, len(values))
    high = np.clip(index + (length + 1) // 2, 0, len(values))
    return np.asarray((total[high] - total[low]) / np.maximum(high - low, 1))


def _correlation(heard: Floats, felt: Floats) -> tuple[Floats, Floats]:
    """Lags in s, at which the sound's start would lie, and the correlation there."""
    least = round(_OVERLAP * RATE)
    if min(len(heard), len(felt)) < least:
        return np.zeros(0), np.zeros(0)
    masks = np.ones(len(felt)), np.ones(len(heard))
    values, shared, lags = masked_correlation(felt, masks[0], heard, masks[1], centred=False)
    half = max(least, 0.3 * min(len(heard), len(felt)))
    enough = shared >= half - 0.5
    return lags[enough] / RATE, values[enough]


def _vertex(lags: Floats, values: Floats, best: int) -> float:
    """The top of a parabola through a peak and its neighbours, s."""
    if not 0 < best < len(values) - 1:
        return float(lags[best])
    left, middle, right = values[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float(lags[best] + np.clip(shift, -0.5, 0.5) / RATE)


def _drift(heard: Floats, felt: Floats, lag: float) -> tuple[float, float]:
    """Lag at the sound's start in s and drift in ppm, from pieces of 20 s."""
    piece, near = round(_PIECE * RATE), round(_NEAR * RATE)
    times, lags = [], []
    for start in range(0, len(heard) - piece + 1, piece // 2):
        first = round(start + lag * RATE) - near
        if first < 0 or first + piece + 2 * near > len(felt):
            continue
        other = felt[first : first + piece + 2 * near]
        values = correlate(other, heard[start : start + piece], 'valid', method='fft')
        best = int(np.argmax(values))
        norm = np.linalg.norm(heard[start : start + piece])
        norm *= np.linalg.norm(other[best : best + piece])
        if 0 < best < len(values) - 1 and values[best] > _SURE * norm > 0:
            steps = np.arange(len(values)) / RATE
            lags.append((first - start) / RATE + _vertex(steps, values, best))
            times.append((start + piece / 2) / RATE)
    if len(times) < 4:
        return lag, 0.0
    slope, intercept, *_ = theilslopes(lags, times)
    if abs(slope) > 1e-6 * _DRIFTS:
        return lag, 0.0
    return float(intercept), float(1e6 * slope)


def _level(sound: Sound) -> Floats:
    return np.asarray(10.0 * np.log10(sound.energy + _FLOOR))


def _clap(sound: Sound) -> float | None:
    """The time of the one impulse that stands out of a sound, s; None without."""
    energy, time = sound.energy, sound.time
    peak = int(np.argmax(energy))
    others = energy[np.abs(time - time[peak]) > _APART]
    before = energy[max(0, peak - round(0.1 / sound.step)) : max(0, peak - 1)]
    if not len(others) or not len(before):
        return None
    if energy[peak] < 10.0 ** (_UNIQUE / 10.0) * others.max():
        return None
    rise = np.flatnonzero(energy[: peak + 1] < 0.1 * energy[peak])
    if energy[peak] < 10.0 ** (_CLAP / 10.0) * np.median(before) or not len(rise):
        return None
    return float(time[rise[-1]] + 0.5 * sound.step)
