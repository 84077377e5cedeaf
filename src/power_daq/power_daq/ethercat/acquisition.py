"""The thread that exchanges a frame each cycle with an EtherCAT segment and reopens it."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray
from power_recordings.calibration import Calibration
from wattwalk_core.arrays import Floats
from wattwalk_core.nodes.diagnostics import CountChanges, Level, LogTarget, Report, faults
from wattwalk_core.worker import DeviceWorker

from drive_power_msgs.msg import DriveSupply
from power_daq.acquisition.bus_acquisition import SampleQueue
from power_daq.acquisition.receiver import Sample
from power_daq.clock.mapping import RosTime, Slots, Stamper
from power_daq.ethercat.mapping import SegmentMapping
from power_daq.ethercat.soem import SoemSegment
from power_daq.ethercat.terminals import SegmentError, SlaveIdentity, TerminalType, describe

Flags = NDArray[np.uint8]
_GONE = DriveSupply.STALE | DriveSupply.DEVICE_ERROR


def check_order(wanted: Sequence[TerminalType], found: Sequence[SlaveIdentity]) -> None:
    """Raise SegmentError for the first position with a wrong, missing or additional slave."""
    for place, (kind, there) in enumerate(zip_longest(wanted, found)):
        if kind is None:
            raise SegmentError(
                f'{describe(there)} at position {place} is not in the mapping, which ends after '
                f'{len(wanted)}'
            )
        if there is None:
            raise SegmentError(
                f'{kind} should be at position {place}, but the segment ends after '
                f'{len(found)} of {len(wanted)} slaves: check cables and power behind it'
            )
        if not kind.is_it(there):
            raise SegmentError(f'{kind} should be at position {place}, there is {describe(there)}')


def assert_settings(
    segment: SoemSegment,
    wanted: Sequence[TerminalType],
    stopped: Callable[[], bool] = lambda: False,
) -> list[str]:
    """Write the terminals' settings where they differ, read them back, and list what was changed.

    Ends before the next setting once stopped() is true. SegmentError for a setting that cannot be
    changed: a filter would remove what is to be measured.
    """
    changed: list[str] = []
    for place, kind in enumerate(wanted):
        for index, subindex, meaning in kind.settings():
            if stopped():
                return changed
            if not _read(segment, place, index, subindex):
                continue
            segment.write(place, index, subindex, b'\0')
            if found := _read(segment, place, index, subindex):
                raise SegmentError(
                    f'{meaning} of {kind.name} at position {place} cannot be switched off: '
                    f'{index:#06x}:{subindex:02x} was set to 0 and is {found}'
                )
            changed.append(f'{meaning} of {kind.name} at {place} ({index:#06x}) switched off')
    return changed


def check_inputs(segment: SoemSegment, wanted: Sequence[TerminalType]) -> None:
    """Raise SegmentError for a terminal whose process data have another size."""
    for place, kind in enumerate(wanted):
        size, wanted_size = len(segment.inputs(place)), 4 * kind.channels
        if size != wanted_size:
            raise SegmentError(
                f'{kind.name} at position {place} has {size} bytes of inputs, not '
                f'{wanted_size}: give it the standard process data with status '
                '(0x1C13 = 0x1A00, 0x1A02); revisions up to 0x0016 have none such'
            )


def _read(segment: SoemSegment, slave: int, index: int, subindex: int) -> int:
    return int.from_bytes(segment.read(slave, index, subindex)[:1], 'little')


@dataclass(frozen=True)
class SegmentPatience:
    """Pauses in s between attempts to open a segment; cycles in a row without all slaves."""

    first_retry: float = 0.1
    last_retry: float = 5.0
    bad_cycles: int = 50


@dataclass
class CycleCounts:
    """Numbers of events since the start; all but cycles and times operating are faults."""

    cycles: int = 0
    times_operating: int = 0
    frames_lost: int = 0
    slaves_missing: int = 0
    stale: int = 0
    underrange: int = 0
    overrange: int = 0
    device_errors: int = 0


class SegmentAcquisition(DeviceWorker):
    """Exchanges process data each cycle, and hands samples to a sink.

    The value in a frame was converted after the frame before, which triggered it (filter off:
    synchronous mode), so a sample has the time of the frame before. Cycles are slots of the steady
    clock: one without a frame is a gap in the sequence. A channel whose toggle bit has not changed
    has no new value: NaN with STALE. After bad_cycles in a row without all slaves the segment is
    opened again, with growing pauses.
    """

    def __init__(
        self,
        mapping: SegmentMapping,
        make_segment: Callable[[], SoemSegment],
        sink: Callable[[Sample], None],
        log: LogTarget,
        calibration: Calibration | None = None,
        patience: SegmentPatience | None = None,
        ros_time: RosTime | None = None,
    ) -> None:
        self.mapping = mapping
        self.ros_time = ros_time or RosTime()
        self._stamper = Stamper(self.ros_time)
        self.counts = CycleCounts()
        self.absence = 'not opened yet'
        self._make, self._sink, self._log = make_segment, sink, log
        self._patience = patience or SegmentPatience()
        self._channels = tuple(mapping.channels())
        self._ratio = np.array([channel.ratio for channel in self._channels])
        self._offset = np.array([channel.offset for channel in self._channels])
        if calibration is not None:
            gain = calibration.gain.ravel()
            self._ratio = gain * self._ratio
            self._offset = gain * self._offset + calibration.offset.ravel()
        self._toggles: list[bool | None] = [None] * len(self._channels)
        self._slots = Slots(mapping.cycle)
        super().__init__('ethercat', self._patience.first_retry, self._patience.last_retry)

    @property
    def lost(self) -> int:
        """Cycles without a sample since the first one."""
        return self._slots.lost(self.counts.cycles)

    @property
    def _given(self) -> int:
        return self.counts.cycles

    def _serve_once(self) -> None:
        segment = self._make()
        try:
            expected = self._bring_up(segment)
            if expected is not None:
                self._exchange(segment, expected)
        except SegmentError as error:
            if str(error) != self.absence:
                self._log.warning(f'EtherCAT: {error}; will try again')
            self.absence = str(error)
        finally:
            segment.close()

    def _bring_up(self, segment: SoemSegment) -> int | None:
        """Return the working counter of a complete exchange; None if asked to end before."""
        wanted = self.mapping.segment
        check_order(wanted, segment.find())
        for line in assert_settings(segment, wanted, self._stop.is_set):
            self._log.warning(f'EtherCAT: {line}')
        if self._stop.is_set():
            return None
        expected = segment.operate()
        check_inputs(segment, wanted)
        self.absence = ''
        self.counts.times_operating += 1
        names = ', '.join(kind.name for kind in wanted)
        self._log.info(f'EtherCAT: operating {names}')
        return expected

    def _exchange(self, segment: SoemSegment, expected: int) -> None:
        self._toggles = [None] * len(self._channels)
        triggered: int | None = None
        bad = 0
        for slot in self._slots.each(self._stop):
            before = time.monotonic_ns()
            counter = segment.exchange()
            middle = (before + time.monotonic_ns()) // 2
            self.ros_time.follow(middle)
            if counter < 0:
                self.counts.frames_lost += 1
                triggered = None
            else:
                incomplete = counter < expected
                self.counts.slaves_missing += incomplete
                values, flags = self._read_channels(segment, incomplete)
                if triggered is not None:
                    self._emit(slot, triggered, values, flags)
                triggered = middle
            bad = bad + 1 if counter < expected else 0
            if bad >= self._patience.bad_cycles:
                if counter < 0:
                    what = f'no frame came back for {bad} cycles: check the cable to the coupler'
                    raise SegmentError(what)
                raise SegmentError(
                    f'working counter {counter} instead of {expected} for {bad} cycles: '
                    'a slave has dropped out'
                )

    def _read_channels(self, segment: SoemSegment, incomplete: bool) -> tuple[Floats, Flags]:
        """Return volts and flags of each channel in the last frame."""
        values = np.empty(len(self._channels))
        flags = np.zeros(len(self._channels), np.uint8)
        inputs = [segment.inputs(place) for place in range(len(self.mapping.segment))]
        for number, place in enumerate(self._channels):
            kind = self.mapping.segment[place.terminal]
            channel = kind.channel(inputs[place.terminal], place.channel)
            values[number], flags[number] = channel.volts, channel.flags
            stale = channel.toggle == self._toggles[number]
            if stale:
                flags[number] |= _GONE if incomplete else DriveSupply.STALE
            if stale or not channel.valid:
                values[number] = np.nan
            self._toggles[number] = channel.toggle
        return values, flags

    def _emit(self, slot: int, triggered: int, values: Floats, flags: Flags) -> None:
        counts, seen = self.counts, np.bitwise_or.reduce(flags)
        counts.stale += bool(seen & DriveSupply.STALE)
        counts.underrange += bool(seen & DriveSupply.UNDERRANGE)
        counts.overrange += bool(seen & DriveSupply.OVERRANGE)
        counts.device_errors += bool(seen & DriveSupply.DEVICE_ERROR)
        voltage, current = np.split(values * self._ratio + self._offset, 2)
        status = np.bitwise_or(*np.split(flags, 2))
        stamp = self._stamper.of(triggered)
        counts.cycles += 1
        packed = np.stack([voltage, current, status.astype(np.float64)])
        self._sink(Sample('electrical', slot, stamp, triggered, packed))


_RATE_SLACK = 0.02
_NO_FAULT = ('cycles', 'times operating')


class SegmentHealth:
    """Reports on an acquisition, by the changes of its counts since the report before."""

    def __init__(
        self, acquisition: SegmentAcquisition, queue: SampleQueue, interface: str
    ) -> None:
        self._acquisition, self._queue, self._interface = acquisition, queue, interface
        self._changes = CountChanges()

    def report(self, now: float) -> Report:
        """Return the state since the report before; now in s on a steady clock."""
        acquisition = self._acquisition
        counts = {name.replace('_', ' '): n for name, n in vars(acquisition.counts).items()}
        counts['cycles lost'] = acquisition.lost
        counts['samples dropped unpublished'] = self._queue.dropped
        counts['steps of the system clock'] = acquisition.ros_time.steps
        news, span = self._changes.since_last(counts, now)
        mapping = acquisition.mapping
        figures = {
            'interface': self._interface,
            'segment': ', '.join(kind.name for kind in mapping.segment),
            'segment state': acquisition.absence or 'operating',
        }
        rate = news['cycles'] / span if span > 0 else None
        if rate is not None:
            figures['electrical rate [Hz]'] = f'{rate:.1f}'
        figures |= {name: str(count) for name, count in counts.items()}
        figures['samples waiting'] = str(len(self._queue))
        return Report(*self._judge(news, rate), figures)

    def _judge(self, news: Mapping[str, float], rate: float | None) -> tuple[Level, str]:
        acquisition = self._acquisition
        if acquisition.absence:
            return Level.ERROR, f'segment absent: {acquisition.absence}'
        if found := faults(news, lambda name: name not in _NO_FAULT):
            return Level.WARN, f'in the last second: {found}'
        nominal = 1.0 / acquisition.mapping.cycle
        if rate is not None and rate < (1 - _RATE_SLACK) * nominal:
            return Level.WARN, f'electrical at {rate:.0f} Hz, not {nominal:.0f} Hz'
        return Level.OK, 'measuring'
