"""Frames and description of the simulated robot for RViz."""

import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from sim_bridge.plant.world import walking_world
from wattwalk_core.anymal import JOINT_NAMES, LIMITS

pytestmark = pytest.mark.skipif(find_spec('tf2_msgs') is None, reason='no tf2_msgs in this ROS 2')


class FakeNode:
    """Keeps what is published, by topic."""

    def __init__(self):
        self.published = {}

    def create_publisher(self, kind, name, qos):
        return SimpleNamespace(publish=lambda message: self.published.update({name: message}))


@pytest.fixture
def model():
    return walking_world().model


def rotated(quaternion, vector):
    """The vector turned by an x y z w quaternion, which has a norm of 1."""
    result = np.zeros(3)
    mujoco.mju_rotVecQuat(result, vector, np.roll(quaternion, 1))
    return result


def test_frames_put_each_link_where_the_simulation_has_it(model):
    from sim_bridge.live.publishing import RobotFrames  # needs tf2_msgs

    node, data = FakeNode(), mujoco.MjData(model)
    data.qpos[:7] = 1.0, -2.0, 0.6, 0.5, 0.5, -0.5, 0.5
    data.qpos[7:] = np.linspace(-0.4, 0.6, 12)
    mujoco.mj_kinematics(model, data)
    frames = RobotFrames(node, model, 'robot_1/')
    frames.publish((3, 4), data.qpos[:3], np.roll(data.qpos[3:7], -1), data.qpos[7:])
    places = {'robot_1/odom': (np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))}
    for part in node.published['/tf'].transforms:
        place, turn = places[part.header.frame_id]
        shift, spin = part.transform.translation, part.transform.rotation
        result = np.zeros(4)
        mujoco.mju_mulQuat(result, np.roll(turn, 1), np.array([spin.w, spin.x, spin.y, spin.z]))
        place = place + rotated(turn, np.array([shift.x, shift.y, shift.z]))
        places[part.child_frame_id] = place, np.roll(result, -1)
        assert (part.header.stamp.sec, part.header.stamp.nanosec) == (3, 4)
    assert len(places) == 1 + 13
    for body in range(1, model.nbody):
        place, turn = places[f'robot_1/{model.body(body).name}']
        np.testing.assert_allclose(place, data.xpos[body], atol=1e-9)
        assert abs(np.roll(turn, 1) @ data.xquat[body]) == pytest.approx(1.0)


def test_the_description_has_the_joints_of_the_model(model):
    from sim_bridge.live.publishing import RobotFrames  # needs tf2_msgs

    node = FakeNode()
    RobotFrames(node, model, '')
    root = ElementTree.fromstring(node.published['robot_description'].data)
    joints = {joint.get('name'): joint for joint in root.iter('joint')}
    assert [*joints] == [*JOINT_NAMES]
    for number, name in enumerate(JOINT_NAMES):
        origin = [float(x) for x in joints[name].find('origin').get('xyz').split()]
        axis = [float(x) for x in joints[name].find('axis').get('xyz').split()]
        limit = joints[name].find('limit')
        body = model.jnt_bodyid[model.joint(name).id]
        np.testing.assert_allclose(origin, model.body_pos[body], atol=1e-6)
        np.testing.assert_allclose(axis, model.jnt_axis[model.joint(name).id])
        assert [float(limit.get(key)) for key in ('lower', 'upper')] == [*LIMITS[number]]
        assert joints[name].find('child').get('link') == model.body(body).name
