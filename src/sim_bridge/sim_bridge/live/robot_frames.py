"""Topics by which RViz shows the simulated robot: `robot_description` and `/tf`."""

from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from sim_bridge.live.message_fields import assign

Floats = NDArray[np.float64]
URDF: Final = Path(__file__).with_name('anymal_c.urdf')
_LATCHED: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class RobotFrames:
    """
    Publisher of the description, once, and of the frames of the base and of each joint's link.

    prefix: put before the name of each frame, for several robots in one graph.
    """

    def __init__(self, node: Node, model: mujoco.MjModel, prefix: str) -> None:
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
        """stamp: s, ns; base: m [3] in odom; orientation: x y z w [4]; joints: rad [D]."""
        half = joints[:, None] / 2
        rotations = np.hstack([self._axes * np.sin(half), np.cos(half)])
        transforms = self._message.transforms
        assign(transforms[0].transform.translation, 'xyz', base)
        for transform, rotation in zip(transforms, (orientation, *rotations), strict=True):
            transform.header.stamp.sec, transform.header.stamp.nanosec = stamp
            assign(transform.transform.rotation, 'xyzw', rotation)
        self._publisher.publish(self._message)
