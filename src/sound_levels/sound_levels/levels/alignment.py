"""Alignment of a sound with a recording: by a clap, the first step, or the gait."""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from power_recordings.alignment.filters import masked_correlation
from power_recordings.reading.reader import Recording
from scipy.ndimage import uniform_filter1d
from scipy.signal import correlate
from scipy.stats import theilslopes
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from sound_levels.levels.meter import Sound
from sound_levels.levels.settings import METHODS

RATE = 200.0  # Hz
_LANDED, _LIFTED = 40.0, 10.0  # N
_SWING = 0.05  # s, least time off the ground before a landing
_NEVER = -1e9  # s
_OUTSTANDING = 2.0  # ratio to the next largest jolt


@dataclass(frozen=True)
class Events:
    """Audible events, in s after the recording's start.

    loading: rate of increase of the feet's force, kN/s, at 200 Hz from `first` on; empty without
    foot_force. landings: times at which a foot touches down. knock: time of a single outstanding
    jolt of the IMU, else None.
    """

    seconds: float
    first: float
    loading: Floats
    landings: Floats
    knock: float | None


def events_of(recording: Recording) -> Events:
    """Find the audible events of a recording; its foot_force and imu may be absent."""
    start = recording.start_ns
    loading, landings, first = np.zeros(0), np.zeros(0), 0.0
    if recording.has('foot_force'):
        feet = recording.foot_force()
        time = (feet.stamp_ns - start) / 1e9
        force = np.nan_to_num(feet.force.astype(np.float64))
        first = float(time[0])
        grid = np.arange(time[0], time[-1], 1.0 / RATE)
        rate = np.maximum(np.gradient(force, time, axis=0), 0.0).sum(axis=1) / 1e3
        total = np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(time))])
        loading = np.diff(np.interp(grid, time, total), append=total[-1]) * RATE
        landings = np.sort(np.concatenate([_landings(time, foot) for foot in force.T]))
    knock = None
    if recording.has('imu'):
        imu = recording.imu()
        felt = np.linalg.norm(imu.linear_acceleration.astype(np.float64), axis=1)
        knock = _outstanding((imu.stamp_ns - start) / 1e9, np.abs(np.diff(felt, prepend=felt[0])))
    return Events(recording.duration, first, loading, landings, knock)


def _landings(time: Floats, force: Floats) -> Floats:
    """Return the times at which a foot is loaded after 50 ms off the ground."""
    down = np.flatnonzero((force[1:] >= _LANDED) & (force[:-1] < _LANDED)) + 1
    lifted = np.where(force <= _LIFTED, time, _NEVER)
    loaded = np.where(force > _LANDED, time, _NEVER)
    last_lifted = np.maximum.accumulate(lifted)
    last_loaded = np.maximum.accumulate(loaded)
    found = [t for t in down.tolist() if last_lifted[t - 1] - last_loaded[t - 1] >= _SWING]
    return time[found]


def _outstanding(time: Floats, jolt: Floats) -> float | None:
    """Return the time of the largest jolt if twice as large as any 0.5 s away from it."""
    peak = int(np.argmax(jolt))
    others = jolt[np.abs(time - time[peak]) > _SEPARATION]
    if not len(others) or jolt[peak] < _OUTSTANDING * max(float(others.max()), 1e-9):
        return None
    return float(time[peak])


_FLOOR = 1e-14
_CLAP = 12.0  # dB of a clap over the level before it
_UNIQUE = 6.0  # dB over the next largest peak
_SEPARATION = 0.5  # s
_STEP = 10.0  # dB over the background
_BACKGROUND = 1.0  # s
_OVERLAP = 5.0  # s
_LEAST_CORRELATION, _AMBIGUOUS = 0.25, 0.9
_CORRECTION = 0.15  # s by which the gait may correct a clap
_PIECE = 20.0  # s
_LARGEST_DRIFT = 500.0  # ppm


@dataclass(frozen=True)
class Alignment:
    """Mapping of a sound's t to offset + t · (1 + drift · 1e-6) s after the recording's start.

    correlation: of the sound's level with the loading of the feet, NaN if not known. rival: the
    next best correlation relative to it; near 1 the offset may be whole strides off.
    """

    method: str
    offset: float
    drift: float
    correlation: float
    rival: float
    notes: tuple[str, ...] = ()

    def of(self, time: Floats) -> Floats:
        """Convert times of the sound, s, to s after the recording's start."""
        return np.asarray(self.offset + time * (1.0 + 1e-6 * self.drift))


def align_sound(
    sound: Sound, events: Events, method: str = 'auto', clap_at: float | None = None
) -> Alignment | None:
    """Align a sound with a recording; None for the method `none`, or where `auto` fails.

    `clap` aligns the outstanding impulse of the sound with the outstanding jolt of the IMU, or
    with clap_at [s after the recording's start]; `step` the first sound over the background with
    the first landing; `gait` correlates the level with the loading of the feet. `auto` uses the
    first of clap, gait and step that succeeds. InputError where the method asked for fails.
    """
    if method not in METHODS:
        raise InputError(f'alignment {method!r} is not one of {", ".join(METHODS)}')
    if method == 'none':
        return None
    ways = {'clap': _by_clap, 'gait': _by_gait, 'step': _by_step}
    if method != 'auto':
        return _refined(ways[method](sound, events, clap_at), sound, events)
    for way in ways.values():
        with suppress(InputError):
            return _refined(way(sound, events, clap_at), sound, events)
    return None


def _by_clap(sound: Sound, events: Events, clap_at: float | None) -> Alignment:
    at = events.knock if clap_at is None else clap_at
    if at is None:
        raise InputError(
            'the recording has no single jolt of the IMU that a clap could be: say when it was '
            'with --clap-at S, or align by gait'
        )
    level = _clap(sound)
    if level is None:
        raise InputError('the sound has no impulse that stands out as a clap: align by gait')
    return Alignment('clap', at - level, 0.0, np.nan, np.nan)


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
    lags, values = _correlation(*_high_passed_signals(sound, events))
    if not len(lags):
        raise InputError('sound and foot_force overlap by less than 5 s: align by clap')
    best = int(np.argmax(values))
    if values[best] < _LEAST_CORRELATION:
        raise InputError(
            f'level and foot_force correlate by {values[best]:.2f} only: align by clap'
        )
    away = np.abs(lags - lags[best]) > 0.1
    rival = float(values[away].max(initial=0.0) / values[best])
    notes: tuple[str, ...] = ()
    if rival > _AMBIGUOUS:
        other = float(lags[away][int(np.argmax(values[away]))] - lags[best])
        notes = (f'nearly as good {other:+.2f} s away: clap once to be sure',)
    offset = _vertex(lags, values, best) + events.first
    return Alignment('gait', offset, 0.0, float(values[best]), rival, notes)


def _refined(found: Alignment, sound: Sound, events: Events) -> Alignment:
    """Return the alignment with offset and clock drift corrected by the gait near it."""
    shapes = _high_passed_signals(sound, events)
    lags, values = _correlation(*shapes)
    if not len(lags):
        return found
    near = np.abs(lags + events.first - found.offset) <= _CORRECTION
    if not near.any():
        return found
    best = int(np.argmax(np.where(near, values, -np.inf)))
    if values[best] < _LEAST_CORRELATION:
        note = f'the gait does not confirm it (correlation {values[best]:.2f})'
        return replace(found, correlation=float(values[best]), notes=(*found.notes, note))
    lag, drift = _drift(*shapes, _vertex(lags, values, best))
    offset = lag + events.first
    return replace(found, offset=offset, drift=drift, correlation=float(values[best]))


def _high_passed_signals(sound: Sound, events: Events) -> tuple[Floats, Floats]:
    """Return level and loading at 200 Hz without their slow parts."""
    if len(events.loading) < 2:
        return np.zeros(0), np.zeros(0)
    grid = np.arange(sound.time[0], sound.time[-1], 1.0 / RATE)
    level = np.interp(grid, sound.time, _level(sound))
    loading = 10.0 * np.log10(np.square(_smooth(events.loading, 3)) + 1.0)
    level = np.maximum(level, np.median(level) - 10.0)
    return level - _smooth(level, round(RATE)), loading - _smooth(loading, round(RATE))


def _smooth(values: Floats, length: int) -> Floats:
    """Mean of `length` samples around each, of fewer at the ends."""
    total, count = (
        uniform_filter1d(of, length, mode='constant') for of in (values, np.ones_like(values))
    )
    return np.asarray(total / count)


def _correlation(level: Floats, loading: Floats) -> tuple[Floats, Floats]:
    """Lags in s, at which the sound's start would lie, and the correlation there."""
    least = round(_OVERLAP * RATE)
    if min(len(level), len(loading)) < least:
        return np.zeros(0), np.zeros(0)
    masks = np.ones_like(loading), np.ones_like(level)
    values, shared, lags = masked_correlation(loading, masks[0], level, masks[1], centred=False)
    half = max(least, 0.3 * min(len(level), len(loading)))
    enough = shared >= half - 0.5
    return lags[enough] / RATE, values[enough]


def _vertex(lags: Floats, values: Floats, best: int) -> float:
    """Return the vertex of a parabola through a peak and its neighbours, s."""
    if not 0 < best < len(values) - 1:
        return float(lags[best])
    left, middle, right = values[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float(lags[best] + np.clip(shift, -0.5, 0.5) / RATE)


def _drift(level: Floats, loading: Floats, lag: float) -> tuple[float, float]:
    """Return the lag at the sound's start in s and the drift in ppm, from pieces of 20 s."""
    piece, near = round(_PIECE * RATE), round(_CORRECTION * RATE)
    times, lags = [], []
    for start in range(0, len(level) - piece + 1, piece // 2):
        first = round(start + lag * RATE) - near
        if first < 0 or first + piece + 2 * near > len(loading):
            continue
        own, other = level[start : start + piece], loading[first : first + piece + 2 * near]
        values = correlate(other, own, 'valid', method='fft')
        best = int(np.argmax(values))
        norm = np.linalg.norm(own) * np.linalg.norm(other[best : best + piece])
        if 0 < best < len(values) - 1 and values[best] > _LEAST_CORRELATION * norm > 0:
            steps = np.arange(len(values)) / RATE
            lags.append((first - start) / RATE + _vertex(steps, values, best))
            times.append((start + piece / 2) / RATE)
    if len(times) < 4:
        return lag, 0.0
    slope, intercept, *_ = theilslopes(lags, times)
    if abs(slope) > 1e-6 * _LARGEST_DRIFT:
        return lag, 0.0
    return float(intercept), float(1e6 * slope)


def _level(sound: Sound) -> Floats:
    return np.asarray(10.0 * np.log10(sound.energy + _FLOOR))


def _clap(sound: Sound) -> float | None:
    """Return the time of the single outstanding impulse of a sound, s; None without."""
    energy, time = sound.energy, sound.time
    peak = int(np.argmax(energy))
    others = energy[np.abs(time - time[peak]) > _SEPARATION]
    before = energy[max(0, peak - round(0.1 / sound.step)) : max(0, peak - 1)]
    if not len(others) or not len(before):
        return None
    if energy[peak] < 10.0 ** (_UNIQUE / 10.0) * others.max():
        return None
    rise = np.flatnonzero(energy[: peak + 1] < 0.1 * energy[peak])
    if energy[peak] < 10.0 ** (_CLAP / 10.0) * np.median(before) or not len(rise):
        return None
    return float(time[rise[-1]] + 0.5 * sound.step)
