"""Result of comparing one drive of a recording with an analyser's log."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from power_calibration.analyser.bandwidth import Loss, Response
from power_calibration.analyser.curve import Curve
from power_calibration.analyser.log import Log
from power_calibration.analyser.measured_drive import MeasuredDrive
from power_calibration.analyser.reference_fit import IntervalEstimate, ReferenceFit
from power_calibration.analyser.row_kind import RowKind

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Channel:
    """Correction of a channel: true = gain · measured + offset."""

    gain: IntervalEstimate
    offset: IntervalEstimate
    noise: float  # V or A, standard deviation of the residual
    fixed: bool  # offset held at 0: the recording cannot tell it from the gain


def correction_of(channels: dict[str, Channel]) -> tuple[Floats, Floats]:
    """Return gains and offsets of voltage and current; 1 and 0 where nothing was fitted."""
    gain, offset = np.ones(2), np.zeros(2)
    for place, name in enumerate(('voltage', 'current')):
        if name in channels:
            gain[place], offset[place] = channels[name].gain.value, channels[name].offset.value
    return gain, offset


@dataclass(frozen=True)
class AnalyserComparison:
    """Calibration of a drive against a log; times of the log are `log.start` + its own."""

    measured: MeasuredDrive
    log: Log
    channels: dict[str, Channel]  # voltage, current
    fit: ReferenceFit
    correlation: float
    overlap: float  # s
    ambiguous: tuple[float, ...]  # s, other offsets that fit as well, from the one chosen
    row_kind: RowKind | None  # of the log, None if not known
    before: float  # W, RMS error of power as recorded
    after: float  # W, with the corrections
    mean_before: float  # W
    mean_after: float  # W
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

    def powers(self) -> tuple[Floats, Floats, Floats]:
        """Times [T], our power before and after [T, 2] and the reference's [T], as `powers`."""
        correction = correction_of(self.channels)
        return powers(
            self.measured, self.log, self.fit, correction, self.error_rate, self.row_kind
        )

    def json(self) -> dict[str, Any]:
        """Return the result as `calibrate --json` writes it."""
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
            'rmse_before_w': self.before,
            'rmse_after_w': self.after,
            'bias_before_w': self.mean_before,
            'bias_after_w': self.mean_after,
            'error_rate_hz': self.error_rate,
            'correlation': self.correlation,
            'overlap_s': self.overlap,
            'blocks': self.fit.blocks,
            'rows_are_means': None if self.row_kind is None else self.row_kind == 'means',
            'bandwidth': bandwidth,
            'notes': list(self.notes),
        }


def powers(
    measured: MeasuredDrive,
    log: Log,
    found: ReferenceFit,
    correction: tuple[Floats, Floats],
    rate: float,
    row_kind: RowKind | None = None,
) -> tuple[Floats, Floats, Floats]:
    """
    Return times in s [T], our power before and after [T, 2] and the reference's [T], in W.

    All are low-passed to a rate in Hz. Where the log lacks voltage or current, ours after
    correction takes its place. NaN in gaps.
    """
    recorded, corrected = measured.power.runs, measured.corrected(*correction).runs
    runs = [(t, np.hstack([p, c])) for (t, p), (_, c) in zip(recorded, corrected, strict=True)]
    both = Curve(tuple(runs), measured.curve.period)
    mean = log.period if row_kind == 'means' else 0.0
    low, high = found.clock.ours(log.time[[0, -1]])
    first, last = max(both.span[0], low), min(both.span[1], high)
    times = first + np.arange(max(0, int((last - first) * rate))) / rate
    column, factor = log.watts, np.ones(len(times))
    if column is None:
        place, column = (0, log.current) if log.current is not None else (1, log.voltage)
        assert column is not None
        gain, offset = (values[place] for values in correction)
        other = measured.curve.columns(slice(place, place + 1)).low_passed(rate).at(times)[:, 0]
        factor = other * gain + offset
    true = log.curve(column).low_passed(rate).at(found.clock.reference(times))[:, 0] * factor
    return times, both.low_passed(rate, mean=mean).at(times), true
