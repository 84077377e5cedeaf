"""Conversion of frames to stamped samples: clocks, assembly, calibration, fault counts."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import can
from power_recordings.calibration import Calibration

from power_daq.acquisition.assembly import Assembler
from power_daq.bus.description import BusDescription
from power_daq.bus.frame_group import Route
from power_daq.bus.signal_layout import Floats
from power_daq.clock.mapping import ClockMapping, RosTime, Stamper

_REMEMBERED_IDS = 16


class Sample(NamedTuple):
    """
    One sample of the drives of a group: electrical, joints or temperature.

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
    """
    Converts frames, one by one, to complete stamped samples, without threads or waiting.

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
        self._ros_time = ros_time
        self._calibration = calibration
        self._delay = transport_delay
        self.clocks = {
            name: ClockMapping(tick, bits) for name, (tick, bits) in description.clocks.items()
        }
        self.assemblers = {name: Assembler(group) for name, group in description.groups.items()}
        self._routes = description.routes
        self._first_clock = {
            name: group.frames[0].clock for name, group in description.groups.items()
        }
        self._stampers = {name: Stamper(ros_time) for name in description.groups}
        self.counts = FrameCounts()
        self.unsettled: Counter[str] = Counter()
        self.unknown_ids: Counter[int] = Counter()
        self.wrong_lengths: Counter[str] = Counter()
        self.last_mapped = 0

    @property
    def ros_time(self) -> RosTime:
        """The mapping of steady to ROS time in use."""
        return self._ros_time

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
        routes = self._routes.get(key)
        if routes is None:
            self._count_unrouted(key)
            return []
        self._ros_time.follow(arrival)
        samples = []
        for route in routes:
            sample = self._follow(route, message.data, arrival)
            if sample is not None:
                samples.append(sample)
        return samples

    def _count_unrouted(self, key: int) -> None:
        if key in self._description.known:
            self.counts.unmapped += 1
            return
        self.counts.unknown += 1
        if key in self.unknown_ids or len(self.unknown_ids) < _REMEMBERED_IDS:
            self.unknown_ids[key] += 1

    def _follow(self, route: Route, data: bytearray, arrival: int) -> Sample | None:
        if len(data) != route.size:
            self.counts.wrong_length += 1
            self.wrong_lengths[f'{route.message}: {len(data)} bytes, not {route.size}'] += 1
            return None
        if route.selector is not None and route.selector[0].read(data) != route.selector[1]:
            return None
        self.counts.mapped += 1
        self.last_mapped = arrival
        clock = self.clocks[route.clock]
        epoch = clock.epoch
        device_time = clock.update(route.time.read(data), arrival)
        if clock.epoch != epoch and not clock.settled:
            self._restart(route.clock)
        assembler = self.assemblers.get(route.group)
        if assembler is None:
            return None
        done = assembler.add(
            route.slot, route.counter.read(data), device_time, arrival, bytes(data)
        )
        if done is None:
            return None
        clock = self.clocks[self._first_clock[route.group]]
        if not clock.settled:
            self.counts.unsettled += 1
            self.unsettled[route.group] += 1
            return None
        values = done.values
        if route.group == 'electrical' and self._calibration is not None:
            values[:2] = values[:2] * self._calibration.gain + self._calibration.offset
        steady = clock.to_steady(done.device_time) - self._delay
        stamp = self._stampers[route.group].of(steady, clock.epoch)
        return Sample(route.group, done.number, stamp, done.device_time, values)

    def _restart(self, clock: str) -> None:
        """Restart the counters of the frames of a device that has restarted."""
        for name, group in self._description.groups.items():
            if any(frame.clock == clock for frame in group.frames):
                self.assemblers[name].restart()

    @property
    def losses(self) -> Mapping[str, int]:
        """Samples lost by group."""
        return {name: assembler.lost for name, assembler in self.assemblers.items()}
