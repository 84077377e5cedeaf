"""A first look at long recordings: the power of a part of them, before all is read."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_recordings.messages.samples import DriveSamples
from power_recordings.reading.bag_folder import find
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError

from power_workbench.views.view import BETWEEN, PowerView

_SMALL = 24_000_000  # bytes of a file, which are read in less than a second
_MOST_MESSAGES = 300_000  # of a file whose chunks have no index


def coarse_view(paths: Sequence[str], drives: Sequence[str]) -> PowerView | None:
    """Return the measured power of evenly spaced chunks of recordings, in rows of 20 ms.

    None for recordings that are read soon enough, whose chunks cannot be left out (SQLite), or
    that cannot be read, which reading all of them tells in words.
    """
    try:
        bags = [find(Path(path)) for path in paths]
        size = sum(file.stat().st_size for bag in bags for file in bag.files)
        if size < _SMALL or any(bag.is_sqlite for bag in bags):
            return None
        every = -(-size // _SMALL) + 1
        read = [_sparse(Path(path), every) for path in paths]
        return _coarse([Path(path).name for path in paths], read, drives, 1.0 / every)
    except (InputError, OSError):
        return None


def _sparse(path: Path, every: int) -> tuple[DriveSamples, int, int]:
    """Electrical samples of every n-th chunk, and start and end of the recording [ns]."""
    recording = Recording.open(path, _MOST_MESSAGES, every)
    return recording.drive_supply(), recording.start_ns, recording.end_ns


def _coarse(
    names: Sequence[str],
    read: Sequence[tuple[DriveSamples, int, int]],
    drives: Sequence[str],
    share: float,
) -> PowerView | None:
    known = [
        {name for name, good in zip(samples.names, samples.good.T, strict=True) if good.any()}
        for samples, *_ in read
    ]
    meters = [name for name in drives or read[0][0].names if all(name in own for own in known)]
    if not meters:
        return None
    slots, owner, rows, first = [], [], [], 0
    for number, (samples, start, end) in enumerate(read):
        columns = [samples.names.index(name) for name in meters]
        power = np.where(samples.good, samples.power, np.float32(np.nan))[:, columns]
        places = ((samples.stamp_ns - start) * REDUCED_RATE / 1e9).astype(np.int64)
        own, means = _slot_means(places, power)
        slots.append(own + first)
        owner.append(np.full(len(own), number, np.int32))
        rows.append(means)
        first += round(((end - start) / 1e9 + BETWEEN) * REDUCED_RATE)
    return PowerView(
        meters=tuple(meters),
        drives=tuple(meters),
        recordings=tuple(names),
        slots=np.concatenate(slots),
        recording=np.concatenate(owner),
        measured=np.concatenate(rows),
        noise=np.full(len(meters), np.nan, np.float32),
        still=(0.0,) * len(meters),
        share=share,
    )


def _slot_means(places: NDArray[np.int64], power: Singles) -> tuple[NDArray[np.int64], Singles]:
    """Slots that have samples, ascending, and the mean of each; NaN where one is not known."""
    starts = np.flatnonzero(np.diff(places, prepend=places[:1] - 1))
    counts = np.diff(starts, append=len(places))
    sums = np.add.reduceat(power.astype(np.float64), starts, axis=0)
    return places[starts], (sums / counts[:, None]).astype(np.float32)
