"""One drive of a recording against an analyser's log: time, channels, bandwidth, errors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from power_calibration.analyser.bandwidth import Loss, Response, loss, response
from power_calibration.analyser.curve import Curve
from power_calibration.analyser.fit import Fit, Value, with_folds
from power_calibration.analyser.log import Log
from power_calibration.analyser.measured import Measured
from power_calibration.analyser.pairing import Pair, one, paired, some
from power_calibration.analyser.search import RATE, Match, search

Floats = NDArray[np.float64]
_FIT_RATE = 100.0  # Hz
_ERROR_RATE = 400.0  # Hz, at which the aligned dataset has it
_SLOWEST = 20.0  # Hz
_SLOW = 500.0  # Hz, under which rows are tried as means over their period too
_LEAST_CORRELATION = 0.6
_LEAST_FITTED = 0.9  # of the better channel, once fitted
_NEARLY = 0.05  # of correlation, within which other places are tried
_ALIKE = 1.1  # ratio of the noise within which they are as good
_GAINS = (0.5, 2.0)
_FOLDED = 5e-4  # of a gain, from which on it is told


@dataclass(frozen=True)
class Channel:
    """Correction of a channel: true = gain · measured + offset."""

    gain: Value
    offset: Value
    noise: float  # V or A, of what remains
    fixed: bool  # offset 0, for the recording cannot tell it from the gain


@dataclass(frozen=True)
class Comparison:
    """What the reference says of a recording; times of the log are `log.start` + its own."""

    measured: Measured
    log: Log
    channels: dict[str, Channel]  # voltage, current
    fit: Fit
    correlation: float
    overlap: float  # s
    ambiguous: tuple[float, ...]  # s, other offsets that fit as well, from the one chosen
    rows_are_means: bool
    before: float  # W, RMS error of power as recorded
    after: float  # W, with the corrections
    mean_before: float  # W
    mean_after: float  # W
    error_rate: float  # Hz, at which the errors were taken
    response: Response | None
    loss: Loss | None
    notes: tuple[str, ...]

    @property
    def correction(self) -> tuple[Floats, Floats]:
        """Gains and offsets of voltage and current; 1 and 0 where nothing was fitted."""
        gain, offset = np.ones(2), np.zeros(2)
        for place, name in enumerate(('voltage', 'current')):
            if name in self.channels:
                gain[place] = self.channels[name].gain.value
                offset[place] = self.channels[name].offset.value
        return gain, offset

    @property
    def time_offset(self) -> Value:
        """What is added to the log's time [s] in the middle of the overlap to make it ROS time."""
        shift = self.measured.start_ns / 1e9 - self.log.start
        o = self.fit.offset
        return Value(shift + o.value, shift + o.low, shift + o.high)

    @property
    def drift_ppm(self) -> Value:
        """How much too fast the analyser's clock runs against ROS time."""
        d = self.fit.drift
        return Value(1e6 * d.value, 1e6 * d.low, 1e6 * d.high)

    def json(self) -> dict[str, Any]:
        """The result as `calibrate --json` writes it."""
        middle = self.fit.clock.centre + self.log.start
        content: dict[str, Any] = {
            'recording': str(self.measured.path),
            'reference': str(self.log.path),
            'drive': self.measured.drive,
            'channels': {
                f'{self.measured.drive}.{name}': {
                    'gain': channel.gain.value,
                    'gain_interval': channel.gain.interval,
                    'offset': channel.offset.value,
                    'offset_interval': channel.offset.interval,
                    'offset_fixed': channel.fixed,
                    'noise': channel.noise,
                }
                for name, channel in self.channels.items()
            },
            'time_offset': self.time_offset.value,
            'time_offset_interval': self.time_offset.interval,
            'time_offset_at': middle,
            'time_offset_ambiguous': list(self.ambiguous),
            'drift_ppm': self.drift_ppm.value,
            'drift_ppm_interval': self.drift_ppm.interval,
            'rmse_before_w': self.before,
            'rmse_after_w': self.after,
            'bias_before_w': self.mean_before,
            'bias_after_w': self.mean_after,
            'error_rate_hz': self.error_rate,
            'correlation': self.correlation,
            'overlap_s': self.overlap,
            'blocks': self.fit.blocks,
            'rows_are_means': self.rows_are_means,
            'bandwidth': None,
            'notes': list(self.notes),
        }
        if self.response is not None:
            cutoff = self.response.cutoff
            content['bandwidth'] = {
                'minus_3db_hz': None if cutoff is None else cutoff.value,
                'interval': None if cutoff is None else cutoff.interval,
                'coherent_to_hz': self.response.reach,
            }
            if self.loss is not None:
                content['bandwidth'] |= {
                    'lost_above_hz': self.loss.above,
                    'lost_rms_w': self.loss.rms,
                    'alternating_rms_w': self.loss.total,
                    'lost_mean_w': self.loss.mean,
                }
        return content


def compare(
    measured: Measured, log: Log, progress: Callable[[str], None] = lambda text: None
) -> Comparison:
    """
    Align a log with a recording and say what its channels are off by.

    InputError where they do not overlap or correlate, with the best correlation that was found,
    and for gains outside 0.5..2, which are another unit.
    """
    if log.rate < _SLOWEST:
        raise InputError(
            f'{log.path} has {log.rate:.3g} rows a second; at least {_SLOWEST:g} are needed'
        )
    names, ours, reference = paired(measured, log)
    progress('searching for the place of the log')
    place = -1 if log.watts is not None else 0
    found, opposed = search(
        one(ours, place).low_passed(RATE), one(reference, place).low_passed(RATE)
    )
    _check_match(measured, log, found, opposed)
    progress('fitting clocks and channels')
    rate = min(_FIT_RATE, 0.5 * log.rate, 0.5 / measured.curve.period)
    pair = Pair(some(ours, len(names)), some(reference, len(names)), rate)
    near = [m for m in found if m.correlation > found[0].correlation - _NEARLY][:3]
    fits = [(m, f) for m in near if (f := pair.fit(m)) is not None]
    if not fits:
        raise InputError(f'{log.path} and {measured.path} overlap by less than 3 s')
    fits.sort(key=lambda item: _noise(item[1]))
    match, best = fits[0]
    if max(best.correlation) < _LEAST_FITTED:
        raise _unlike(measured, log, max(best.correlation), best.seconds)
    ambiguous = tuple(
        round(m.offset - match.offset, 3) for m, f in fits[1:] if _noise(f) < _ALIKE * _noise(best)
    )
    means = False
    if log.rate < _SLOW:
        averaged = Pair(some(ours.averaged(log.period), len(names)), pair.raw, rate)
        other = averaged.fit(match)
        if other is not None and _noise(other) < _noise(best):
            best, means = other, True
    allowed = with_folds(best, pair.folds(best.clock, measured.curve.period))
    channels = _channels(measured, log, names, allowed)
    progress('comparing power and bandwidth')
    folding = _folding(names, best, allowed, 1.0 / measured.curve.period)
    return _judged(measured, log, channels, allowed, ambiguous, means, folding)


def _folding(names: Sequence[str], before: Fit, after: Fit, rate: float) -> list[str]:
    """What the allowance for folding makes most of, where that matters, and what to do."""

    def mostly(a: Value, b: Value) -> bool:
        return b.high - b.low > np.sqrt(2.0) * (a.high - a.low)

    wide = [
        f'{name} gain'
        for name, a, b in zip(names, before.gain, after.gain, strict=True)
        if mostly(a, b) and 0.5 * (b.high - b.low) > _FOLDED * b.value
    ]
    if not wide:
        return []
    if mostly(before.offset, after.offset):
        wide.append('time offset')
    return [
        f'most of the interval of {", ".join(wide)} allows for what our sampling folds into the '
        f'band. A motion in step with our {rate:.0f} Hz folds at a fixed phase, and a longer '
        'recording does not help: 4 Hz is in step, --frequency 4.0371 is not'
    ]


def _noise(found: Fit) -> float:
    return float(np.exp(np.log(np.maximum(found.noise, 1e-12)).mean()))


def _check_match(measured: Measured, log: Log, found: Sequence[Match], opposed: Match) -> None:
    ours = measured.curve.span
    lengths = f'{measured.path} lasts {ours[1] - ours[0]:.1f} s, {log.path} {log.duration:.1f} s'
    if not found:
        raise InputError(f'{lengths}; they must have 3 s without gaps in common')
    best = found[0]
    if best.correlation >= _LEAST_CORRELATION and best.correlation > -opposed.correlation:
        return
    if opposed.correlation < -0.9:
        raise InputError(
            f'the reference correlates by {opposed.correlation:.3f}: its current has the other '
            'sign; multiply it, as in --columns time=…,current=NAME*-1'
        )
    raise _unlike(measured, log, best.correlation, best.overlap)


def _unlike(measured: Measured, log: Log, correlation: float, overlap: float) -> InputError:
    ours = measured.curve.span
    return InputError(
        f'the reference does not fit the recording: the best correlation at any offset is '
        f'{correlation:.2f} over {overlap:.1f} s ({measured.path} lasts {ours[1] - ours[0]:.1f} '
        f's, {log.path} {log.duration:.1f} s); is it the same run, and the right columns?'
    )


def _channels(
    measured: Measured, log: Log, names: Sequence[str], found: Fit
) -> dict[str, Channel]:
    channels = {}
    for place, name in enumerate(names):
        gain, level, noise = found.gain[place], found.level[place], float(found.noise[place])
        if not _GAINS[0] <= gain.value <= _GAINS[1]:
            raise InputError(
                f'{log.path}: {name} would need a gain of {gain.value:.4g}; is it in another '
                f'unit? Scale it, as in --columns time=…,{name}=NAME*0.001'
            )
        if name == 'power':
            volts = float(np.mean(np.concatenate([v[:, 0] for _, v in measured.curve.runs])))
            level = Value(*(x / volts for x in (level.value, level.low, level.high)))
            name, noise = 'current', noise / volts
        channels[name] = Channel(gain, level, noise, found.fixed[place])
    return channels


def _judged(
    measured: Measured,
    log: Log,
    channels: dict[str, Channel],
    found: Fit,
    ambiguous: tuple[float, ...],
    means: bool,
    folding: Sequence[str],
) -> Comparison:
    rate = min(_ERROR_RATE, 0.5 * log.rate, 0.5 / measured.curve.period)
    gain, offset = np.ones(2), np.zeros(2)
    for place, name in enumerate(('voltage', 'current')):
        if name in channels:
            gain[place], offset[place] = channels[name].gain.value, channels[name].offset.value
    before, after, true = _errors(measured, log, found, (gain, offset), rate, means)
    notes = [*measured.notes, *log.notes, *folding]
    if 'voltage' not in channels:
        notes.append('the reference says nothing of voltage; ours is taken as it is')
    if 'current' not in channels:
        notes.append('the reference says nothing of current; ours is taken as it is')
    notes += [
        f'{name}: too steady to tell an offset from a gain; its offset is held at 0'
        for name, channel in channels.items()
        if channel.fixed
    ]
    if means:
        notes.append(f'rows of the reference are means over their {1e3 * log.period:.3g} ms')
    if ambiguous:
        notes.append(
            'the motion repeats itself: offsets by '
            + ', '.join(f'{shift:+g} s' for shift in ambiguous)
            + ' fit as well; begin or end it inside the recording'
        )
    seen = 'current' if log.current is not None or log.power is None else 'power'
    answer = _response(measured, log, found, seen)
    above = 0.45 / measured.curve.period
    if answer is not None and answer.cutoff is not None:
        above = answer.cutoff.value
    return Comparison(
        measured=measured,
        log=log,
        channels=channels,
        fit=found,
        correlation=min(found.correlation),
        overlap=found.seconds,
        ambiguous=ambiguous,
        rows_are_means=means,
        before=float(np.sqrt(np.mean((before - true) ** 2))),
        after=float(np.sqrt(np.mean((after - true) ** 2))),
        mean_before=float(np.mean(before - true)),
        mean_after=float(np.mean(after - true)),
        error_rate=rate,
        response=answer,
        loss=loss(log, above),
        notes=tuple(notes),
    )


def _errors(
    measured: Measured,
    log: Log,
    found: Fit,
    correction: tuple[Floats, Floats],
    rate: float,
    means: bool,
) -> tuple[Floats, Floats, Floats]:
    """Power as recorded, as corrected, and the reference's at common times, W [T] each."""
    _, shown, true = powers(measured, log, found, correction, rate, means)
    good = np.isfinite(shown).all(axis=1) & np.isfinite(true)
    return shown[good, 0], shown[good, 1], true[good]


def powers(
    measured: Measured,
    log: Log,
    found: Fit,
    correction: tuple[Floats, Floats],
    rate: float,
    means: bool = False,
) -> tuple[Floats, Floats, Floats]:
    """
    Times s [T], our power before and after [T, 2] and the reference's [T], low-passed to a rate.

    Where the log lacks voltage or current, ours after correction takes its place. NaN in gaps.
    """
    both = Curve(
        tuple(
            (t, np.column_stack([p[:, 0], c[:, 0]]))
            for (t, p), (_, c) in zip(
                measured.power.runs, measured.corrected(*correction).runs, strict=True
            )
        ),
        measured.curve.period,
    )
    if means:
        both = both.averaged(log.period)
    low, high = found.clock.ours(np.array([log.time[0], log.time[-1]]))
    first, last = max(both.span[0], low), min(both.span[1], high)
    times = first + np.arange(max(0, int((last - first) * rate))) / rate
    at = found.clock.reference(times)
    shown = both.low_passed(rate).at(times)
    watts = log.watts
    if watts is not None:
        column, factor = watts, np.ones(len(times))
    else:
        place = 0 if log.current is not None else 1
        known = log.current if log.current is not None else log.voltage
        assert known is not None
        gain, offset = correction
        other = one(measured.curve, place).low_passed(rate).at(times)[:, 0]
        column, factor = known, other * gain[place] + offset[place]
    curve = Curve.of(log.time, column[:, None], log.starts, log.stops, log.period)
    return times, shown, curve.low_passed(rate).at(at)[:, 0] * factor


def _response(measured: Measured, log: Log, found: Fit, place: str) -> Response | None:
    if place == 'power':
        values, ours = log.power, measured.power
    elif log.current is not None:
        values, ours = log.current, one(measured.curve, 1)
    else:
        values, ours = log.voltage, one(measured.curve, 0)
    if values is None:
        return None
    curve = Curve.of(log.time, values[:, None], log.starts, log.stops, log.period)
    return response(ours, curve, found.clock)
