"""Conversion of frames to stamped samples: clocks, assembly, calibration, fault counts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import can
import numpy as np
from power_recordings.calibration import Calibration
from wattwalk_core.arrays import Floats

from power_daq.acquisition.assembly import Assembled, Assembler
from power_daq.acquisition.stream_merger import CYCLIC, MergedRow, StreamMerger
from power_daq.bus.description import DEVICE_ERROR, STALE, BusDescription
from power_daq.bus.frame import Frame, FrameGroup
from power_daq.clock.mapping import ClockMapping, RosTime, Stamper

_STATUS = 2
_HOLD = 0.5  # periods; replies to one round of queries belong together, also where rounds are late


class Interleaver:
    """Merges the frames of one group, which have no counter, into samples.

    A sample is taken at each arrival of the group's first frame that is not silent; a frame is
    silent once it lags the newest by more than 2.5 periods. Values of the other frames are
    interpolated linearly to that time, NaN over gaps of more than 2.5 periods; status flags come
    from the later frame. The counts (received, lost, missing, duplicates, counter_jumps) are
    those of an Assembler, with losses inferred from gaps in time.
    """

    counter_jumps = 0

    def __init__(self, group: FrameGroup) -> None:
        self._group = group
        self.merger: StreamMerger[bytes] = StreamMerger(
            len(group.frames), 1e9 / group.rate, b'', CYCLIC, _HOLD
        )
        self._absent = [bytes(frame.size) for frame in group.frames]
        self._mapped = group.slots >= 0
        self._slots = np.maximum(group.slots, 0)
        self.received = 0

    @property
    def lost(self) -> int:
        """Number of samples that did not come, by the gaps of the frames they are timed by."""
        return self.merger.lost

    @property
    def missing(self) -> list[int]:
        """Number of lost frames of each slot, by the gaps in their arrival times."""
        return self.merger.missing

    @property
    def duplicates(self) -> int:
        """Number of frames that were received before the one before them."""
        return self.merger.out_of_order

    def add(self, slot: int, arrival: int, payload: bytes) -> list[Assembled]:
        """Take the frame of a slot that arrived at a steady time in ns; return full samples."""
        rows = self.merger.add(slot, arrival, payload)
        self.received += len(rows)
        return [self._assembled(row) for row in rows]

    def _assembled(self, row: MergedRow[bytes]) -> Assembled:
        weight = np.where(self._mapped, np.array(row.weight)[self._slots], 1.0)
        right = self._decode(row.right)
        if (weight == 1.0).all():
            return Assembled(row.number, row.time, right)
        left = self._decode(row.left)
        with np.errstate(invalid='ignore'):
            values = np.where(weight == 1.0, right, left + weight * (right - left))
        if 'status' in self._group.quantities:
            values[_STATUS] = right[_STATUS]  # flags are not interpolated
        return Assembled(row.number, row.time, values, np.isnan(weight))

    def _decode(self, payloads: Sequence[bytes]) -> Floats:
        pairs = zip(payloads, self._absent, strict=True)
        return self._group.decode([payload or absent for payload, absent in pairs])


_REMEMBERED_IDS = 16


class Sample(NamedTuple):
    """One sample of the drives of a group: electrical, joints or temperature.

    sequence: index of the sample (a gap is a loss); stamp: ROS time of the measurement in ns;
    device_time: on the device's clock in ns; values: [Q, D] in SI units.
    """

    group: str
    sequence: int
    stamp: int
    device_time: int
    values: Floats


@dataclass
class FrameCounts:
    """Numbers of frames from the bus since the start, by kind."""

    frames: int = 0
    payload_bytes: int = 0
    mapped: int = 0
    unmapped: int = 0
    unknown: int = 0
    error_frames: int = 0
    remote_frames: int = 0
    wrong_length: int = 0
    unsettled: int = 0
    malformed_packets: int = 0


class Receiver:
    """Converts frames, one by one, to complete stamped samples, without threads or waiting.

    transport_delay: known least time in ns from sample to arrival, which the fit cannot observe;
    it is subtracted from the stamps.
    """

    def __init__(
        self,
        description: BusDescription,
        ros_time: RosTime,
        calibration: Calibration | None = None,
        transport_delay: int = 0,
    ) -> None:
        self._description = description
        self.ros_time = ros_time
        self._calibration = calibration
        self._delay = transport_delay
        self.clocks = {
            name: ClockMapping(tick, bits) for name, (tick, bits) in description.clocks.items()
        }
        self.assemblers: dict[str, Assembler | Interleaver] = {
            name: Interleaver(group) if group.counter_bits is None else Assembler(group)
            for name, group in description.groups.items()
        }
        self._routes = description.routes
        self._polled = description.polled
        self._first_clock = {
            name: group.frames[0].clock for name, group in description.groups.items()
        }
        self._stampers = {name: Stamper(ros_time) for name in description.groups}
        self.counts = FrameCounts()
        self.unsettled: Counter[str] = Counter()
        self.not_finite: Counter[str] = Counter()
        self.unknown_ids: Counter[int] = Counter()
        self.wrong_lengths: Counter[str] = Counter()
        self.last_mapped = 0

    def take(self, message: can.Message, arrival: int) -> list[Sample]:
        """Return the samples that a frame completes; arrival in ns on the steady clock."""
        counts = self.counts
        counts.frames += 1
        counts.payload_bytes += len(message.data)
        if message.is_error_frame:
            counts.error_frames += 1
            return []
        if message.is_remote_frame:
            counts.remote_frames += 1
            return []
        key = message.arbitration_id | message.is_extended_id << 31
        frames = self._routes.get(key)
        if frames is None:
            if key in self._description.known:
                counts.unmapped += 1
                return []
            counts.unknown += 1
            if key in self.unknown_ids or len(self.unknown_ids) < _REMEMBERED_IDS:
                self.unknown_ids[key] += 1
            return []
        self.ros_time.follow(arrival)
        data = message.data
        if self._polled is not None:
            data = bytearray(self._polled.payload(bytes(data)))
        return [sample for frame in frames for sample in self._follow(frame, data, arrival)]

    def _follow(self, frame: Frame, data: bytearray, arrival: int) -> list[Sample]:
        if len(data) != frame.size:
            self.counts.wrong_length += 1
            self.wrong_lengths[f'{frame.name}: {len(data)} bytes, not {frame.size}'] += 1
            return []
        if frame.selected is not None and frame.selected[0].read(data) != frame.selected[1]:
            return []
        self.counts.mapped += 1
        self.last_mapped = arrival
        assembler = self.assemblers.get(frame.group)
        if frame.time_and_counter is None:
            assert isinstance(assembler, Interleaver)
            return [
                self._sample(frame.group, done, done.device_time, 0)
                for done in assembler.add(frame.slot, arrival, bytes(data))
            ]
        time, counter = frame.time_and_counter
        clock = self.clocks[frame.clock]
        epoch = clock.epoch
        device_time = clock.update(time.read(data), arrival)
        if clock.epoch != epoch and not clock.settled:
            self._restart(frame.clock)
        if not isinstance(assembler, Assembler):
            return []
        raw = counter.read(data)
        done = assembler.add(frame.slot, raw, device_time, arrival, bytes(data))
        if done is None:
            return []
        clock = self.clocks[self._first_clock[frame.group]]
        if not clock.settled:
            self.counts.unsettled += 1
            self.unsettled[frame.group] += 1
            return []
        steady = clock.to_steady(done.device_time)
        return [self._sample(frame.group, done, steady, clock.epoch)]

    def _sample(self, group: str, done: Assembled, steady: int, epoch: int) -> Sample:
        """Return a sample taken at a steady time in ns, calibrated, its faults flagged."""
        values = done.values
        if group == 'electrical' and self._calibration is not None:
            values[:2] = values[:2] * self._calibration.gain + self._calibration.offset
        if done.stale is not None or not np.isfinite(values).all():
            self._flag(group, done)
        stamp = self._stampers[group].of(steady - self._delay, epoch)
        return Sample(group, done.number, stamp, done.device_time, values)

    def _flag(self, group: str, done: Assembled) -> None:
        """Count values that are no numbers, and flag those of voltage and current."""
        stale = np.zeros(done.values.shape, bool) if done.stale is None else done.stale
        wrong = ~np.isfinite(done.values) & ~stale
        if group != 'temperature':  # no thermistor, no number
            self.not_finite[group] += bool(wrong.any())
        if group == 'electrical':
            status = done.values[2]
            status[stale[:2].any(axis=0)] = STALE
            status[wrong[:2].any(axis=0)] = DEVICE_ERROR

    def _restart(self, clock: str) -> None:
        """Restart the counters of the frames of a device that has restarted."""
        for name, group in self._description.groups.items():
            assembler = self.assemblers[name]
            is_of_it = any(frame.clock == clock for frame in group.frames)
            if is_of_it and isinstance(assembler, Assembler):
                assembler.restart()

    @property
    def losses(self) -> Mapping[str, int]:
        """Number of lost samples by group."""
        return {name: assembler.lost for name, assembler in self.assemblers.items()}
