"""Publishers of the topics that do not travel over the bus."""

import array
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from power_daq.supply.battery import empty_battery
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Imu, JointState
from std_msgs.msg import String
from wattwalk_core.anymal import FOOT_NAMES
from wattwalk_core.arrays import Floats

from sim_bridge.plant.world import World
from sim_bridge.sensors.blocks import InstrumentReadings
from sim_bridge.sensors.sensors import BodyReadings, DeviceClock, OdometryReadings, SupplyReadings


def assign(target: object, names: str, values: Floats) -> None:
    """Set the fields `x`, `y`, … of a message to values, one each."""
    set_field: Callable[[object, str, float], None] = setattr
    for name, value in zip(names, values.tolist(), strict=True):
        set_field(target, name, value)


_SECOND = 1_000_000_000
_CLOCK_PERIOD = 10  # steps: 200 Hz
_FRAMES_PERIOD = 40  # steps: 50 Hz


class SamplePublisher:
    """Publisher of imu, foot_force, odom, supply and frames, optionally of /clock."""

    def __init__(self, node: Node, world: World, clock: DeviceClock, with_clock: bool) -> None:
        """Create the publishers; set `start_ns`, the ROS time of step 0, before `publish`."""
        qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
        self._clock, self.start_ns = clock, 0
        self._imu = node.create_publisher(Imu, 'imu', qos)
        self._feet = node.create_publisher(JointState, 'foot_force', qos)
        self._odom = node.create_publisher(Odometry, 'odom', qos)
        self._supply = node.create_publisher(BatteryState, 'supply', qos)
        self._time = node.create_publisher(Clock, '/clock', 10) if with_clock else None
        prefix = f'{node.get_namespace()}/'.lstrip('/')
        self._frames = None
        if world.floating and find_spec('tf2_msgs') is not None:
            self._frames = RobotFrames(node, world.model, prefix)
        self._imu_message = Imu()
        self._imu_message.header.frame_id = f'{prefix}base'
        self._feet_message = JointState(name=list(FOOT_NAMES))
        self._odom_message = Odometry(child_frame_id=f'{prefix}base')
        self._odom_message.header.frame_id = f'{prefix}odom'
        self._supply_message = empty_battery()

    def publish(self, samples: InstrumentReadings) -> None:
        """Publish the readings of a block."""
        if samples.body is not None:
            self._publish_body(samples.body)
        if samples.odometry is not None:
            self._publish_odometry(samples.odometry)
            self._publish_frames(samples.odometry, samples.joints.position)
        self._publish_supply(samples.supply)
        if self._time is not None:
            due = samples.electrical.step[samples.electrical.step % _CLOCK_PERIOD == 0]
            for stamp in self._stamps(due):
                message = Clock()
                message.clock.sec, message.clock.nanosec = stamp
                self._time.publish(message)

    def _publish_body(self, body: BodyReadings) -> None:
        imu, feet = self._imu_message, self._feet_message
        for row, stamp in enumerate(self._stamps(body.step)):
            imu.header.stamp.sec, imu.header.stamp.nanosec = stamp
            assign(imu.orientation, 'xyzw', body.orientation[row])
            assign(imu.angular_velocity, 'xyz', body.rate[row])
            assign(imu.linear_acceleration, 'xyz', body.acceleration[row])
            self._imu.publish(imu)
            feet.header.stamp.sec, feet.header.stamp.nanosec = stamp
            feet.effort = array.array('d', body.foot_force[row].tobytes())
            self._feet.publish(feet)

    def _publish_odometry(self, odometry: OdometryReadings) -> None:
        message = self._odom_message
        for row, stamp in enumerate(self._stamps(odometry.step)):
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
            assign(message.pose.pose.position, 'xyz', odometry.position[row])
            assign(message.pose.pose.orientation, 'xyzw', odometry.orientation[row])
            assign(message.twist.twist.linear, 'xyz', odometry.velocity[row])
            assign(message.twist.twist.angular, 'xyz', odometry.rate[row])
            self._odom.publish(message)

    def _publish_frames(self, odometry: OdometryReadings, joints: Floats) -> None:
        due = np.flatnonzero(odometry.step % _FRAMES_PERIOD == 0)
        if self._frames is None or not len(joints):
            return
        for row, stamp in zip(due, self._stamps(odometry.step[due]), strict=True):
            base, orientation = odometry.position[row], odometry.orientation[row]
            self._frames.publish(stamp, base, orientation, joints[-1])

    def _publish_supply(self, supply: SupplyReadings) -> None:
        message = self._supply_message
        for row, stamp in enumerate(self._stamps(supply.step)):
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
            message.voltage = float(supply.voltage[row])
            message.current = float(supply.current[row])
            self._supply.publish(message)

    def _stamps(self, step: NDArray[np.int64]) -> list[tuple[int, int]]:
        stamps = self.start_ns + self._clock.elapsed_ns(step)
        return [divmod(stamp, _SECOND) for stamp in stamps.tolist()]


URDF: Final = Path(__file__).with_name('anymal_c.urdf')
_LATCHED: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class RobotFrames:
    """Publisher of the description, once, and of the frames of the base and of each joint's link.

    prefix: put before the name of each frame, for several robots in one graph.
    """

    def __init__(self, node: Node, model: mujoco.MjModel, prefix: str) -> None:
        from tf2_msgs.msg import TFMessage  # which a ROS 2 without it may lack

        self._description = node.create_publisher(String, 'robot_description', _LATCHED)
        self._description.publish(String(data=URDF.read_text(encoding='utf-8')))
        self._publisher = node.create_publisher(TFMessage, '/tf', 100)
        links = range(2, model.nbody)  # after the world and the base, each on a hinge
        self._axes = model.jnt_axis[model.body_jntadr[links]]
        transforms = [TransformStamped(child_frame_id=f'{prefix}base')]
        transforms[0].header.frame_id = f'{prefix}odom'
        for link in links:
            transform = TransformStamped(child_frame_id=prefix + model.body(link).name)
            transform.header.frame_id = prefix + model.body(model.body_parentid[link]).name
            assign(transform.transform.translation, 'xyz', model.body_pos[link])
            transforms.append(transform)
        self._message = TFMessage(transforms=transforms)

    def publish(
        self, stamp: tuple[int, int], base: Floats, orientation: Floats, joints: Floats
    ) -> None:
        """Publish all frames at a stamp (s, ns).

        base: m [3] in odom; orientation: x y z w [4]; joints: rad [D].
        """
        half = joints[:, None] / 2
        rotations = np.hstack([self._axes * np.sin(half), np.cos(half)])
        transforms = self._message.transforms
        assign(transforms[0].transform.translation, 'xyz', base)
        for transform, rotation in zip(transforms, (orientation, *rotations), strict=True):
            transform.header.stamp.sec, transform.header.stamp.nanosec = stamp
            assign(transform.transform.rotation, 'xyzw', rotation)
        self._publisher.publish(self._message)
