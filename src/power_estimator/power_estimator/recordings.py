"""Recordings for training and evaluation: aligned, identified by hash, with their cards."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.align import load_aligned
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.card import FILE, Card
from power_recordings.quality.refusal import refuse_wrong_units
from power_recordings.reading.reader import Recording, open_recordings
from wattwalk_core.errors import InputError

from power_estimator.input_checks import check_sampling
from power_estimator.network.checkpoint import TrainingRecording
from power_estimator.network.features import features

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class TrainingSet:
    """Aligned recordings and the features of the live node for the same samples."""

    data: AlignedDataset
    live: Floats  # features of the same samples as the live node forms them [T, D, 3]
    recordings: tuple[TrainingRecording, ...]
    paths: tuple[Path, ...] = ()
    drives: tuple[str, ...] = ()
    """Patterns of the drives that were asked for; none for all."""

    def as_live(self) -> AlignedDataset:
        """Return the data with the live node's features in place of the smoothed signals."""
        error, torque, velocity = np.moveaxis(self.live, 2, 0)
        position = np.where(np.isfinite(error), 0, np.nan).astype(np.float32)
        return replace(
            self.data, position=position, command=error, torque=torque, velocity=velocity
        )


def training_set(paths: Sequence[Path], drives: Sequence[str] = ()) -> TrainingSet:
    """
    Load several recordings as one set.

    InputError for a recording that is given twice, cannot be read, has another rate, or whose
    signals contradict each other.
    """
    known = tuple(describe(path) for path in paths)
    if len({r.sha256 for r in known}) < len(known):
        raise InputError(f'a recording is given twice among {", ".join(map(str, paths))}')
    recordings = open_recordings(paths)
    check_sampling(recordings)
    for recording in recordings:
        refuse_wrong_units(recording, overruled_by='')
    data = load(recordings, drives)
    return TrainingSet(data, live_features(recordings, data), known, tuple(paths), tuple(drives))


def load(recordings: Sequence[Path | Recording], drives: Sequence[str]) -> AlignedDataset:
    """
    Align recordings at 200 Hz with the drives whose names fit one of the patterns, or all.

    The robot's supply is left out if some of its drives are.
    """
    data = load_aligned(recordings, rate=200.0)
    if not drives:
        return data
    chosen = [n for n in data.names if any(fnmatchcase(n, pattern) for pattern in drives)]
    for pattern in drives:
        if not any(fnmatchcase(name, pattern) for name in data.names):
            raise InputError(f'--drives {pattern!r}: there are {", ".join(data.names)}')
    unknown = np.full_like(data.supply, np.nan)
    return (
        data.drives(chosen)
        if len(chosen) == len(data.names)
        else replace(data.drives(chosen), supply=unknown)
    )


def live_features(recordings: Sequence[Path | Recording], data: AlignedDataset) -> Floats:
    """
    Return features [T, D, 3] of the same samples as the live node forms them: unfiltered, causal.

    Each is the mean of the joint states at 400 Hz in the 5 ms around the sample's time: the one
    at that time and the next. So four of them end with the newest joint state, and a live
    estimate is the mean power of the 20 ms that end at its stamp. NaN where there is no next.
    """
    raw = load_aligned(recordings, rate=400.0, smooth=False, drives=data.names)
    x = features(raw)
    index = np.zeros(len(data.time), np.intp)
    for recording in range(len(data.recordings)):
        here, there = (np.flatnonzero(d.recording == recording) for d in (data, raw))
        near = np.searchsorted(raw.time[there], data.time[here] - 0.25 / raw.rate)
        index[here] = there[np.minimum(near, len(there) - 1)]
    after = np.minimum(index + 1, len(raw.time) - 1)
    result = (x[index] + x[after]) * np.float32(0.5)
    apart = np.abs(raw.time[index] - data.time) > 0.25 / raw.rate
    result[apart | (raw.segment[index] != raw.segment[after]) | (after == index)] = np.nan
    return result


def describe(path: Path) -> TrainingRecording:
    """Return name, card and hash of a recording; the hash is of its MCAP files alone."""
    files = sorted(path.glob('*.mcap')) if path.is_dir() else [path]
    digest = hashlib.sha256()
    for file in files:
        try:
            with file.open('rb') as stream:
                while block := stream.read(1 << 20):
                    digest.update(block)
        except OSError as error:
            raise InputError(f'{path}: cannot be read ({error.strerror})') from None
    folder = path if path.is_dir() else path.parent
    card = Card.load(folder) if (folder / FILE).exists() else Card()
    content = {k: v for k, v in asdict(card).items() if v not in ('', None, (), {})}
    if 'drives' in content:
        content['drives'] = list(content['drives'])
    return TrainingRecording(path.resolve().name, digest.hexdigest(), content)
