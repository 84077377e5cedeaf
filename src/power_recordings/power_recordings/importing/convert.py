"""From logs to a recording: read, convert, merge, write."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats, Stamps
from wattwalk_core.errors import InputError

from power_recordings.card import Card
from power_recordings.importing.channel_group import ChannelGroup
from power_recordings.importing.map_file import ImportMap, TimeMap
from power_recordings.importing.origin import origin_of_power
from power_recordings.importing.plan import ImportPlan, LogChannel, make_plan
from power_recordings.importing.sources.source import LogBlock, LogSource
from power_recordings.importing.times import PAUSE, START, LogClock
from power_recordings.importing.units import conversion
from power_recordings.messages import cdr
from power_recordings.messages.samples import UNKNOWN_VOLTAGE
from power_recordings.messages.topics import KINDS
from power_recordings.quality.causes import UNITS, common_name
from power_recordings.writing.writer import BagWriter, MessageBlock, make_way, staged

Messages = NDArray[np.uint8]
Values = dict[tuple[str, str], Floats]  # [N] by drive and quantity
Written = dict[str, tuple[Stamps, Values]]
_JOINT_FIELDS = {
    'joint_states': {'position': 'position', 'velocity': 'velocity', 'torque': 'effort'},
    'motor_current': {'motor_current': 'effort'},
    'motor_temperature': {'temperature': 'effort'},  # of drives without a meter of their own
    'joint_commands': {'command': 'position'},
}
"""Fields of the JointState messages of a topic, by the quantities that they hold."""
TOPICS = (*_JOINT_FIELDS, 'drive_supply', 'supply')
_PERIOD = 0.1  # s of electrical samples in a message
_CHUNK = 10.0  # s
_POINTS = 50.0  # Hz, at which operating points that have no times are written


@dataclass(frozen=True)
class Imported:
    """Result of an import: number of samples by topic, of messages, and notes on changes."""

    path: Path
    counts: Mapping[str, int]
    messages: int
    notes: tuple[str, ...]


class _Writer:
    """Writes groups of converted signals as the topics of a recording."""

    def __init__(self, bag: BagWriter, plan: ImportPlan) -> None:
        self._bag = bag
        self.measured = _having(plan, 'current', 'power')
        self._of_joints = {
            'joint_states': tuple(plan.drives),
            'motor_current': _having(plan, 'motor_current'),
            'motor_temperature': tuple(
                drive for drive in _having(plan, 'temperature') if drive not in self.measured
            ),
            'joint_commands': _having(plan, 'command'),
        }
        self.counts = dict.fromkeys(TOPICS, 0)
        self._topics: dict[str, int] = {}
        self._sequence = 0
        self._per_message = 0

    def write_all(self, parts: Written) -> None:
        """Write what was read of all topics, in the order of time."""
        self._bag.write_blocks(
            [b for topic, (stamps, v) in parts.items() for b in self._encode(topic, stamps, v)]
        )

    def _encode(self, topic: str, stamps: Stamps, values: Values) -> list[MessageBlock]:
        if not len(stamps):
            return []
        self.counts[topic] += len(stamps)
        if topic == 'drive_supply':
            times, blocks = self._drive_supply(stamps, values)
        elif topic == 'supply':
            times, blocks = stamps, [_supply(stamps, values)]
        else:
            times, blocks = stamps, [self._joints(topic, stamps, values)]
        if topic not in self._topics:
            self._topics[topic] = self._bag.add_topic(topic, KINDS[topic].type_name)
        parts = np.split(times, np.cumsum([len(block) for block in blocks[:-1]], dtype=int))
        return [
            MessageBlock(self._topics[topic], part, block)
            for part, block in zip(parts, blocks, strict=True)
        ]

    def _joints(self, topic: str, stamps: Stamps, values: Values) -> Messages:
        drives = self._of_joints[topic]
        columns: dict[str, Any] = {
            field: _table(values, drives, quantity, len(stamps))
            for quantity, field in _JOINT_FIELDS[topic].items()
        }
        return cdr.joint_state_block(stamps, drives, **columns)

    def _drive_supply(self, stamps: Stamps, values: Values) -> tuple[Stamps, list[Messages]]:
        count = len(stamps)
        volts, amps, watts, celsius = (
            _table(values, self.measured, quantity, count)
            for quantity in ('voltage', 'current', 'power', 'temperature')
        )
        with np.errstate(divide='ignore', invalid='ignore'):
            amps = np.where(np.isnan(amps), watts / volts, amps)
        if not self._per_message:
            step = float(np.median(np.diff(stamps))) / 1e9 if count > 1 else 1.0
            self._per_message = int(np.clip(round(_PERIOD / max(step, 1e-6)), 1, 1000))
        blocks = cdr.drive_supply_blocks(
            stamps,
            self._sequence,
            stamps.astype(np.uint64),
            self.measured,
            volts,
            amps,
            celsius,
            (~np.isfinite(volts * amps)).astype(np.uint8),
            self._per_message,
        )
        self._sequence += count
        return stamps[:: self._per_message], blocks


def _table(values: Values, drives: Sequence[str], quantity: str, n: int) -> Floats:
    empty = np.full(n, np.nan)
    return np.stack([values.get((drive, quantity), empty) for drive in drives], axis=1)


def _supply(stamps: Stamps, values: Values) -> Messages:
    volts = values.get(('', 'voltage'), np.full(len(stamps), UNKNOWN_VOLTAGE))
    amps = values.get(('', 'current'))
    if amps is None:
        amps = values['', 'power'] / volts
    return cdr.battery_block(stamps, volts, -amps)


def _having(plan: ImportPlan, *quantities: str) -> tuple[str, ...]:
    return tuple(drive for drive, own in plan.drives.items() if {*quantities} & {*own})


def import_logs(
    sources: Sequence[LogSource],
    mapping: ImportMap,
    where: str,
    out: Path,
    progress: Callable[[int], None] = lambda done: None,
    *,
    overwrite: bool | None = None,
) -> Imported:
    """Write logs, one after the other, as one recording with a card.

    where: the name of the map, for errors. out: the recording's folder. progress: is called with
    the bytes read so far. Raises InputError for logs without what the map names or with unusable
    times; nothing is left behind then.
    """
    plans = [make_plan(mapping, s.columns(), where, s.is_bag) for s in sources]
    for source, plan in zip(sources, plans, strict=True):
        if tuple(plan.drives) != tuple(plans[0].drives):
            raise InputError(
                f'{source.path} has the drives {", ".join(plan.drives)}; '
                f'{sources[0].path} has {", ".join(plans[0].drives)}'
            )
    _card(mapping, plans[0], (), sources, where, ())  # an error in it comes before the work
    make_way(out, overwrite, remove=False)
    formulas, about = origin_of_power(sources[0], plans[0])
    notes = [f'{sources[0].path.name}: {note}' for note in about]
    done, end = 0, 0
    with staged(out) as path:
        with BagWriter(path, flush_period=_CHUNK) as bag:
            writer = _Writer(bag, plans[0])
            for source, plan in zip(sources, plans, strict=True):
                log = _Log(source, plan, mapping, end)

                def advance(count: int, base: int = done) -> None:
                    progress(base + count)

                for block in _ahead(source.read(plan.addresses(), advance)):
                    writer.write_all(log.add(block))
                writer.write_all(log.finish())
                notes += log.notes
                done, end = done + source.size, log.end
        if not any(writer.counts.values()):
            raise InputError(f'{sources[0].path}: no rows')
        card = _card(mapping, plans[0], writer.measured, sources, where, notes)
        card.with_formulas(formulas).save(path)
    counts = {topic: count for topic, count in writer.counts.items() if count}
    return Imported(out, counts, sum(bag.counts.values()), tuple(notes))


def _ahead(blocks: Iterator[LogBlock]) -> Iterator[LogBlock]:
    """Yield blocks, each of which a thread reads while the one before is used."""
    with ThreadPoolExecutor(1, 'read') as pool:
        coming = pool.submit(next, blocks, None)
        while (block := coming.result()) is not None:
            coming = pool.submit(next, blocks, None)
            yield block


class _Log:
    """One log on its way: its clocks by stream, and its channels by topic."""

    def __init__(
        self, source: LogSource, plan: ImportPlan, mapping: ImportMap, after: int
    ) -> None:
        self._source, self._plan = source, plan
        self._time = mapping.time or TimeMap(rate=1.0)
        self._rate = _POINTS if self._time.steady else self._time.rate
        self._groups = groups_of(plan)
        self._clocks: dict[str, LogClock] = {}
        self._after = after
        self._shift: int | None = None
        self._rows = 0
        self.notes: list[str] = []

    @property
    def end(self) -> int:
        """Stamp of the last row, ns."""
        return max(clock.last or 0 for clock in self._clocks.values())

    def add(self, block: LogBlock) -> Written:
        """Convert a block; return what can be written."""
        self.notes += [f'{self._source.path.name}: {note}' for note in block.notes]
        if not len(block):
            return {}
        clock = self._clocks.get(block.stream)
        if clock is None:
            where = f'{self._source.path}' + (f': {block.stream}' if self._source.is_bag else '')
            clock = self._clocks[block.stream] = LogClock(
                where, tuple(unit for _, unit in self._plan.time), self._shift or 0
            )
        raw = self._raw(block, clock)
        if self._shift is None and (raw >= 0).any():
            self._shift = max(0, self._after + PAUSE - int(raw[raw >= 0].min()))
            clock.shift = self._shift
        rows = clock.order(raw)
        for group in self._groups.values():
            group.add(block.stream, block.values, rows)
        return {topic: group.take(final=False) for topic, group in self._groups.items()}

    def finish(self) -> Written:
        """Return what is left; InputError where the times are of no use."""
        if not self._clocks:
            raise InputError(f'{self._source.path}: no rows of what the map names')
        for clock in self._clocks.values():
            clock.check()
            self.notes += [f'{clock.where}: {note}' for note in clock.notes()]
        filled = {name: share for g in self._groups.values() for name, share in g.filled.items()}
        self.notes += [
            f'{self._source.path.name}: {name!r} has a value in {share:.1%} of the rows, and '
            'counts there'
            for name, share in filled.items()
        ]
        return {topic: group.take(final=True) for topic, group in self._groups.items()}

    def _raw(self, block: LogBlock, clock: LogClock) -> Stamps:
        """Times of a block in ns, -1 where they are missing."""
        if block.log_ns is not None:
            if self._plan.stamp == 'log':
                return block.log_ns
            if block.header_ns is None or not block.header_ns.any():
                raise InputError(
                    f'{clock.where}: the messages have no time of their own; '
                    'use time: {stamp: log} in the map'
                )
            return np.where(block.header_ns > 0, block.header_ns, -1)
        if self._rate is not None:
            index = np.arange(self._rows, self._rows + len(block))
            self._rows += len(block)
            return START * 10**9 + np.rint(index * (1e9 / self._rate)).astype(np.int64)
        addresses = [column.address for column, _ in self._plan.time]
        for address in addresses:
            if address not in block.values:
                raise InputError(
                    f'{clock.where}: {next(iter(block.values))} has {len(block)} rows, the time '
                    f'column {address} has others; name columns of one length'
                )
        return clock.nanoseconds([block.values[address] for address in addresses])


def groups_of(plan: ImportPlan) -> dict[str, ChannelGroup]:
    """Return the channels to be written, grouped by the topic that holds them."""
    parts: dict[str, list[tuple[str, LogChannel]]] = {name: [] for name in TOPICS}
    of_joints = {q: topic for topic, fields in _JOINT_FIELDS.items() for q in fields}
    measured = _having(plan, 'current', 'power')
    for drive, channels in plan.drives.items():
        for quantity, channel in channels.items():
            topic = of_joints.get(quantity, 'drive_supply')
            if topic == 'motor_temperature' and drive in measured:
                topic = 'drive_supply'
            if topic != 'drive_supply' or drive in measured:
                parts[topic].append((drive, channel))
    parts['supply'] = [('', channel) for channel in plan.supply.values()]
    return {
        name: ChannelGroup(channels, derived=plan.derived if name == 'joint_states' else ())
        for name, channels in parts.items()
        if channels
    }


def _units(plan: ImportPlan) -> dict[str, dict[str, str]]:
    """Return the units of the map or the log by drive ('' of the supply and time) and quantity."""
    given = {
        drive: {q: c.unit for q, c in own.items() if c.unit and q in UNITS}
        for drive, own in {**plan.drives, '': plan.supply}.items()
    }
    if plan.time:
        given['']['time'] = plan.time[0][1]
    return {
        drive: {q: common_name(q, conversion(unit, q).factor) for q, unit in own.items()}
        for drive, own in given.items()
    }


def _card(
    mapping: ImportMap,
    plan: ImportPlan,
    measured: Sequence[str],
    sources: Sequence[LogSource],
    where: str,
    notes: Sequence[str],
) -> Card:
    content: dict[str, Any] = {
        'drives': list(measured),
        'software': f'power_recordings import {version("power_recordings")}',
        **mapping.card,
        'torque': dict(plan.torque_at),
        'torque_unit': dict(plan.torque_unit),
        'power': dict.fromkeys(plan.computed, 'computed'),
        'gear_ratio': dict(plan.gear_ratio),
        'steady': mapping.time is not None and mapping.time.steady,
        'imported': {
            'from': [source.path.name for source in sources],
            'map': where,
            'columns': plan.columns(),
            'units': _units(plan),
            'scales': {
                drive: {q: float(c.scale) for q, c in own.items() if c.scale != 1.0}
                for drive, own in plan.drives.items()
            },
            'positive': {
                drive: {q: c.positive for q, c in own.items() if q in ('current', 'power')}
                for drive, own in {**plan.drives, '': plan.supply}.items()
            },
        },
    }
    if plan.derived:
        content['imported']['velocity'] = dict.fromkeys(plan.derived, 'rate of position')
    if notes:
        content['imported']['notes'] = list(notes)
    return Card.of(content)
