"""Telemetry as the messages of a bag."""

from collections.abc import Sequence

import numpy as np
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter
from wattwalk_core.anymal import FOOT_NAMES

from sim_bridge.offline.session import Event
from sim_bridge.offline.telemetry import START_NS, Rows, Telemetry

_SECOND = 1_000_000_000


class BagTopics:
    """Writes telemetry to the topics that the live system records, ordered by time."""

    def __init__(
        self, bag: BagWriter, joints: Sequence[str], measured: Sequence[str], device: str
    ) -> None:
        """joints: of joint_states; measured: of drive_supply; device: its frame_id."""
        self._bag = bag
        self._joints, self._measured, self._device = list(joints), list(measured), device
        self._topics: dict[str, int] = {}
        self._sequence = 0
        self._seconds = 0
        self._counts = {'fall': 0, 'push': 0}

    def write(self, telemetry: Telemetry) -> None:
        """Add a stretch; RecordingError where the disk refuses."""
        messages: list[tuple[int, int, bytes]] = []
        for name, kind, stamps, encoded in self._encoded(telemetry):
            topic = self._topics.get(name)
            if topic is None:
                topic = self._topics[name] = self._bag.add_topic(name, kind)
            messages += [(stamp, topic, data) for stamp, data in zip(stamps, encoded, strict=True)]
        messages.sort(key=lambda message: message[:2])
        for stamp, topic, data in messages:
            self._bag.write(topic, stamp, data)

    def _encoded(self, telemetry: Telemetry) -> list[tuple[str, str, list[int], list[bytes]]]:
        t, joints = telemetry, self._joints
        found = [
            ('drive_supply', cdr.DRIVE_SUPPLY, *self._drive_supply(t.electrical)),
            ('joint_states', cdr.JOINT_STATE, *_joint_states(t.joints, joints)),
            ('joint_commands', cdr.JOINT_STATE, *_joint_states(t.commands, joints)),
            (
                'supply',
                cdr.BATTERY_STATE,
                t.supply.stamp_ns.tolist(),
                cdr.encode_batteries(t.supply.stamp_ns, **t.supply.values),
            ),
            ('diagnostics', cdr.DIAGNOSTIC_ARRAY, *self._diagnostics(t)),
        ]
        if t.imu is not None:
            imu = cdr.encode_imu(t.imu.stamp_ns, *t.imu.values.values())
            found.append(('imu', cdr.IMU, t.imu.stamp_ns.tolist(), imu))
        if t.odom is not None:
            odom = cdr.encode_odometry(t.odom.stamp_ns, *t.odom.values.values())
            found.append(('odom', cdr.ODOMETRY, t.odom.stamp_ns.tolist(), odom))
        if t.foot_force is not None:
            found.append(('foot_force', cdr.JOINT_STATE, *_joint_states(t.foot_force, FOOT_NAMES)))
        if t.cmd_vel is not None:
            twists = cdr.encode_twists(t.cmd_vel.stamp_ns, t.cmd_vel.values['velocity'])
            found.append(('cmd_vel', cdr.TWIST_STAMPED, t.cmd_vel.stamp_ns.tolist(), twists))
        return found

    def _drive_supply(self, rows: Rows) -> tuple[list[int], list[bytes]]:
        v = rows.values
        encoded = cdr.encode_drive_supply(
            rows.stamp_ns,
            self._sequence,
            v['device_ns'].astype(np.uint64),
            self._measured,
            v['voltage'],
            v['current'],
            v['temperature'],
            v['status'],
            frame_id=self._device,
        )
        self._sequence += len(encoded)
        return rows.stamp_ns.tolist(), encoded

    def _diagnostics(self, telemetry: Telemetry) -> tuple[list[int], list[bytes]]:
        last = int(telemetry.supply.stamp_ns[-1]) if len(telemetry.supply.stamp_ns) else START_NS
        for event in telemetry.events:
            self._counts[event.kind] += 1
        if last - START_NS < (self._seconds + 1) * _SECOND:
            return [], []
        self._seconds = (last - START_NS) // _SECOND
        falls = [event for event in telemetry.events if event.kind == 'fall']
        return [last], [_diagnostic(last, falls, self._counts)]


def _joint_states(rows: Rows, names: Sequence[str]) -> tuple[list[int], list[bytes]]:
    return rows.stamp_ns.tolist(), cdr.encode_joint_states(rows.stamp_ns, names, **rows.values)


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
