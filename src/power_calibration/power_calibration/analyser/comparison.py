"""Result of comparing one drive of a recording with an analyser's log."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student
from wattwalk_core.arrays import Floats

from power_calibration.analyser.bandwidth import Loss, Response
from power_calibration.analyser.curve import Curve, MeasuredDrive
from power_calibration.analyser.log import Log
from power_calibration.analyser.reference_fit import (
    Clock,
    IntervalEstimate,
    ReferenceFit,
    blocks_of,
)

RowKind = Literal['samples', 'means']
_BAND = 0.8  # of the slower rate
_LEVEL = 0.995  # quantile of the test
_LOWEST_BANDWIDTH = 0.2  # of our sampling rate, of a meter that is not itself an average


def row_kind(ours: Curve, reference: Curve, clock: Clock, period: float) -> RowKind | None:
    """Decide whether rows of a reference are samples or means over their period; None if unclear.

    Both curves hold the same K channels as sampled; period: s between rows. Under either
    hypothesis ours = slope·reference + level + bend·reference'', with one side averaged over the
    period for means, in a band of up to 0.4 of the slower rate. bend lies between 0 and that of a
    first-order meter whose −3 dB point is a fifth of its sampling rate: the means of a fast
    signal and a slow meter would otherwise be the same.

    Averaging removes noise as well as signal. The test of samples therefore averages ours alone,
    which favours means, and the test of means averages ours under both hypotheses and the
    reference under samples, which favours samples. Each compares the squared residuals block by
    block, after Vuong's test of models that are not nested (1989).
    """
    rate = _BAND * min(1.0 / period, 1.0 / ours.period)
    ours_low, ours_mean = ours.low_passed(rate), ours.low_passed(rate, mean=period)
    low = reference.low_passed(rate)
    mean = reference.low_passed(rate, mean=period)
    low_end, high_end = clock.ours(np.array(mean.span)).tolist()
    first, last = max(ours_mean.span[0], low_end), min(ours_mean.span[1], high_end)
    time = first + np.arange(max(0, int((last - first) * rate))) / rate
    at = clock.reference(time)
    low_values, mean_values = _with_curvature(low, at), _with_curvature(mean, at)
    y, y_mean = ours_low.at(time), ours_mean.at(time)
    good = np.isfinite(np.hstack([*low_values, *mean_values, y, y_mean])).all(axis=1)
    if good.sum() < 3.0 * rate:
        return None
    largest = 1.0 / (2.0 * (2.0 * np.pi * _LOWEST_BANDWIDTH / ours.period) ** 2)

    def residual(values: Floats, regressors: tuple[Floats, Floats]) -> Floats:
        x, curvature = (part[good].T for part in regressors)
        channels = zip(values[good].T, x, curvature, strict=True)
        return np.stack([_residual(*each, largest=largest) for each in channels])

    owner = blocks_of(time[good])
    as_means = residual(y_mean, low_values)
    samples = _wins(residual(y, low_values), as_means, owner)
    means = _wins(as_means, residual(y_mean, mean_values), owner)
    if samples == means:
        return None
    return 'samples' if samples else 'means'


def _with_curvature(curve: Curve, times: Floats) -> tuple[Floats, Floats]:
    return curve.at(times), curve.derivative().derivative().at(times)


def _residual(y: Floats, x: Floats, curvature: Floats, largest: float) -> Floats:
    """Fit y = slope·x + level + bend·curvature, 0 ≤ bend/slope ≤ largest, and return the rest."""
    one = np.ones_like(x)
    solution = np.linalg.lstsq(np.column_stack([x, one, curvature]), y, rcond=None)[0]
    bend = float(np.clip(solution[2] / solution[0], 0.0, largest))
    columns = np.column_stack([x + bend * curvature, one])
    return np.asarray(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0])


def _wins(first: Floats, second: Floats, owner: NDArray[np.intp]) -> bool:
    """Return whether residuals [K, T] are smaller than others beyond their scatter by block."""
    scale = np.maximum((first**2).mean(axis=1) + (second**2).mean(axis=1), 1e-18)
    difference = ((second**2 - first**2) / scale[:, None]).sum(axis=0)
    blocks = np.bincount(owner, difference)
    error = float(blocks.std(ddof=1)) / np.sqrt(len(blocks))
    return float(blocks.mean()) > student.ppf(_LEVEL, len(blocks) - 1) * error


@dataclass(frozen=True)
class Channel:
    """Correction of a channel: true = gain · measured + offset."""

    gain: IntervalEstimate
    offset: IntervalEstimate
    noise: float  # V or A, standard deviation of the residual
    fixed: bool  # offset held at 0: the recording cannot tell it from the gain


@dataclass(frozen=True)
class AnalyserComparison:
    """Calibration of a drive against a log; times of the log are `log.start` + its own."""

    measured: MeasuredDrive
    log: Log
    channels: dict[str, Channel]  # voltage, current
    fit: ReferenceFit
    ambiguous: tuple[float, ...]  # s, other offsets that fit as well, from the one chosen
    row_kind: RowKind | None  # of the log, None if not known
    error_rate: float  # Hz, of the low-passed power that the errors are of
    response: Response | None
    loss: Loss | None
    notes: tuple[str, ...]

    @property
    def time_offset(self) -> IntervalEstimate:
        """Time to add to the log's, in the middle of the overlap, to make it ROS time, s."""
        shift = self.measured.start_ns / 1e9 - self.log.start
        o = self.fit.offset
        return IntervalEstimate(shift + o.value, shift + o.low, shift + o.high)

    @property
    def drift_ppm(self) -> IntervalEstimate:
        """Drift of the analyser's clock against ROS time, positive if it runs too fast."""
        return self.fit.drift.times(1e6)

    @cached_property
    def powers(self) -> tuple[Floats, Floats, Floats]:
        """Times in s [T], our power before and after [T, 2] and the reference's [T], in W.

        All are low-passed for `error_rate` Hz. Where the log lacks voltage or current, ours after
        correction takes its place. NaN in gaps.
        """
        measured, log, rate = self.measured, self.log, self.error_rate
        known = [self.channels.get(name) for name in ('voltage', 'current')]
        gains = np.array([1.0 if channel is None else channel.gain.value for channel in known])
        offsets = np.array([0.0 if channel is None else channel.offset.value for channel in known])
        recorded, corrected = measured.power.runs, measured.corrected(gains, offsets).runs
        runs = [(t, np.hstack([p, c])) for (t, p), (_, c) in zip(recorded, corrected, strict=True)]
        both = Curve(tuple(runs), measured.curve.period)
        mean = log.period if self.row_kind == 'means' else 0.0
        low, high = self.fit.clock.ours(log.time[[0, -1]])
        first, last = max(both.span[0], low), min(both.span[1], high)
        times = first + np.arange(max(0, int((last - first) * rate))) / rate
        column, factor = log.watts, np.ones(len(times))
        if column is None:
            place, column = (0, log.current) if log.current is not None else (1, log.voltage)
            assert column is not None
            other = measured.curve.columns(slice(place, place + 1)).low_passed(rate).at(times)
            factor = other[:, 0] * gains[place] + offsets[place]
        true = log.curve(column).low_passed(rate).at(self.fit.clock.reference(times))[:, 0]
        return times, both.low_passed(rate, mean=mean).at(times), true * factor

    @cached_property
    def errors(self) -> list[list[float]]:
        """RMS errors of power and means, W: [[as recorded, with the corrections], [the same]]."""
        _, ours, true = self.powers
        good = np.isfinite(ours).all(axis=1) & np.isfinite(true)
        errors = ours[good] - true[good, None]
        return [np.sqrt((errors**2).mean(axis=0)).tolist(), errors.mean(axis=0).tolist()]

    def json(self) -> dict[str, Any]:
        """Return the result as nested dicts, as `calibrate --json` writes it."""
        (before, after), (mean_before, mean_after) = self.errors
        bandwidth: dict[str, Any] | None = None
        if self.response is not None:
            cutoff = self.response.cutoff
            bandwidth = {
                'minus_3db_hz': None if cutoff is None else cutoff.value,
                'interval': None if cutoff is None else cutoff.interval,
                'coherent_to_hz': self.response.reach,
            }
            if self.loss is not None:
                bandwidth |= {
                    'lost_above_hz': self.loss.above,
                    'lost_rms_w': self.loss.rms,
                    'alternating_rms_w': self.loss.total,
                    'lost_mean_w': self.loss.mean,
                }
        return {
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
            'time_offset_at': self.fit.clock.centre + self.log.start,
            'time_offset_ambiguous': list(self.ambiguous),
            'drift_ppm': self.drift_ppm.value,
            'drift_ppm_interval': self.drift_ppm.interval,
            'rmse_before_w': before,
            'rmse_after_w': after,
            'bias_before_w': mean_before,
            'bias_after_w': mean_after,
            'error_rate_hz': self.error_rate,
            'correlation': min(self.fit.correlation),
            'overlap_s': self.fit.seconds,
            'blocks': self.fit.blocks,
            'rows_are_means': None if self.row_kind is None else self.row_kind == 'means',
            'bandwidth': bandwidth,
            'notes': list(self.notes),
        }
