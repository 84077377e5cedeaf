"""Recordings as the lab judges on them: unsmoothed at 400 Hz, measured drives only."""

from collections.abc import Callable, Mapping, Sequence
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
from power_estimator.recordings import held_out
from power_recordings.alignment.align import load_aligned
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.reading.reader import Recording
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

from power_lab.read_recordings import JudgedDrives, read_here, read_on_workers

_SMOOTH_RATE = 200.0
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
    paths: Sequence[Path],
    drives: Sequence[str] = (),
    *,
    slow: bool = False,
    anyway: bool = False,
    engine: TaskEngine | None = None,
    show: Callable[[str], None] = lambda text: None,
) -> Loaded:
    """
    Read recordings of measured drives; several of them on the workers of an engine, if given.

    slow: take meters that change less than 25 times a second, of which energy is judged over
    windows. anyway: take recordings whose signals contradict each other, too. InputError for
    recordings that cannot be read, lack electrical data, or lack a named drive.
    """
    judged = JudgedDrives(tuple(drives), slow, anyway)
    if engine is None or len(paths) < 2:
        read = read_here(paths, judged)
    else:
        read = read_on_workers(engine, paths, judged, show)
    data = read.data
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
    for doubt in read.doubts:
        if doubt:
            raise InputError(doubt)
    return Loaded(
        data.drives(list(drives) or list(measured)),
        read.recordings,
        tuple({'name': one.name, 'sha256': one.sha256} for one in read.described),
        tuple(str(one.card.get('controller', '')) for one in read.described),
        _window(read.changes) if slow else 0.0,
    )


def _window(changes: Sequence[float]) -> float:
    """Window in s in which the slowest meter changes often enough for its energy to be known."""
    return float(np.clip(_CHANGES / max(min(changes), 1e-3), 1.0, _LONGEST_WINDOW))


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
