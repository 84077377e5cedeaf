"""Telemetry as the messages of a bag."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter, MessageBlock
from wattwalk_core.anymal import FOOT_NAMES

from sim_bridge.offline.session import Event
from sim_bridge.offline.telemetry import START_NS, Telemetry

_SECOND: Final = 1_000_000_000
_TYPES: Final = {
    'drive_supply': cdr.DRIVE_SUPPLY,
    'joint_states': cdr.JOINT_STATE,
    'joint_commands': cdr.JOINT_STATE,
    'supply': cdr.BATTERY_STATE,
    'diagnostics': cdr.DIAGNOSTIC_ARRAY,
    'imu': cdr.IMU,
    'odom': cdr.ODOMETRY,
    'foot_force': cdr.JOINT_STATE,
    'cmd_vel': cdr.TWIST_STAMPED,
}


class BagTopics:
    """Writer of telemetry to the topics that the live system records, in the order of time."""

    def __init__(
        self, bag: BagWriter, joints: Sequence[str], measured: Sequence[str], device: str
    ) -> None:
        """joints: of joint_states; measured: of drive_supply; device: its frame_id."""
        self._bag = bag
        self._topics: dict[str, int] = {}
        self._samples = 0
        self._seconds = 0
        self._counts = {'fall': 0, 'push': 0}
        of_joints = partial(cdr.joint_state_block, names=joints)
        self._encoders: dict[str, Callable[..., NDArray[np.uint8]]] = {
            'drive_supply': partial(_drive_supply, names=measured, frame_id=device),
            'joint_states': of_joints,
            'joint_commands': of_joints,
            'supply': cdr.battery_block,
            'imu': cdr.imu_block,
            'odom': cdr.odometry_block,
            'foot_force': partial(cdr.joint_state_block, names=FOOT_NAMES),
            'cmd_vel': cdr.twist_block,
        }

    def write(self, telemetry: Telemetry) -> None:
        """Add a stretch; RecordingError where the disk refuses."""
        blocks = []
        for name, rows in telemetry.topics.items():
            values: dict[str, Any] = rows.values
            if name == 'drive_supply':
                values = {**values, 'sequence0': self._samples}
                self._samples += len(rows.stamp_ns)
            if len(rows.stamp_ns):
                messages = self._encoders[name](rows.stamp_ns, **values)
                blocks.append(MessageBlock(self._topic(name), rows.stamp_ns, messages))
            else:
                self._topic(name)
        topic = self._topic('diagnostics')
        for stamp, data in self._diagnostics(telemetry):
            whole = np.frombuffer(data, np.uint8)[None]
            blocks.append(MessageBlock(topic, np.array([stamp]), whole))
        self._bag.write_blocks(sorted(blocks, key=lambda block: block.topic))

    def _topic(self, name: str) -> int:
        """Return the handle of a topic, which is added where it is new."""
        topic = self._topics.get(name)
        if topic is None:
            topic = self._topics[name] = self._bag.add_topic(name, _TYPES[name])
        return topic

    def _diagnostics(self, telemetry: Telemetry) -> list[tuple[int, bytes]]:
        """Return the messages at 1 Hz with their stamps."""
        stamps = telemetry.topics['supply'].stamp_ns
        last = int(stamps[-1]) if len(stamps) else START_NS
        for event in telemetry.events:
            self._counts[event.kind] += 1
        if last - START_NS < (self._seconds + 1) * _SECOND:
            return []
        self._seconds = (last - START_NS) // _SECOND
        falls = [event for event in telemetry.events if event.kind == 'fall']
        return [(last, _diagnostic(last, falls, self._counts))]


def _drive_supply(stamps_ns: NDArray[np.int64], **values: Any) -> NDArray[np.uint8]:
    (block,) = cdr.drive_supply_blocks(stamps_ns, **values)
    return block


def _diagnostic(stamp: int, falls: Sequence[Event], counts: dict[str, int]) -> bytes:
    seconds, nanoseconds = divmod(stamp, _SECOND)
    status = cdr.message(
        'diagnostic_msgs/msg/DiagnosticStatus',
        level=1 if falls else 0,
        name='sim_bridge',
        message=falls[-1].text if falls else 'running',
        hardware_id='simulation',
        values=[{'key': f'{kind}s', 'value': str(count)} for kind, count in counts.items()],
    )
    header = {'stamp': {'sec': seconds, 'nanosec': nanoseconds}}
    message = cdr.message(cdr.DIAGNOSTIC_ARRAY, header=header, status=[status])
    return cdr.serialize(cdr.DIAGNOSTIC_ARRAY, message)
