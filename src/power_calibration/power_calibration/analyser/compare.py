"""Comparison of one drive of a recording with an analyser's log: alignment, channels, errors."""

from collections.abc import Callable, Sequence

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_calibration.analyser.bandwidth import Response, loss, response_of_drive
from power_calibration.analyser.comparison import AnalyserComparison, Channel, row_kind
from power_calibration.analyser.curve import RATE, Curve, Match, MeasuredDrive, matches
from power_calibration.analyser.log import Log
from power_calibration.analyser.reference_fit import (
    Clock,
    IntervalEstimate,
    ReferenceFit,
    fit_reference,
    with_aliases,
)


def aliases(reference: Curve, clock: Clock, period: float, rate: float) -> Floats:
    """Return the RMS [K] that sampling with a period, s, aliases into a band of `rate` Hz.

    Taken from the reference [K], with a first-order filter at a third of the meter's rate; 0 for
    a reference below 2.5 times that rate.
    """
    if reference.period > 0.4 * period:
        return np.zeros(reference.runs[0][1].shape[1])
    sampled = []
    for time, _ in reference.runs:
        first, last = clock.ours(time[[2, -3]])
        stamps = first + period * np.arange(max(0, int((last - first) / period)))
        if len(stamps) > 4:
            sampled.append((stamps, reference.at(clock.reference(stamps))))
    runs, smooth = Curve(tuple(sampled), period).low_passed(rate).runs, reference.low_passed(rate)
    both = np.concatenate([v - smooth.at(clock.reference(t)) for t, v in runs])
    both = both[np.isfinite(both).all(axis=1)]
    rms: Floats = both.std(axis=0) / np.sqrt(1.0 + 3.0**2)
    return rms


def signal_curves(measured: MeasuredDrive, log: Log) -> tuple[list[str], Curve, Curve]:
    """Return names of the channels to fit, and curves of drive and log with these channels.

    Channels are voltage and current as far as logged; power, if known, is the last column.
    """
    volts, amps, watts = log.voltage, log.current, log.watts
    if amps is None and volts is not None and log.power is not None:
        amps = log.power / np.where(np.abs(volts) > 1e-3, volts, np.nan)
    steady = volts is not None and float(np.ptp(volts)) <= 1e-6 * max(1.0, abs(float(volts[0])))
    known = {'voltage': None if steady else volts, 'current': amps}
    names = [name for name, column in known.items() if column is not None]
    picked = [place for place, column in enumerate(known.values()) if column is not None]
    columns = [column for column in (*known.values(), watts) if column is not None]

    def signals(_: Floats, values: Floats) -> Floats:
        power = [values.prod(axis=1)] if watts is not None else []
        return np.column_stack([values[:, picked], *power])

    ours = measured.curve.mapped(signals)
    return names or ['power'], ours, log.curve(np.column_stack(columns))


_FIT_RATE = 100.0  # Hz
_ERROR_RATE = 400.0  # Hz, that of the aligned dataset
_SLOWEST = 20.0  # Hz
_SLOW = 500.0  # Hz, below which it matters whether rows are samples or means
_LEAST_CORRELATION = 0.6
_LEAST_FITTED = 0.9  # correlation of the better channel after the fit
_AMBIGUITY = 0.05  # difference of correlation within which other matches are fitted
_SAME_NOISE = 1.1  # ratio of the residuals within which they are as good
_GAINS = (0.5, 2.0)
_ALIASED = 5e-4  # part of a gain above which aliasing is reported


def compare_with_analyser(
    measured: MeasuredDrive, log: Log, progress: Callable[[str], None] = lambda text: None
) -> AnalyserComparison:
    """Align a log with a recording and estimate the corrections of its channels.

    progress: is called with the present step as text. InputError where they do not overlap or
    correlate, with the best correlation, and for gains outside 0.5..2 (another unit).
    """
    if log.rate < _SLOWEST:
        raise InputError(
            f'{log.path} has {log.rate:.3g} rows a second; at least {_SLOWEST:g} are needed'
        )
    names, ours, reference = signal_curves(measured, log)
    progress('aligning the log')
    aligned = slice(-1, None) if log.watts is not None else slice(0, 1)
    found, opposed = matches(*(c.columns(aligned).low_passed(RATE) for c in (ours, reference)))
    _check_match(measured, log, found, opposed)
    progress('fitting clocks and channels')
    period = measured.curve.period
    rate = min(_FIT_RATE, 0.5 * log.rate, 0.5 / period)
    ours, reference = (c.columns(slice(0, len(names))) for c in (ours, reference))
    smooth = reference.low_passed(rate)
    near = [m for m in found if m.correlation > found[0].correlation - _AMBIGUITY][:3]
    low = ours.low_passed(rate)
    fits = [(m, f) for m in near if (f := fit_reference(low, smooth, m, rate)) is not None]
    if not fits:
        raise InputError(f'{log.path} and {measured.path} overlap by less than 3 s')
    fits.sort(key=lambda item: _noise(item[1]))
    match, best = fits[0]
    if max(best.correlation) < _LEAST_FITTED:
        raise _unlike(measured, log, max(best.correlation), best.seconds)
    same = [m for m, f in fits[1:] if _noise(f) < _SAME_NOISE * _noise(best)]
    ambiguous = tuple(round(m.offset - match.offset, 3) for m in same)
    notes = [*measured.notes, *log.notes]
    kind = None
    if log.rate < _SLOW:
        kind = row_kind(ours, reference, best.clock, log.period)
        width = f'{1e3 * log.period:.3g} ms'
        if kind == 'means':
            mean = ours.low_passed(rate, mean=log.period)
            best = fit_reference(mean, smooth, match, rate) or best
            notes.append(f'rows of the reference are means over their {width}')
        elif kind is None:
            notes.append(
                f'the data cannot tell whether rows of the reference are samples or means over '
                f'their {width}; taken as samples'
            )
    allowed = with_aliases(best, aliases(reference, best.clock, period, rate))
    channels = _channels(measured, log, names, allowed)
    progress('comparing power and bandwidth')
    answer = _response(measured, log, allowed)
    cutoff = answer.cutoff if answer is not None else None
    notes += _aliasing(names, best, allowed, 1.0 / period)
    notes += [
        f'the reference does not contain {name}; ours is not corrected'
        for name in ('voltage', 'current')
        if name not in channels
    ]
    notes += [
        f'{name}: too steady to tell an offset from a gain; its offset is held at 0'
        for name, channel in channels.items()
        if channel.fixed
    ]
    if ambiguous:
        shifts = ', '.join(f'{shift:+g} s' for shift in ambiguous)
        notes.append(
            f'the motion repeats itself: offsets by {shifts} fit as well; begin or end it inside '
            'the recording'
        )
    return AnalyserComparison(
        measured=measured,
        log=log,
        channels=channels,
        fit=allowed,
        ambiguous=ambiguous,
        row_kind=kind,
        error_rate=min(_ERROR_RATE, 0.5 * log.rate, 0.5 / period),
        response=answer,
        loss=loss(log, cutoff.value if cutoff is not None else 0.45 / period),
        notes=tuple(notes),
    )


def _noise(found: ReferenceFit) -> float:
    return float(np.exp(np.log(np.maximum(found.noise, 1e-12)).mean()))


def _check_match(
    measured: MeasuredDrive, log: Log, found: Sequence[Match], opposed: Match
) -> None:
    if not found:
        raise InputError(f'{_lengths(measured, log)}; they must have 3 s without gaps in common')
    best = found[0]
    if best.correlation >= _LEAST_CORRELATION and best.correlation > -opposed.correlation:
        return
    if opposed.correlation < -0.9:
        raise InputError(
            f'the reference correlates by {opposed.correlation:.3f}: its current has the other '
            'sign; multiply it, as in --columns time=…,current=NAME*-1'
        )
    raise _unlike(measured, log, best.correlation, best.overlap)


def _lengths(measured: MeasuredDrive, log: Log) -> str:
    first, last = measured.curve.span
    return f'{measured.path} lasts {last - first:.1f} s, {log.path} {log.duration:.1f} s'


def _unlike(measured: MeasuredDrive, log: Log, correlation: float, overlap: float) -> InputError:
    return InputError(
        f'the reference does not fit the recording: the best correlation at any offset is '
        f'{correlation:.2f} over {overlap:.1f} s ({_lengths(measured, log)}); is it the same run, '
        'and are these the right columns?'
    )


def _channels(
    measured: MeasuredDrive, log: Log, names: Sequence[str], found: ReferenceFit
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
            volts = float(np.concatenate([v[:, 0] for _, v in measured.curve.runs]).mean())
            name, level, noise = 'current', level.times(1.0 / volts), noise / volts
        channels[name] = Channel(gain, level, noise, found.fixed[place])
    return channels


def _aliasing(
    names: Sequence[str], before: ReferenceFit, after: ReferenceFit, rate: float
) -> list[str]:
    """Name the intervals that are mostly the allowance for aliasing, and what avoids that."""

    def mostly(a: IntervalEstimate, b: IntervalEstimate) -> bool:
        return b.high - b.low > np.sqrt(2.0) * (a.high - a.low)

    wide = [
        f'{name} gain'
        for name, a, b in zip(names, before.gain, after.gain, strict=True)
        if mostly(a, b) and 0.5 * (b.high - b.low) > _ALIASED * b.value
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


def _response(measured: MeasuredDrive, log: Log, found: ReferenceFit) -> Response | None:
    """Return the response of our current, or of the quantity that the log has instead."""
    curve = measured.curve
    if log.current is not None:
        values, ours = log.current, curve.columns(slice(1, 2))
    elif log.power is not None:
        values, ours = log.power, measured.power
    elif log.voltage is not None:
        values, ours = log.voltage, curve.columns(slice(0, 1))
    else:
        return None
    return response_of_drive(ours, log.curve(values), found.clock)
