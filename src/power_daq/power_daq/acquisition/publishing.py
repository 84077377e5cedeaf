"""Conversion of samples to ROS messages, and the thread that publishes them."""

from array import array
from collections.abc import Callable, Sequence
from math import nan

import numpy as np
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from wattwalk_core.worker import Worker

from drive_power_msgs.msg import DriveSupply
from power_daq.acquisition.bus_acquisition import SampleQueue
from power_daq.acquisition.receiver import Sample

_S = 1_000_000_000
_TEMPERATURE_LIFETIME = 2 * _S
_READ = 0.1


def _set_stamp(header: Header, nanoseconds: int) -> None:
    header.stamp.sec, header.stamp.nanosec = divmod(nanoseconds, _S)


class SupplyPublisher:
    """Packs samples of voltage and current into DriveSupply.

    A message holds samples_per_message consecutive samples, or fewer where one was lost, so that
    its sequence gives the index of each. Winding temperatures are the newest of the drives in
    with_temperature, and are left out once they are older than 2 s. The message object is reused:
    publishing serialises it.
    """

    def __init__(
        self,
        publisher: Publisher,
        drives: Sequence[str],
        frame_id: str,
        samples_per_message: int = 1,
        with_temperature: Sequence[str] = (),
    ) -> None:
        self._publisher = publisher
        self._message = DriveSupply()
        self._message.header.frame_id = frame_id
        self._message.name = list(drives)
        self._size = samples_per_message
        self._samples: list[Sample] = []
        self._columns = [
            with_temperature.index(drive) if drive in with_temperature else None
            for drive in drives
        ]
        self._temperature_stamp: int | None = None

    def take(self, sample: Sample) -> int:
        """Take a sample, publish the messages it completes; return how many samples went out."""
        samples, sent = self._samples, 0
        if samples and sample.sequence != samples[-1].sequence + 1:
            sent += self.flush()
        samples.append(sample)
        if len(samples) >= self._size:
            sent += self.flush()
        return sent

    def take_temperature(self, sample: Sample) -> int:
        """Take winding temperatures, °C, which the next messages carry; return 1, as `take`."""
        celsius = [nan if c is None else sample.values[0, c] for c in self._columns]
        self._message.temperature = array('f', celsius)
        self._temperature_stamp = sample.stamp
        return 1

    def flush(self) -> int:
        """Publish the samples that were taken but not yet published, and return their number."""
        samples, message = self._samples, self._message
        if not samples:
            return 0
        first = samples[0]
        _set_stamp(message.header, first.stamp)
        message.sequence = first.sequence
        message.device_time = array('Q', [max(0, sample.device_time) for sample in samples])
        values = first.values
        if len(samples) > 1:
            values = np.concatenate([sample.values for sample in samples], axis=1)
        packed = values.astype(np.float32)
        message.voltage = array('f', packed[0].tobytes())
        message.current = array('f', packed[1].tobytes())
        message.status = array('B', values[2].astype(np.uint8).tobytes())
        warmth = self._temperature_stamp
        if warmth is not None and abs(first.stamp - warmth) > _TEMPERATURE_LIFETIME:
            message.temperature = array('f')
            self._temperature_stamp = None
        self._publisher.publish(message)
        sent = len(samples)
        samples.clear()
        return sent


class JointStatePublisher:
    """Publishes samples of position, velocity and torque as JointState."""

    def __init__(self, publisher: Publisher, drives: Sequence[str]) -> None:
        self._publisher = publisher
        self._message = JointState()
        self._message.name = list(drives)

    def take(self, sample: Sample) -> int:
        """Publish a sample; return 1, the number that went out."""
        message, values = self._message, sample.values
        _set_stamp(message.header, sample.stamp)
        message.position = array('d', values[0].tobytes())
        message.velocity = array('d', values[1].tobytes())
        message.effort = array('d', values[2].tobytes())
        self._publisher.publish(message)
        return 1


class PublishingThread(Worker):
    """Publishes the samples of a queue, so that a slow subscriber does not delay the bus.

    When asked to end, it empties the queue and then calls finish.
    """

    def __init__(
        self,
        queue: SampleQueue,
        publish: Callable[[Sample], None],
        finish: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__('publishing')
        self._queue = queue
        self._publish, self._finish = publish, finish

    def _work(self) -> None:
        while True:
            sample = self._queue.get(_READ)
            if sample is not None:
                self._publish(sample)
            elif self._stop.is_set():
                self._finish()
                return
