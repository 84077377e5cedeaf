"""Reading of recordings as models are judged on them: in this process, or each as a task."""

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final, Self

import numpy as np
from power_recordings.alignment.align import RATES, align, load_aligned, merge
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.quality.refusal import refuse_slow, refuse_wrong_units, slowest_power
from power_recordings.reading.reader import Recording, open_recordings
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError, printable

from power_estimator.network.checkpoint import TrainingRecording
from power_estimator.recordings import describe

RATE: Final = 400.0
CODE: Final = ('power_recordings', 'power_estimator')
_LONG: Final = 60.0  # s
_OVERSAMPLED: Final = 1.9  # samples for each of a slow recording, so that nothing is filtered away


@dataclass(frozen=True)
class JudgedDrives:
    """Names or patterns of the drives to judge, all if empty, and doubts that are overruled."""

    drives: tuple[str, ...] = ()
    slow: bool = False
    anyway: bool = False

    def of(self, recording: Recording) -> tuple[str, ...]:
        """Return the names of the chosen drives of a recording; empty for all."""
        names = recording.joints if self.drives else ()
        return tuple(name for name in names if any(fnmatchcase(name, p) for p in self.drives))


@dataclass(frozen=True)
class CheckedRecording:
    """A recording without its samples, with what else was read of it.

    doubt: why it contradicts itself, in a line, '' where it does not. changes: 1/s, of the power
    of its slowest meter; NaN without a meter.
    """

    recording: Recording
    described: TrainingRecording
    doubt: str
    changes: float

    @classmethod
    def of(cls, recording: Recording, judged: JudgedDrives) -> Self:
        """Check the drives that are judged."""
        drives, doubt, changes = judged.of(recording), '', np.nan
        try:
            if not judged.slow:
                refuse_slow(recording, drives)
            if not judged.anyway:
                refuse_wrong_units(recording, drives)
        except InputError as error:
            doubt = str(error)
        with suppress(InputError):
            changes = slowest_power(recording, drives)[1]
        return cls(recording.lighter(), describe(recording.path), doubt, changes)


Read = tuple[AlignedDataset, list[CheckedRecording]]


def read_here(paths: Sequence[Path], judged: JudgedDrives) -> Read:
    """Read and align recordings in this process; judged: drives whose signals are checked."""
    recordings = open_recordings(paths)
    rate, joints = RATE, None
    if sum(recording.duration for recording in recordings) >= _LONG:
        rate = _coarsest(min(_period(recording) for recording in recordings))
    if len(recordings) > 1:
        joints = _common([(r.path, r.joints) for r in recordings])
    data = load_aligned(recordings, rate=rate, smooth=False, drives=joints, need_power=False)
    return data, [CheckedRecording.of(recording, judged) for recording in recordings]


@dataclass(frozen=True)
class _Part:
    """A recording as a task read it; data: or why it cannot be aligned so."""

    checked: CheckedRecording
    period: float  # s
    data: AlignedDataset | InputError

    @property
    def recording(self) -> Recording:
        return self.checked.recording


@dataclass(frozen=True)
class _ReadTask:
    """A recording to be read; rate and joints None: those that it would have alone."""

    path: Path
    judged: JudgedDrives
    rate: float | None = None
    joints: tuple[str, ...] | None = None

    def __str__(self) -> str:
        return str(self.path)


def read_on_workers(
    engine: TaskEngine,
    paths: Sequence[Path],
    judged: JudgedDrives,
    show: Callable[[str], None] = lambda text: None,
) -> Read:
    """Read each of several recordings as a task; the result is that of `read_here`.

    Workers return aligned signals alone, so that this process never holds whole recordings. Those
    that have other joints or another rate than all have together are read twice.
    """
    tasks = [_ReadTask(path.resolve(), judged) for path in paths]
    parts = _run(engine, tasks, show)
    long = sum(part.recording.duration for part in parts) >= _LONG
    rate = _coarsest(min(part.period for part in parts)) if long else RATE
    joints = _common(
        [(path, part.recording.joints) for path, part in zip(paths, parts, strict=True)]
    )
    other = [
        place
        for place, part in enumerate(parts)
        if (_coarsest(part.period), part.recording.joints) != (rate, joints)
    ]
    again = [replace(tasks[place], rate=rate, joints=joints) for place in other]
    for place, part in zip(other, _run(engine, again, show), strict=True):
        parts[place] = part
    aligned, checked = [], []
    for path, part in zip(paths, parts, strict=True):
        for problem in part.recording.problems:
            print(printable(f'note: {path}: {problem}', 500), file=sys.stderr)
        if isinstance(part.data, InputError):
            raise part.data
        notes = tuple(note.replace(str(path.resolve()), str(path), 1) for note in part.data.notes)
        aligned.append(replace(part.data, recordings=(str(path),), notes=notes))
        checked.append(replace(part.checked, recording=replace(part.recording, path=path)))
    return merge(aligned), checked


def _run(
    engine: TaskEngine, tasks: Sequence[_ReadTask], show: Callable[[str], None]
) -> list[_Part]:
    parts = []
    for count, part in enumerate(engine.in_order(_read, tasks, CODE), 1):
        show(f'reading: {count} of {len(tasks)}')
        parts.append(part)
    return parts


def _read(task: _ReadTask) -> _Part:
    recording = Recording.open(task.path)
    own, period = recording.joints, _period(recording)
    rate, joints = task.rate or _coarsest(period), task.joints or own
    data: AlignedDataset | InputError
    try:
        data = align(recording, rate=rate, smooth=False, drives=joints, need_power=False)
    except InputError as error:
        data = error
    return _Part(CheckedRecording.of(recording, task.judged), period, data)


def _period(recording: Recording) -> float:
    """Median period of the joint states, s."""
    return float(np.median(np.diff(recording.joint_states().stamp_ns))) / 1e9


def _coarsest(period: float) -> float:
    """Lowest rate in Hz that holds twice what joint states of a period hold.

    Short recordings keep the highest: its filters cost them least at their ends.
    """
    return min((rate for rate in RATES if rate * period >= _OVERSAMPLED), default=RATE)


def _common(names: Sequence[tuple[Path, Sequence[str]]]) -> tuple[str, ...]:
    """The joints that all recordings have, in the order of the first."""
    first, own = names[0]
    common = tuple(name for name in own if all(name in other for _, other in names))
    if not common:
        path, other = next((path, other) for path, other in names if tuple(other) != tuple(own))
        raise InputError(
            f'{first} ({", ".join(own)}) and {path} ({", ".join(other)}) have no joint in common'
        )
    return common
