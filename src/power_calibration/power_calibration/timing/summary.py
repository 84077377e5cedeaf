"""Synchronisation of a recording: delays, step responses, stamps and the device's clock."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.filters import SMOOTHING, gain, smoothing
from power_recordings.messages.samples import DriveSamples, Samples
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_calibration.analyser.reference_fit import IntervalEstimate
from power_calibration.timing.delay import Delay, delay_of
from power_calibration.timing.step_response import StepResponse, step_response

_TOPICS = (
    *('drive_supply', 'joint_states', 'joint_commands', 'supply'),
    *('imu', 'odom', 'foot_force', 'power_estimate'),
)
_WINDOW = 10.0  # s, within which a clock counts as even
_GAP = 2.5  # periods


@dataclass(frozen=True)
class StampJitter:
    """Deviation of N stamps from a straight line, s [N], NaN if unknown; time: s after the first.

    The line is over the number of the sample or over device time, as subclasses say.
    """

    time: Floats
    jitter: Floats

    @property
    def spread(self) -> float:
        """Standard deviation of the jitter, s."""
        return float(np.nanstd(self.jitter)) if np.isfinite(self.jitter).any() else np.nan

    @property
    def worst(self) -> float:
        """99th percentile of the jitter's magnitude, s."""
        known = np.abs(self.jitter[np.isfinite(self.jitter)])
        return float(np.quantile(known, 0.99)) if len(known) else np.nan


@dataclass(frozen=True)
class StampQuality(StampJitter):
    """Regularity of the stamps of a stream of N samples.

    jitter: from an even clock, fitted per 10 s; NaN in windows of under 8. lost: samples missing
    by sequence numbers, else by gaps.
    """

    topic: str
    count: int
    rate: float  # Hz
    lost: int
    gaps: int
    by_sequence: bool


@dataclass(frozen=True)
class ClockQuality(StampJitter):
    """Mapping from the device's clock to stamps.

    jitter: from a straight line over device time, which includes slow changes of a clock. drift:
    by how much the device's clock runs too fast, ppm.
    """

    drift: float


def stamp_qualities(recording: Recording) -> list[StampQuality]:
    """Return the quality of each stream with at least four samples."""
    there = {topic: getattr(recording, topic)() for topic in _TOPICS if recording.has(topic)}
    return [_quality(topic, samples) for topic, samples in there.items() if len(samples) >= 4]


def _quality(topic: str, samples: Samples) -> StampQuality:
    time = (samples.stamp_ns - samples.stamp_ns[0]) / 1e9
    steps = np.diff(time)
    period = float(np.median(steps))
    if isinstance(samples, DriveSamples):
        index = (samples.sequence - samples.sequence[0]).astype(np.int64)
        lost, gaps, counted = samples.lost, int(samples.after_gap.sum()), True
    else:
        missing = np.where(steps > _GAP * period, np.rint(steps / period) - 1, 0)
        lost, gaps, counted = int(missing.sum()), int((missing > 0).sum()), False
        index = np.concatenate([[0], np.cumsum(1 + missing)]).astype(np.int64)
    rate = float((index[-1] - index[0]) / (time[-1] - time[0]))
    return StampQuality(time, _jitter(time, index), topic, len(samples), rate, lost, gaps, counted)


def _jitter(time: Floats, index: NDArray[np.int64]) -> Floats:
    jitter = np.full(len(time), np.nan)
    window = (time / _WINDOW).astype(np.int64)
    for number in range(int(window[-1]) + 1):
        rows = np.flatnonzero(window == number)
        if len(rows) >= 8:
            slope, origin = np.polyfit(index[rows] - index[rows[0]], time[rows], 1)
            jitter[rows] = time[rows] - origin - slope * (index[rows] - index[rows[0]])
    return jitter


def clock_quality(recording: Recording) -> ClockQuality | None:
    """Return the clock mapping of drive_supply, whose messages carry device time; else None."""
    if not recording.has('drive_supply'):
        return None
    supply = recording.drive_supply()
    device = (supply.device_time.astype(np.int64) - int(supply.device_time[0])) / 1e9
    time = (supply.stamp_ns - supply.stamp_ns[0]) / 1e9
    if len(supply) < 8 or device[-1] <= 0 or (np.diff(device) < 0).any():
        return None
    slope, origin = np.polyfit(device, time - device, 1)
    return ClockQuality(time, time - device - origin - slope * device, -1e6 * slope)


SHIFTS_SHOWN = (0.001, 0.0025, 0.005, 0.01)  # shifts whose effect on power is reported, s
FREQUENCIES_SHOWN = (5.0, 12.5, 25.0, 50.0, 100.0)
"""Frequencies at which the smoothing's gain is reported, Hz."""
GRID = 400.0  # Hz, on which alignment smooths
MATTERS = 0.001  # s


@dataclass(frozen=True)
class Summary:
    """Delays and step responses by drive, and stamps by stream."""

    recording: str
    duration: float
    delays: Sequence[Delay]
    responses: Sequence[StepResponse]
    stamps: Sequence[StampQuality]
    clock: ClockQuality | None
    problems: Sequence[str]

    @property
    def common(self) -> IntervalEstimate | None:
        """Delay of all drives, weighted by their intervals; None where none is known.

        Its interval is as wide as the drives differ and does not shrink with their number, since
        errors of the proxy are common to all drives.
        """
        known = [d.delay for d in self.delays if d.delay is not None]
        if not known:
            return None
        half = np.array([max(0.5 * (d.high - d.low), 1e-7) for d in known])
        weights = 1.0 / half**2
        values = np.array([d.value for d in known])
        middle = float((weights * values).sum() / weights.sum())
        wide = float(1.0 / np.sqrt(weights.sum()))
        if len(known) > 1:
            wide = max(wide, 1.96 * float(values.std(ddof=1)))
        return IntervalEstimate.of(middle, wide)

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        common = self.common
        if common is None:
            return 'Power does not depend on the joint signals: the delay is unknown.'
        text = (
            f'Electrical stamps are {abs(1e3 * common.value):.2f} ms '
            f'{"late" if common.value >= 0 else "early"} against joint stamps '
            f'({1e3 * common.low:+.2f} to {1e3 * common.high:+.2f} ms)'
        )
        costs = [d.error_at(abs(common.value))[1] for d in self.delays if d.delay is not None]
        return f'{text}; this changes power by {np.median(costs):.1f} % of its deviation.'

    def json(self) -> dict[str, Any]:
        """Return the result as `sync --json` writes it; times in s, powers in W."""
        common = self.common
        return {
            'recording': self.recording,
            'duration_s': self.duration,
            'verdict': self.verdict,
            'delay': None if common is None else common.value,
            'delay_interval': None if common is None else common.interval,
            'drives': {d.drive: _delay(d) for d in self.delays},
            'jumps': {a.drive: _answer(a) for a in self.responses},
            'streams': {s.topic: _stream(s) for s in self.stamps},
            'clock': None
            if self.clock is None
            else {
                'drift_ppm': self.clock.drift,
                'residual_std_s': self.clock.spread,
                'residual_p99_s': self.clock.worst,
            },
            'smoothing': {
                'cutoff_hz': SMOOTHING,
                'window': len(smoothing(GRID)),
                'gain': {f'{f:g}': gain(smoothing(GRID), f, GRID) for f in FREQUENCIES_SHOWN},
            },
            'problems': list(self.problems),
        }


def summarise(
    recording: Recording,
    drives: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Summary:
    """Measure a recording's synchronisation; drives: None takes all measured joints.

    progress: is called with the present step as text. InputError for an unknown drive, or where no
    drive was measured for 3 s.
    """
    if not recording.has('drive_supply'):
        raise InputError(
            f'{recording.path}: no drive_supply: sync holds the meter of a drive against its '
            'motion; of a lone drive, give voltage and current in the map in place of supply'
        )
    measured = recording.drive_supply().names
    joints = recording.joint_states().names
    chosen = [name for name in measured if name in joints] if drives is None else drives
    if drives is None and not chosen:
        raise InputError(
            f'{recording.path}: drive_supply measures {", ".join(measured)}, of which '
            f'joint_states has none ({", ".join(joints)})'
        )
    delays, responses, problems = [], [], list(recording.problems)
    refused: InputError | None = None
    for name in chosen:
        progress(f'drive {name}')
        try:
            delays.append(delay_of(recording, name))
        except InputError as error:
            if drives is not None:
                raise
            problems.append(str(error))
            refused = error
            continue
        if (response := step_response(recording, name)) is not None:
            responses.append(response)
    if not delays and refused is not None:
        raise refused
    progress('stamps')
    return Summary(
        str(recording.path),
        recording.duration,
        delays,
        responses,
        stamp_qualities(recording),
        clock_quality(recording),
        problems,
    )


def _delay(found: Delay) -> dict[str, Any]:
    return {
        'delay': None if found.delay is None else found.delay.value,
        'interval': None if found.delay is None else found.delay.interval,
        'r2': found.r2,
        'power_std_w': found.power,
        'seconds': found.seconds,
        'error_by_shift': {
            f'{shift:g}': dict(zip(('w', 'percent'), found.error_at(shift), strict=True))
            for shift in SHIFTS_SHOWN
        },
    }


def _answer(found: StepResponse) -> dict[str, Any]:
    return {
        'events': found.events,
        **{
            f'{name}_half_rise': {
                'value': None if np.isnan(value.value) else value.value,
                'interval': None if np.isnan(value.value) else value.interval,
            }
            for name, value in (('current', found.current_half), ('torque', found.torque_half))
        },
    }


def _stream(found: StampQuality) -> dict[str, Any]:
    return {
        'samples': found.count,
        'rate_hz': found.rate,
        'jitter_std_s': None if np.isnan(found.spread) else found.spread,
        'jitter_p99_s': None if np.isnan(found.worst) else found.worst,
        'lost': found.lost,
        'gaps': found.gaps,
        'counted_by': 'sequence' if found.by_sequence else 'gaps',
    }
