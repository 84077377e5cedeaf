"""Checks of recordings before a model is trained or evaluated on them."""

from collections.abc import Sequence

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

SLOWEST = 195.0  # Hz of joint states; a network that runs at 200 Hz cannot be fed by fewer
_ALIKE = 1.2  # ratio of rates that count as one


def check_sampling(recordings: Sequence[Recording]) -> None:
    """
    Raise InputError for joint states whose rate is too low or changes.

    A filter or a bin of another rate is another feature; models are not trained on a mixture.
    """
    first: tuple[Recording, float] | None = None
    for recording in recordings:
        steps = np.diff(recording.joint_states().stamp_ns) / 1e9
        steps = steps[steps > 0]
        if not len(steps):
            continue
        rate = 1 / float(np.median(steps))
        if rate < SLOWEST:
            raise InputError(
                f'{recording.path}: joint_states come at {rate:.0f} Hz; features at 200 Hz need '
                f'{SLOWEST:.0f} Hz or more'
            )
        slow = (steps > 1.6 / rate) & (steps < 0.1)
        if steps[slow].sum() > 0.2 * steps.sum():
            raise InputError(
                f'{recording.path}: joint_states change their rate, from {rate:.0f} to '
                f'{1 / float(np.median(steps[slow])):.0f} Hz; record at one rate'
            )
        if first is None:
            first = (recording, rate)
        elif not 1 / _ALIKE < rate / first[1] < _ALIKE:
            raise InputError(
                f'{recording.path}: joint_states come at {rate:.0f} Hz, those of '
                f'{first[0].path} at {first[1]:.0f} Hz; take recordings of one rate'
            )


def check_complete(data: AlignedDataset) -> None:
    """Raise InputError if a drive's power was measured but one of its signals was not."""
    for index, where in enumerate(data.recordings):
        rows = data.recording == index
        power = np.isfinite(data.power[rows]).any(axis=0)
        for topic, values in (
            ('joint_states', data.position + data.velocity + data.torque),
            ('joint_commands', data.command),
        ):
            lacking = power & ~np.isfinite(values[rows]).any(axis=0)
            if lacking.any():
                name = data.names[int(np.argmax(lacking))]
                raise InputError(
                    f'{where}: {topic} say nothing of {name}, whose power was measured; record '
                    f'them too or leave the drive out with --drives'
                )
