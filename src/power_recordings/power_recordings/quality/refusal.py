"""Recordings that are not judged: slow meters, and signals that contradict each other."""

from collections.abc import Collection

import numpy as np
from wattwalk_core.errors import InputError

from power_recordings.quality.check import check_recording
from power_recordings.quality.streams import LEAST_UPDATES, updates
from power_recordings.reading.reader import Recording

_STRETCH = 120  # s, that units and signs are checked on


def slowest_power(recording: Recording, drives: Collection[str] = ()) -> tuple[str, float]:
    """Return the meter whose power changes least often, a drive or `supply`, and its changes/s.

    drives: those that are judged; all where none is named.
    """
    if recording.has('drive_supply'):
        electric = recording.drive_supply()
        rates = updates(electric.stamp_ns, electric.power)
        judged = np.array([not drives or name in drives for name in electric.names], dtype=bool)
        rates = np.where(judged & np.isfinite(electric.power).any(axis=0), rates, np.inf)
        worst = int(np.argmin(rates))
        return electric.names[worst], float(rates[worst])
    supply = recording.supply()
    return 'supply', float(updates(supply.stamp_ns, supply.power[:, None])[0])


def _liveliest(recording: Recording) -> Recording:
    """Return the stretch of a long recording in which the joints move most.

    A unit or a sign is wrong throughout, and shows in motion.
    """
    if recording.duration <= 2 * _STRETCH or not recording.has('joint_states'):
        return recording
    joints = recording.joint_states()
    seconds = (joints.stamp_ns - joints.stamp_ns[0]) // 1_000_000_000
    speed = np.nan_to_num(np.square(joints.velocity)).sum(axis=1)
    moved = np.cumsum(np.bincount(seconds, weights=speed))
    if len(moved) <= _STRETCH:
        return recording
    start = int(np.argmax(moved[_STRETCH:] - moved[:-_STRETCH]))
    begin = int(joints.stamp_ns[0]) + start * 1_000_000_000
    return recording.between(begin, begin + _STRETCH * 1_000_000_000)


def refuse_wrong_units(
    recording: Recording,
    drives: Collection[str] = (),
    *,
    overruled_by: str = '--ignore-unit-conflicts',
) -> None:
    """Raise InputError if drives (all, if none is named) have a finding `error` on their signals.

    A slow power does not count. overruled_by: the option that the message names; '' for none.
    """
    wrong = [
        finding
        for finding in check_recording(_liveliest(recording)).findings
        if finding.severity == 'error' and finding.code != 'slow_power'
        if not drives or not finding.drive or finding.drive in drives
    ]
    if not wrong:
        return
    more = f' ({len(wrong) - 1} more: `power_recordings info`)' if len(wrong) > 1 else ''
    overruled = f'; {overruled_by} judges it as it is' if overruled_by else ''
    raise InputError(f'{recording.path}: {wrong[0]}{more}{overruled}')


def refuse_slow(recording: Recording, drives: Collection[str] = ()) -> None:
    """Raise InputError if the power of one of `drives` (or any) changes less than 25 times/s."""
    if recording.card.steady:
        return
    meter, rate = slowest_power(recording, drives)
    if rate < LEAST_UPDATES:
        raise InputError(
            f'{recording.path}: the power of {meter} changes {rate:.3g} times a second; the lab '
            f'needs {LEAST_UPDATES:.0f}. With --slow-meter its commands judge the energy over '
            'windows only'
        )
