"""Recordings as the lab judges on them: unsmoothed at 400 Hz, measured drives only."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.training import LEAST_SECONDS
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from power_estimator.network.checkpoint import TrainingRecording
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.recordings import describe, held_out
from power_recordings.alignment.align import RATES, load_aligned
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.quality.refusal import refuse_slow, refuse_wrong_units, slowest_power
from power_recordings.reading.reader import Recording, open_recordings
from wattwalk_core.errors import InputError

RATE = 400.0
_SMOOTH_RATE = 200.0
_LONG = 60.0  # s
_OVERSAMPLED = 1.9  # samples for each of a slow recording, so that nothing is filtered away
_CHANGES = 4.0  # of a slow meter in a window
_LONGEST_WINDOW = 30.0  # s
_LOST = 1.4  # s of each stretch, to the low-pass and to whole seconds


@dataclass(frozen=True)
class Loaded:
    """Aligned recordings with what identifies them."""

    data: AlignedDataset
    recordings: Sequence[Recording]
    identities: tuple[Mapping[str, str], ...]  # name and sha256
    controllers: tuple[str, ...]  # by recording, '' where unknown
    window: float = 0.0  # s, over which energy is judged where the meter is slow

    @cached_property
    def smooth(self) -> AlignedDataset:
        """The same recordings as networks and proxies take them: 200 Hz, smoothed."""
        return load_aligned(
            self.recordings, rate=_SMOOTH_RATE, drives=self.data.names, need_power=False
        )


def load(
    paths: Sequence[Path], drives: Sequence[str] = (), *, slow: bool = False, anyway: bool = False
) -> Loaded:
    """
    Read recordings of measured drives.

    slow: take meters that change less than 25 times a second, of which energy is judged over
    windows. anyway: take recordings whose signals contradict each other, too. InputError for
    recordings that cannot be read, lack electrical data, or lack a named drive.
    """
    recordings = open_recordings(paths)
    data = load_aligned(
        recordings,
        rate=_rate(recordings),
        smooth=False,
        drives=_in_common(recordings),
        need_power=False,
    )
    measured = data.measured_drives()
    if not measured and np.isfinite(data.supply).any():
        measured = data.names
    if not measured:
        raise InputError(
            f'{", ".join(map(str, paths))}: no drive has electrical data (topic drive_supply), '
            'nor has the robot (topic supply)'
        )
    if drives and not data.measured_drives():
        raise InputError(
            f'--drives {" ".join(drives)}: only the whole robot was metered, and its power '
            'is that of all its drives; leave --drives out'
        )
    missing = [name for name in drives if name not in measured]
    if missing:
        raise InputError(
            f'drive {missing[0]!r} was not measured; measured are {", ".join(measured)}'
        )
    for recording in recordings:
        if not slow:
            refuse_slow(recording, drives)
        if not anyway:
            refuse_wrong_units(recording, drives)
    known = [describe(recording.path) for recording in recordings]
    return Loaded(
        data.drives(list(drives) or list(measured)),
        tuple(recordings),
        tuple({'name': one.name, 'sha256': one.sha256} for one in known),
        tuple(str(one.card.get('controller', '')) for one in known),
        _window(recordings, drives) if slow else 0.0,
    )


def _window(recordings: Sequence[Recording], drives: Sequence[str]) -> float:
    """Window in s in which the slowest meter changes often enough for its energy to be known."""
    slowest = min(slowest_power(recording, drives)[1] for recording in recordings)
    return float(np.clip(_CHANGES / max(slowest, 1e-3), 1.0, _LONGEST_WINDOW))


def _rate(recordings: Sequence[Recording]) -> float:
    """
    Lowest rate in Hz that holds twice what the joint states hold.

    Short recordings keep the highest: its filters cost them least at their ends.
    """
    if sum(recording.duration for recording in recordings) < _LONG:
        return RATE
    period = min(float(np.median(np.diff(r.joint_states().stamp_ns))) for r in recordings) / 1e9
    return min((rate for rate in RATES if rate * period >= _OVERSAMPLED), default=RATE)


def _in_common(recordings: Sequence[Recording]) -> tuple[str, ...] | None:
    """The joints that all of several recordings have, in the order of the first."""
    if len(recordings) < 2:
        return None
    names = [recording.joint_states().names for recording in recordings]
    common = tuple(name for name in names[0] if all(name in other for other in names))
    if not common:
        other = next(i for i, own in enumerate(names) if own != names[0])
        first, second = (f'{recordings[i].path} ({", ".join(names[i])})' for i in (0, other))
        raise InputError(f'{first} and {second} have no joint in common')
    return common


def power_on(
    data: AlignedDataset, smooth: AlignedDataset, model: PowerModel
) -> NDArray[np.float32]:
    """A model's power on the samples of data, W [T, D], asked on smoothed samples."""
    power = model.predict(smooth)
    out = np.full(data.torque.shape, np.nan, np.float32)
    for index in range(len(data.recordings)):
        here, there = data.recording == index, smooth.recording == index
        if not here.any() or not there.any():
            continue
        for drive in range(power.shape[1]):
            out[here, drive] = _between(
                data.time[here], smooth.time[there], power[there, drive], smooth.rate
            )
    return out


@dataclass(frozen=True)
class Unseen:
    """A model's power where it was not trained."""

    power: NDArray[np.float32]  # W [T, D], NaN elsewhere
    partly: bool  # whether it was trained on some of the samples


def power_unseen(loaded: Loaded, model: PowerModel) -> Unseen:
    """A model's power; of a network that knows the recordings, on its test part only."""
    power = power_on(loaded.data, loaded.smooth, model)
    partly = False
    if isinstance(model, PowerPredictionNetwork):
        own = [TrainingRecording(one['name'], one['sha256']) for one in loaded.identities]
        for drive, name in enumerate(loaded.data.names):
            kinds = [t.name for t in model.types if t.matches(name)]
            if kinds:
                allowed = held_out(loaded.data, own, model.checkpoint.recordings, kinds[0])
                partly = partly or not allowed.all()
                power[~allowed, drive] = np.nan
    return Unseen(power, partly)


def base_power(loaded: Loaded, spec: str) -> Unseen:
    """
    Power of the model that effects stand on, as `power_unseen` gives it.

    InputError where a network's test part leaves too little of a drive to decide anything.
    """
    found = power_unseen(loaded, load_model(spec))
    if not np.isfinite(found.power).any() and not found.partly:
        raise InputError(f'{spec} says nothing about {", ".join(loaded.data.names)}')
    if found.partly:
        for drive, name in enumerate(loaded.data.names):
            known = np.isfinite(found.power[:, drive]) & np.isfinite(loaded.data.power[:, drive])
            seconds = _whole_seconds(known, loaded.data.rate)
            if seconds < LEAST_SECONDS:
                raise InputError(
                    f'{spec} was trained on these recordings: its test part leaves '
                    f'{seconds:.0f} s of {name} to judge on, not {LEAST_SECONDS:.0f}; give a '
                    'recording that it was not trained on (or a longer one)'
                )
    return found


def _whole_seconds(known: NDArray[np.bool_], rate: float) -> float:
    edges = np.flatnonzero(np.diff(np.r_[False, known, False]))
    lengths = (edges[1::2] - edges[::2]) / rate
    return float(np.maximum(lengths - _LOST, 0.0).sum())


def _between(
    time: NDArray[np.float64],
    known: NDArray[np.float64],
    values: NDArray[np.float32],
    rate: float,
) -> NDArray[np.float32]:
    """Linear interpolation that does not bridge gaps or NaN; held for half a sample at ends."""
    right = np.clip(np.searchsorted(known, time), 1, len(known) - 1)
    left = right - 1
    width = np.maximum(known[right] - known[left], 1e-9)
    weight = (time - known[left]) / width
    result = (1.0 - weight) * values[left] + weight * values[right]
    outside = (weight < -0.01) | (weight > 1.01) | (width > 1.5 / rate)
    nearest = np.where(weight < 0.5, left, right)
    near = np.abs(time - known[nearest]) < 0.6 / rate
    result[outside] = np.where(near, values[nearest], np.nan)[outside]
    return result.astype(np.float32)
