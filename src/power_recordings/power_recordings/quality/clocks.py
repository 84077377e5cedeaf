"""Clocks of a recording: steps, gaps, losses, jitter, and topics whose times do not meet."""

from collections.abc import Mapping
from typing import Final

from power_recordings.quality.findings import Finding
from power_recordings.quality.streams import SampleLoss, Timing
from power_recordings.reading.reader import Recording

_GAPS: Final = 0.05  # share of the recording
_COVERED: Final = 0.9  # share of the recording, with the gaps
_JITTER: Final = 0.5  # of a period
_MEETING: Final = 0.5  # share of the shorter topic
_RECORD_WITH: Final = (
    'record with power_daq record, or ros2 bag record by docs/rosbag2_qos.yaml and zstd_fast'
)


def clock_findings(recording: Recording, topics: Mapping[str, Timing]) -> list[Finding]:
    """Return what is amiss with the stamps of topics of the given timing."""
    found = []
    gappy = [n for n, t in topics.items() if t.gap_seconds > _GAPS * recording.duration]
    if gappy:
        longest = max(topics[name].gap_seconds for name in gappy)
        text = f'{longest:.3g} s of {recording.duration:.3g} s are gaps ({", ".join(gappy)})'
        found.append(Finding('gaps', 'warning', '', text))
    for name in ('joint_states', 'drive_supply'):
        if (timing := topics.get(name)) is None or not timing.rate > 0:
            continue
        stamps = getattr(recording, name)().stamp_ns
        covered = float(stamps[-1] - stamps[0]) / 1e9
        if covered < _COVERED * recording.duration:
            text = f'{name} covers {covered:.3g} s of {recording.duration:.3g} s: begun late?'
            found.append(Finding('coverage', 'warning', '', text))
    for name, timing in topics.items():
        steps = len(recording.breaks(name))
        if steps:
            places = 'once' if steps == 1 else f'{steps} times'
            text = f'{name}: the clock was set back {places}; what it repeats was cut out'
            found.append(Finding('clock_step', 'warning', '', text))
        if timing.jitter > _JITTER:
            text = (
                f'{name}: stamps jitter by ±{timing.jitter:.0%} of a period: times of arrival, or '
                'of a coarse clock?'
            )
            found.append(Finding('jitter', 'warning', '', text))
    power = 'drive_supply' if recording.has('drive_supply') else 'supply'
    if recording.has('joint_states') and recording.has(power):
        found += _apart(recording, power)
    return found


def loss_findings(losses: Mapping[str, SampleLoss], counts: Mapping[str, int]) -> list[Finding]:
    """Return a finding for each topic with lost samples; counts: samples that there are."""
    return [
        Finding(
            'lost',
            'warning',
            '',
            f'{name}: {loss.samples} of {counts[name] + loss.samples} samples are missing in '
            f'{loss.gaps} gaps of sequence; {_RECORD_WITH}',
        )
        for name, loss in losses.items()
        if loss.samples
    ]


def _apart(recording: Recording, power: str) -> list[Finding]:
    joints, electric = (getattr(recording, n)().stamp_ns for n in ('joint_states', power))
    shorter = min(int(s[-1] - s[0]) for s in (joints, electric))
    both = int(min(joints[-1], electric[-1])) - int(max(joints[0], electric[0]))
    if shorter <= 0 or both > _MEETING * shorter:
        return []
    text = (
        f'joint_states and {power} share {max(both, 0) / 1e9:.3g} s of {shorter / 1e9:.3g} s: '
        'stamps of two clocks?'
    )
    return [Finding('two_clocks', 'error', '', text, 'time: {stamp: log}')]
