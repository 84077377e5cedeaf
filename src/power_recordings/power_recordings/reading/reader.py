"""Recordings in memory: reading of bags, checks and order of stamps."""

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Self, TypeVar, cast

import numpy as np
from wattwalk_core.arrays import Stamps
from wattwalk_core.errors import InputError, printable

from power_recordings.card import FILE, Card
from power_recordings.messages import samples as arrays
from power_recordings.messages.batch import Batch, Topic
from power_recordings.messages.cdr import definition, full_name, own_fields, typestore
from power_recordings.messages.samples import Samples
from power_recordings.messages.topic_columns import Columns
from power_recordings.messages.topics import KINDS
from power_recordings.reading import bag_folder
from power_recordings.reading.ordering import ascending

S = TypeVar('S', bound=Samples)


def _topic(name: str, kind: type[S]) -> Callable[['Recording'], S]:
    """Return the method of a recording that returns its samples of a topic, of class `kind`."""

    def samples(recording: 'Recording') -> S:
        return cast(S, recording._get(name))

    samples.__doc__ = kind.__doc__
    return samples


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a recording."""

    type_name: str
    count: int


@dataclass(frozen=True)
class Recording:
    """A recording in memory.

    `problems` lists what is missing or was left out. The methods named like topics return their
    samples in ascending order of measurement time, or raise InputError, which lists the topics
    there are, if a topic is missing. Topics go by their last name: `joint_states` is also found
    as `/anymal/joint_states`, if there is only one.
    """

    path: Path
    folder: Path
    topics: Mapping[str, TopicInfo]
    start_ns: int  # log time of the first message
    end_ns: int
    problems: tuple[str, ...]
    _samples: Mapping[str, Samples]
    _breaks: Mapping[str, Stamps]
    _errors: Mapping[str, InputError]
    _let_go: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # topics, with names
    _reread: bool = False  # its file has all of its samples

    @classmethod
    def open(cls, path: Path, most_messages: int | None = None, every: int = 1) -> Self:
        """Read a bag folder or .mcap file of any program.

        A recording that was cut off is read up to there. most_messages: stop after the chunk that
        reaches this count. every: read only every n-th chunk of an MCAP file after the first few.
        Raises InputError if it is empty or not a bag. Errors of a topic (another type or
        definition, arrays of a wrong length) are raised by the method that returns it.
        """
        path = Path(path)
        bag = bag_folder.find(path)
        loader = _Loader(path)
        problems = list(bag.problems)
        topics: dict[str, Topic] = {}
        for batch in bag.batches(problems, topics, every=every):
            loader.add(batch)
            if most_messages is not None and loader.counts.total() >= most_messages:
                break
        if not loader.counts:
            raise InputError(
                f'{path} holds no messages' + (f': {"; ".join(problems)}' if problems else '')
            )
        missing = (bag.promised or 0) - loader.counts.total()
        if missing > 0 and most_messages is None and every == 1:
            problems.append(f'{missing} of {bag.promised} messages are missing')
        samples, breaks = loader.samples(problems)
        return cls(
            path=path,
            folder=bag.folder,
            topics={
                name: TopicInfo(topic.type_name, loader.counts[name])
                for name, topic in sorted(topics.items())
            },
            start_ns=loader.start_ns,
            end_ns=loader.end_ns,
            problems=tuple(problems),
            _samples=samples,
            _breaks=breaks,
            _errors=loader.errors,
            _reread=most_messages is None and every == 1,
        )

    @classmethod
    def in_memory(cls, name: str, samples: Mapping[str, Samples]) -> Self:
        """Make a recording with path `name` from samples by topic (`joint_states` and so on).

        Raises InputError for a topic that is not one of the suite's, or if there are no samples.
        """
        if unknown := samples.keys() - KINDS.keys():
            raise InputError(f'no topic {min(unknown)!r}; there are {", ".join(KINDS)}')
        there = [part.stamp_ns for part in samples.values() if len(part)]
        if not there:
            raise InputError(f'{name} holds no samples')
        topics = {t: TopicInfo(KINDS[t].type_name, len(part)) for t, part in samples.items()}
        problems: list[str] = []
        ordered = {t: _in_time(part, t, problems) for t, part in samples.items() if len(part)}
        return cls(
            path=Path(name),
            folder=Path(name),
            topics=topics,
            start_ns=min(int(stamps.min()) for stamps in there),
            end_ns=max(int(stamps.max()) for stamps in there),
            problems=tuple(problems),
            _samples={t: part for t, (part, _) in ordered.items()},
            _breaks={t: breaks for t, (_, breaks) in ordered.items()},
            _errors={},
        )

    @property
    def duration(self) -> float:
        """Seconds from the first to the last message."""
        return (self.end_ns - self.start_ns) / 1e9

    @cached_property
    def card(self) -> Card:
        """The card of the recording; an empty one if it has none."""
        return Card.load(self.folder) if (self.folder / FILE).exists() else Card()

    def between(self, start_ns: int, end_ns: int) -> Self:
        """Return the recording with only the samples in [start_ns, end_ns), ROS time in ns.

        `start_ns`, `end_ns` and `duration` of the result stay those of the whole.
        """
        samples = {
            name: part.rows(slice(*np.searchsorted(part.stamp_ns, [start_ns, end_ns])))
            for name, part in self.whole()._samples.items()
        }
        some = {name: part for name, part in samples.items() if len(part)}
        return replace(self, _samples=some, _let_go={}, _reread=False)

    def lighter(self) -> Self:
        """Return the recording without its samples, to save memory; `whole` reads them again.

        A recording made in memory or by `between` keeps its samples.
        """
        if self._let_go or not self._reread:
            return self
        names = {name: tuple(getattr(p, 'names', ())) for name, p in self._samples.items()}
        return replace(self, _samples={}, _let_go=names)

    def whole(self) -> Self:
        """Return the recording with its samples, reading its file again after `lighter`.

        InputError if the file has changed.
        """
        if not self._let_go:
            return self
        again = type(self).open(self.path)
        if any(getattr(again, n) != getattr(self, n) for n in ('start_ns', 'end_ns', 'topics')):
            raise InputError(f'{self.path} has changed since it was read; open it anew')
        return again

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in joint_states."""
        kept = self._let_go.get('joint_states')
        return tuple(self.joint_states().names) if kept is None else kept

    def has(self, name: str) -> bool:
        """Return whether there are messages of a topic."""
        return name in self._samples or name in self._errors or name in self._let_go

    def breaks(self, name: str) -> Stamps:
        """Return stamps, ns [B], of a topic's samples directly after samples that were dropped."""
        return self._breaks[name]

    drive_supply = _topic('drive_supply', arrays.DriveSamples)  # voltage and current of the drives
    joint_states = _topic('joint_states', arrays.JointSamples)  # position, velocity and torque
    joint_commands = _topic('joint_commands', arrays.JointSamples)  # the same, as commanded
    motor_current = _topic('motor_current', arrays.MotorCurrentSamples)  # torque-producing
    motor_temperature = _topic('motor_temperature', arrays.MotorTemperatureSamples)  # of windings
    supply = _topic('supply', arrays.SupplySamples)  # voltage and current of the whole robot
    power_estimate = _topic('power_estimate', arrays.EstimateSamples)  # as published
    foot_force = _topic('foot_force', arrays.FootForceSamples)  # normal forces of the feet
    imu = _topic('imu', arrays.ImuSamples)
    odom = _topic('odom', arrays.OdomSamples)
    cmd_vel = _topic('cmd_vel', arrays.CmdVelSamples)  # velocity commands

    def _get(self, name: str) -> Samples:
        if name in self._errors:
            raise self._errors[name]
        if name in self._let_go:
            return self.whole()._get(name)
        if name not in self._samples:
            there = ', '.join(n for n, topic in self.topics.items() if topic.count)
            raise InputError(f'{self.path} has no messages on topic {name!r}; there are: {there}')
        return self._samples[name]


def open_recordings(paths: Iterable[Path]) -> list[Recording]:
    """Read recordings for a command; their problems are printed on stderr, a line each."""
    recordings = [Recording.open(Path(path)) for path in paths]
    for recording in recordings:
        for problem in recording.problems:
            print(printable(f'note: {recording.path}: {problem}', 500), file=sys.stderr)
    return recordings


class _Loader:
    """Collects the messages of a recording by topic."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._columns: dict[str, Columns | None] = {}
        self._found: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        self.errors: dict[str, InputError] = {}
        self.start_ns = 2**63 - 1
        self.end_ns = 0

    def add(self, batch: Batch) -> None:
        name = batch.topic.name
        if name not in self._columns:
            self._columns[name] = self._declare(batch.topic)
        self.counts[name] += len(batch.offsets)
        self.start_ns = min(self.start_ns, int(batch.log_times.min()))
        self.end_ns = max(self.end_ns, int(batch.log_times.max()))
        columns = self._columns[name]
        if columns is not None:
            columns.add(batch)

    def _declare(self, topic: Topic) -> Columns | None:
        short = topic.name.rsplit('/', 1)[-1]
        if short not in KINDS:
            return None
        try:
            if short in self._found:
                raise InputError(
                    f'{self._path} has both {self._found[short]} and {topic.name}: '
                    'record one robot at a time'
                )
            self._found[short] = topic.name
            self._check(topic, KINDS[short].type_name)
        except InputError as error:
            self.errors[short] = error
            return None
        return Columns(f'{self._path}: {topic.name}', topic.type_name, KINDS[short].paths)

    def _check(self, topic: Topic, type_name: str) -> None:
        """Raise InputError for messages of another type, encoding or definition."""
        if topic.type_name != type_name:
            raise InputError(
                f'{self._path}: topic {topic.name} is a {topic.type_name}; expected {type_name}'
            )
        if topic.encoding != 'cdr':
            raise InputError(
                f'{self._path}: {topic.name} is encoded as {topic.encoding!r}, not cdr'
            )
        if topic.definition in ('', definition(topic.type_name)):
            return
        try:
            recorded = own_fields(topic.definition, full_name(topic.type_name))
        except ValueError as error:
            raise InputError(
                f'{self._path}: the definition of {topic.name} is damaged: {printable(str(error))}'
            ) from error
        for name, (_, fields) in recorded.items():
            known = typestore().fielddefs.get(name)
            if known is not None and known[1] != fields:
                raise InputError(
                    f'{self._path}: {topic.name} was recorded with another definition of {name} '
                    f'(fields {", ".join(field[0] for field in fields)})'
                )

    def samples(self, problems: list[str]) -> tuple[dict[str, Samples], dict[str, Stamps]]:
        found: dict[str, Samples] = {}
        breaks: dict[str, Stamps] = {}
        for short, name in self._found.items():
            columns = self._columns[name]
            if columns is None or short in self.errors:
                continue
            if columns.damaged:
                problems.append(f'{name}: {columns.damaged} damaged messages left out')
            if not columns.blocks:
                continue
            try:
                columns.check()
                whole = KINDS[short].build(columns)
            except InputError as error:
                self.errors[short] = error
                continue
            found[short], breaks[short] = _in_time(whole, name, problems)
        return found, breaks


def _in_time(samples: S, topic: str, problems: list[str]) -> tuple[S, Stamps]:
    """Return samples with ascending stamps, and stamps before which samples were cut out."""
    stamps = samples.stamp_ns
    if len(stamps) < 2 or (np.diff(stamps) > 0).all():
        return samples, np.zeros(0, np.int64)
    if (stamps == stamps[0]).all():
        problems.append(f'{topic}: all {len(stamps)} messages have the same stamp {stamps[0]} ns')
        return samples.rows(slice(1)), np.zeros(0, np.int64)
    keep = ascending(stamps)
    twice = np.diff(stamps, prepend=stamps[0] - 1) == 0
    back = ~keep & ~twice
    if twice.any():
        problems.append(f'{topic}: {twice.sum()} samples with the stamp of another left out')
    if back.any():
        first = int(np.argmax(back))
        problems.append(
            f'{topic}: {back.sum()} samples whose stamps run backwards cut out, the first '
            f'at {stamps[first] / 1e9:.3f} s'
        )
    cuts = np.cumsum(back)[keep]
    return samples.rows(keep), stamps[keep][1:][np.diff(cuts) > 0]
