"""Telemetry as the messages of a bag."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter
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
        of_joints = partial(cdr.encode_joint_states, names=joints)
        self._encoders: dict[str, Callable[..., list[bytes]]] = {
            'drive_supply': partial(cdr.encode_drive_supply, names=measured, frame_id=device),
            'joint_states': of_joints,
            'joint_commands': of_joints,
            'supply': cdr.encode_batteries,
            'imu': cdr.encode_imu,
            'odom': cdr.encode_odometry,
            'foot_force': partial(cdr.encode_joint_states, names=FOOT_NAMES),
            'cmd_vel': cdr.encode_twists,
        }

    def write(self, telemetry: Telemetry) -> None:
        """Add a stretch; RecordingError where the disk refuses."""
        encoded = {}
        for name, rows in telemetry.topics.items():
            values: dict[str, Any] = rows.values
            if name == 'drive_supply':
                values = {**values, 'sequence0': self._samples}
                self._samples += len(rows.stamp_ns)
            found = self._encoders[name](rows.stamp_ns, **values)
            encoded[name] = zip(rows.stamp_ns.tolist(), found, strict=True)
        messages = []
        for name, pairs in (*encoded.items(), ('diagnostics', self._diagnostics(telemetry))):
            topic = self._topics.get(name)
            if topic is None:
                topic = self._topics[name] = self._bag.add_topic(name, _TYPES[name])
            messages += [(stamp, topic, data) for stamp, data in pairs]
        messages.sort(key=lambda message: message[:2])
        for stamp, topic, data in messages:
            self._bag.write(topic, stamp, data)

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
