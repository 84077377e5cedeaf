"""Recordings for training and evaluation: aligned, identified by hash, with their cards."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
from power_recordings.alignment.align import load_aligned
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.card import FILE, Card
from power_recordings.quality.refusal import refuse_wrong_units
from power_recordings.reading.reader import Recording, open_recordings
from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError

from power_estimator.network.checkpoint import TrainingRecording
from power_estimator.network.features import features

SLOWEST = 195.0  # Hz of joint states; a network that runs at 200 Hz cannot be fed by fewer
_ALIKE = 1.2  # ratio of rates that count as one


def check_sampling(recordings: Sequence[Recording]) -> None:
    """Raise InputError if joint states come at under 195 Hz, change their rate, or differ in it.

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


@dataclass(frozen=True)
class TrainingSet:
    """Aligned recordings and the features of the live node for the same samples."""

    data: AlignedDataset
    live: Singles  # features of the same samples as the live node forms them [T, D, 3]
    recordings: tuple[TrainingRecording, ...]
    paths: tuple[Path, ...] = ()
    drives: tuple[str, ...] = ()  # patterns of the drives that were asked for; none for all

    def as_live(self) -> AlignedDataset:
        """Return the data with live features as signals: the error as command, position 0."""
        error, torque, velocity = np.moveaxis(self.live, 2, 0)
        position = np.where(np.isfinite(error), 0, np.nan).astype(np.float32)
        return replace(
            self.data, position=position, command=error, torque=torque, velocity=velocity
        )


def training_set(paths: Sequence[Path], drives: Sequence[str] = ()) -> TrainingSet:
    """Load several recordings as one set at 200 Hz; drives: name patterns, none for all.

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
    """Align recordings at 200 Hz, with the drives that fit one of the name patterns, or all.

    The robot's supply is unknown (NaN) if some of its drives are left out. InputError for a
    pattern that fits no drive.
    """
    data = load_aligned(recordings, rate=200.0)
    if not drives:
        return data
    chosen = [n for n in data.names if any(fnmatchcase(n, pattern) for pattern in drives)]
    for pattern in drives:
        if not any(fnmatchcase(name, pattern) for name in data.names):
            raise InputError(f'--drives {pattern!r}: there are {", ".join(data.names)}')
    all_of_them = len(chosen) == len(data.names)
    supply = data.supply if all_of_them else np.full_like(data.supply, np.nan)
    return replace(data.drives(chosen), supply=supply)


def live_features(recordings: Sequence[Path | Recording], data: AlignedDataset) -> Singles:
    """Return features [T, D, 3] of the same samples as the live node forms them: causal.

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
    """Return name, SHA-256 of the MCAP files, and card of a recording; InputError if it fails."""
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
