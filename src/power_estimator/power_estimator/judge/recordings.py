"""Recordings as models are judged on them: unsmoothed at 400 Hz, measured drives only."""

import hashlib
import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from power_recordings.alignment.align import load_aligned
from power_recordings.alignment.dataset import DRIVE_SIGNALS, AlignedDataset
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Bools
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError, quoted

from power_estimator.judge.read_recordings import JudgedDrives, read_here, read_on_workers

_SPAN = re.compile(r'(?:([1-9]\d{0,3})@)?(\d+(?:\.\d+)?):(\d+(?:\.\d+)?)')


@dataclass(frozen=True)
class LeftOut:
    """Span of one recording that is left out, s from its first sample."""

    recording: int  # counted from 0
    start: float
    stop: float

    @classmethod
    def of(cls, text: str) -> Self:
        """Parse FROM:TO of the first recording, or N@FROM:TO; InputError for anything else."""
        found = _SPAN.fullmatch(text.strip())
        if not found or float(found[2]) >= float(found[3]):
            raise InputError(
                f'{quoted(text)}: expected FROM:TO in seconds, as 12.5:14, or N@FROM:TO of the '
                'N-th recording'
            )
        return cls(int(found[1] or 1) - 1, float(found[2]), float(found[3]))

    def __str__(self) -> str:
        number = f'{self.recording + 1}@' if self.recording else ''
        return f'{number}{self.start:g}:{self.stop:g}'

    def rows(self, data: AlignedDataset) -> Bools:
        """Mark the samples [T] of aligned data in the span."""
        own = np.asarray(data.recording == self.recording)
        time = data.time - (data.time[own].min() if own.any() else 0.0)
        return own & (time >= self.start) & (time < self.stop)


def spans_of(texts: Sequence[str]) -> tuple[LeftOut, ...]:
    """Parse spans from texts with one or more each, separated by commas; InputError for others."""
    return tuple(LeftOut.of(part) for text in texts for part in text.split(','))


def without(data: AlignedDataset, spans: Sequence[LeftOut]) -> AlignedDataset:
    """Return data with the power in the spans unknown (NaN); motion stays, so no gap arises.

    InputError for steady points and for a span in which there is no sample.
    """
    if not spans:
        return data
    if data.steady:
        raise InputError('operating points have no time, so that no seconds can be left out')
    hidden = np.zeros(len(data.time), bool)
    for span in spans:
        rows = span.rows(data)
        if not rows.any():
            raise InputError(f'{span}: the recordings have no such seconds')
        hidden |= rows
    power, current, supply = (
        np.where(hidden if values.ndim == 1 else hidden[:, None], np.float32(np.nan), values)
        for values in (data.power, data.current, data.supply)
    )
    return replace(data, power=power, current=current, supply=supply)


_SMOOTH_RATE = 200.0
_CHANGES = 4.0  # of a slow meter in a window
_LONGEST_WINDOW = 30.0  # s


@dataclass(frozen=True)
class Loaded:
    """Aligned recordings with fingerprints by which models know them."""

    data: AlignedDataset
    recordings: Sequence[Recording]
    identities: tuple[Mapping[str, str], ...]  # name and sha256
    controllers: tuple[str, ...]  # by recording, '' where unknown
    window: float = 0.0  # s, over which energy is judged where the meter is slow
    left_out: tuple[LeftOut, ...] = ()
    smoothed: AlignedDataset | None = None  # signals that networks get in place of `smooth`

    @classmethod
    def of(cls, data: AlignedDataset) -> 'Loaded':
        """Wrap aligned data without files; fingerprints are of the signals themselves."""
        identities = tuple(
            {'name': name, 'sha256': _fingerprint(data, index)}
            for index, name in enumerate(data.recordings)
        )
        return cls(data, (), identities, ('',) * len(data.recordings))

    @property
    def judged_on(self) -> dict[str, list[str]]:
        """Names and fingerprints of the recordings, and seconds left out, as content of JSON."""
        return {
            'recordings': [one['name'] for one in self.identities],
            'sha256': [one['sha256'] for one in self.identities],
            'without': [str(span) for span in self.left_out],
        }

    @cached_property
    def smooth(self) -> AlignedDataset:
        """Signals for networks and proxies: 200 Hz, smoothed; operating points as they are."""
        if self.smoothed is not None or not self.recordings or self.data.steady:
            return self.smoothed or self.data
        data = load_aligned(
            self.recordings, rate=_SMOOTH_RATE, drives=self.data.names, need_power=False
        )
        return without(data, self.left_out)

    @cached_property
    def unmetered(self) -> 'Loaded | None':
        """The same recordings with the joints that are not judged; None where there are none."""
        joints = [recording.joints for recording in self.recordings]
        known = {*self.data.names}
        others = [
            name
            for name in (joints[0] if joints else ())
            if name not in known and all(name in names for names in joints)
        ]
        if not others:
            return None
        data = load_aligned(
            self.recordings, rate=self.data.rate, smooth=False, drives=others, need_power=False
        )
        return replace(self, data=data)

    def without(self, texts: Sequence[str]) -> 'Loaded':
        """Return recordings without some seconds: FROM:TO, or N@FROM:TO of the N-th recording."""
        if not texts:
            return self
        spans = spans_of(texts)
        return replace(self, data=without(self.data, spans), left_out=spans)

    def only(self, places: Sequence[int]) -> 'Loaded':
        """Return some of the recordings, by ascending indices."""
        if len(places) == len(self.identities):
            return self
        data = self.data.rows(np.isin(self.data.recording, places))
        return replace(
            self,
            data=replace(
                data,
                recordings=tuple(data.recordings[i] for i in places),
                recording=np.searchsorted(places, data.recording).astype(np.int32),
            ),
            recordings=[self.recordings[i] for i in places] if self.recordings else (),
            left_out=tuple(
                replace(span, recording=list(places).index(span.recording))
                for span in self.left_out
                if span.recording in places
            ),
            identities=tuple(self.identities[i] for i in places),
            controllers=tuple(self.controllers[i] for i in places),
        )


def load(
    paths: Sequence[Path],
    drives: Sequence[str] = (),
    *,
    slow: bool = False,
    anyway: bool = False,
    without: Sequence[str] = (),
    engine: TaskEngine | None = None,
    show: Callable[[str], None] = lambda text: None,
) -> Loaded:
    """Read recordings of measured drives; several of them on the workers of an engine, if given.

    slow: accept meters that change less than 25 times a second; energy is then judged over
    windows. anyway: accept recordings whose signals contradict each other. drives: names, or
    patterns as *_KFE. without: seconds to leave out, as in `Loaded.without`. show: gets progress.
    InputError for recordings that cannot be read, lack electrical data, or lack a named drive.
    """
    judged = JudgedDrives(tuple(drives), slow, anyway)
    if engine is None or len(paths) < 2:
        data, read = read_here(paths, judged)
    else:
        data, read = read_on_workers(engine, paths, judged, show)
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
    fitting = [[name for name in measured if fnmatchcase(name, pattern)] for pattern in drives]
    for pattern, names in zip(drives, fitting, strict=True):
        if not names:
            raise InputError(
                f'drive {pattern!r} was not measured; measured are {", ".join(measured)}'
            )
    for one in read:
        if one.doubt:
            raise InputError(one.doubt)
    loaded = Loaded(
        data.drives(list(dict.fromkeys(itertools.chain(*fitting))) or measured),
        [one.recording for one in read],
        tuple({'name': one.described.name, 'sha256': one.described.sha256} for one in read),
        tuple(str(one.described.card.get('controller', '')) for one in read),
        energy_window([one.changes for one in read]) if slow else 0.0,
    )
    return loaded.without(without)


def _fingerprint(data: AlignedDataset, index: int) -> str:
    """Hash of one recording's signals, whatever the order of its drives.

    A part of its drives or rows is another recording: fit and judge on the same ones.
    """
    own = data.rows(data.recording == index)
    signals = [getattr(own, name) for name in (*DRIVE_SIGNALS, 'motor_current')]
    digest = hashlib.sha256(own.time.tobytes() + np.float32(own.supply).tobytes())
    for name in sorted(own.names):
        digest.update(name.encode())
        for signal in signals:
            if signal is not None:
                digest.update(np.float32(signal[:, own.names.index(name)]).tobytes())
    return digest.hexdigest()


def energy_window(changes: Sequence[float]) -> float:
    """Return the s in which the slowest meter changes often enough for its energy to be known."""
    return float(np.clip(_CHANGES / max(min(changes), 1e-3), 1.0, _LONGEST_WINDOW))
