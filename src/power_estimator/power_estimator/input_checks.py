"""Checks of recordings before a model is trained or evaluated on them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

from power_estimator.network.features import FEATURES, PLAUSIBLE, UNITS, features

SLOWEST = 195.0  # Hz of joint states; a network that runs at 200 Hz cannot be fed by fewer
_ALIKE = 1.2  # ratio of rates that count as one
_MOVING = 0.05  # rad/s, standard deviation of a speed that says something
_RADIANS = (0.6, 1.6)  # rate of the position over the speed, where both are in radians
_MOST_LOSSY = 50.0  # mean power over the largest mechanical power
_AT_REST = 20.0  # W beside it


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


def check_units(data: AlignedDataset) -> None:
    """Raise InputError, with recording, drive and field, for a signal not in SI units."""
    for index, where in enumerate(data.recordings):
        rows = data.rows(data.recording == index)
        _check_size(rows, where)
        _check_radians(rows, where)
        _check_power(rows, where)


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


def _check_size(data: AlignedDataset, where: str) -> None:
    for name, unit, limit, values in zip(
        FEATURES, UNITS, PLAUSIBLE, np.moveaxis(features(data), 2, 0), strict=True
    ):
        largest = np.nanmax(np.abs(values), axis=0, initial=0.0)
        worst = int(np.argmax(largest))
        if largest[worst] > limit:
            raise InputError(
                f'{where}: {name} of {data.names[worst]} reaches {largest[worst]:.4g}; '
                f'that cannot be {unit}'
            )


def _check_radians(data: AlignedDataset, where: str) -> None:
    for column, name in enumerate(data.names):
        rates, speeds = [], []
        for run in data.segments():
            if run.stop - run.start > 2:
                rates.append(np.gradient(data.position[run, column], 1 / data.rate))
                speeds.append(data.velocity[run, column])
        rate, speed = _finite(rates, speeds)
        if not speed.size or speed.std() < _MOVING:
            continue
        slope = float((rate * speed).sum() / (speed * speed).sum())
        low, high = _RADIANS
        if not low < slope < high:
            raise InputError(
                f'{where}: position of {name} changes {slope:.3g} times as fast as its velocity '
                f'says; are both in radians?'
            )


def _check_power(data: AlignedDataset, where: str) -> None:
    for column, name in enumerate(data.names):
        power = data.power[:, column]
        power = power[np.isfinite(power)]
        shaft = np.abs(data.torque[:, column] * data.velocity[:, column])
        shaft = shaft[np.isfinite(shaft)]
        if not (power.size and shaft.size):
            continue
        mean = float(np.abs(power).mean())
        if mean > _MOST_LOSSY * (float(shaft.max()) + _AT_REST):
            raise InputError(
                f'{where}: voltage × current of {name} is {mean:.4g} in the mean, its mechanical '
                f'power at most {float(shaft.max()):.4g} W; are they in V and A, not in mA?'
            )


def _finite(
    rates: Sequence[NDArray[np.float32]], speeds: Sequence[NDArray[np.float32]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if not rates:
        return np.empty(0), np.empty(0)
    rate, speed = np.concatenate(rates).astype(float), np.concatenate(speeds).astype(float)
    both = np.isfinite(rate) & np.isfinite(speed)
    return rate[both], speed[both]
