"""Synchronisation of a recording: delays, step responses, stamps and the device's clock."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from power_recordings.alignment.filters import SMOOTHING, gain, smoothing
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

from power_calibration.analyser.reference_fit import IntervalEstimate
from power_calibration.timing.delay import Delay, delay_of
from power_calibration.timing.stamps import (
    ClockQuality,
    StampQuality,
    clock_quality,
    stamp_qualities,
)
from power_calibration.timing.step_response import StepResponse, step_response

SHIFTS_SHOWN = (0.001, 0.0025, 0.005, 0.01)
"""Shifts whose effect on power is reported, s."""
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
        """
        Delay of all drives, weighted by their intervals; None where none is known.

        Its interval is as wide as the drives differ and does not shrink with their number, since
        errors of the proxy are common to all drives.
        """
        known = [d.delay for d in self.delays if d.delay is not None]
        if not known:
            return None
        half = np.array([max(0.5 * (d.high - d.low), 1e-7) for d in known])
        weights = 1.0 / half**2
        middle = float((weights * np.array([d.value for d in known])).sum() / weights.sum())
        values = np.array([d.value for d in known])
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
    """
    Measure a recording's synchronisation; drives: those measured that are joints, if None.

    InputError for a drive that is not there, or where no drive was measured for 3 s.
    """
    measured = recording.drive_supply().names
    joints = recording.joint_states().names
    if drives is None:
        chosen: Sequence[str] = [name for name in measured if name in joints]
        if not chosen:
            raise InputError(
                f'{recording.path}: drive_supply measures {", ".join(measured)}, of which '
                f'joint_states has none ({", ".join(joints)})'
            )
    else:
        chosen = drives
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
        response = step_response(recording, name)
        if response is not None:
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
        'error_by_shift': {f'{s:g}': _pair(found.error_at(s)) for s in SHIFTS_SHOWN},
    }


def _pair(error: tuple[float, float]) -> Mapping[str, float]:
    return {'w': error[0], 'percent': error[1]}


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
