"""The DAQ node: publishes supply and joint states of drives from their bus or meters."""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from power_recordings.calibration import NONE, label
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from wattwalk_core.nodes.diagnostics import FaultLog, Reporter
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.nodes.running import run_node

from drive_power_msgs.msg import DriveSupply
from power_daq.acquisition.bus_acquisition import SampleQueue
from power_daq.acquisition.publishing import JointStatePublisher, PublishingThread, SupplyPublisher
from power_daq.acquisition.receiver import Sample
from power_daq.device import open_device
from power_daq.nodes.card_topic import publish_card

_PERIOD = 1.0
_PUBLISHING_ENDS = 10.0
_DELIVERED = 3.0  # s that reliable subscriptions have for the last messages
_QUEUED_SAMPLES = 4000
_LOSSLESS = QoSProfile(depth=1000)  # reliable


class DaqNode(Node):
    """Publishes drive_supply, joint_states and diagnostics; InputError for bad parameters."""

    def __init__(self) -> None:
        super().__init__('power_daq')
        given = DeviceParameters(self)
        self._queue = SampleQueue(_QUEUED_SAMPLES)
        self._supply: SupplyPublisher | None = None
        self._device = device = open_device(given, self._queue, FaultLog(self.get_logger()))
        applied = self.get_parameter('calibration').value
        calibration = label(Path(applied).expanduser()) if applied else NONE
        publish_card(self, replace(device.card, calibration=calibration))
        frame_id = given.text('frame_id', device.device, 'frame_id of drive_supply')
        per_message = given.whole('samples_per_message', 1, 'samples in a drive_supply', 1, 1000)
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning('use_sim_time: samples of a device are in system time')
        self._publishers_by_group = self._make_publishers(frame_id, per_message)
        self._publishing = PublishingThread(self._queue, self._publish, self._flush)
        self._acquisition = device.acquisition
        self._reporter = Reporter(self, device.part, device.hardware)
        self.create_timer(_PERIOD, self._diagnose, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._publishing.start()
        self._acquisition.start()

    def _make_publishers(
        self, frame_id: str, per_message: int
    ) -> dict[str, Callable[[Sample], int]]:
        """Return by group the function that publishes a sample and returns how many went out."""
        made: dict[str, Callable[[Sample], int]] = {}
        drives = self._device.drives
        if 'electrical' in drives:
            supply = SupplyPublisher(
                self.create_publisher(DriveSupply, 'drive_supply', _LOSSLESS),
                drives['electrical'],
                frame_id,
                per_message,
                drives.get('temperature', ()),
            )
            self._supply = supply
            made = {'electrical': supply.take, 'temperature': supply.take_temperature}
        if 'joints' in drives:
            publisher = self.create_publisher(JointState, 'joint_states', _LOSSLESS)
            made['joints'] = JointStatePublisher(publisher, drives['joints']).take
        return made

    def _publish(self, sample: Sample) -> None:
        if publish := self._publishers_by_group.get(sample.group):
            self._count(sample.group, partial(publish, sample))

    def _flush(self) -> None:
        if self._supply is not None:
            self._count('electrical', self._supply.flush)

    def _count(self, group: str, publish: Callable[[], int]) -> None:
        try:
            self._queue.published[group] += publish()
        except RuntimeError:
            if self.context.ok():
                raise

    def _diagnose(self) -> None:
        if self._acquisition.failed or self._publishing.failed:
            self.stop()
            return
        self._reporter.say(self._device.report(time.monotonic()))

    def stop(self) -> None:
        """End both threads and publish waiting samples; raise the error of a failed thread."""
        self._acquisition.stop()
        try:
            self._end_acquisition()
        finally:
            self._publishing.stop()
            if not self._publishing.join(_PUBLISHING_ENDS):
                self.get_logger().error(f'{len(self._queue)} samples were not published')
            elif self.context.ok():
                self._deliver()

    def _deliver(self) -> None:
        # A writer that is destroyed forgets what a busy subscription has not fetched yet.
        end = time.monotonic() + _DELIVERED
        for publisher in self.publishers:
            left = max(end - time.monotonic(), 0.0)
            if not publisher.wait_for_all_acked(Duration(seconds=left)):
                self.get_logger().warning(f'{publisher.topic_name}: last messages not delivered')

    def _end_acquisition(self) -> None:
        device, logger = self._device, self.get_logger()
        if self._acquisition.join(min(_PERIOD, device.ending)):
            return
        left = device.ending - _PERIOD
        if left > 0:
            logger.warning(f'waiting up to {left:.0f} s for {device.hardware} to end')
        if not self._acquisition.join(max(left, 0.0)):
            logger.error(
                f'{device.hardware} did not end within {device.ending:.0f} s: {device.abandoned}'
            )


def run(options: argparse.Namespace) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters, 1 for a failed device."""
    return run_node(DaqNode, options.ros_args)
