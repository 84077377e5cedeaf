import mujoco
import numpy as np
import pytest
from policy_runner.policies import kinematics
from sim_bridge.plant.anymal_model import build_spec

from wattwalk_core import anymal


@pytest.fixture(scope='module')
def model():
    return build_spec().compile()


def poses(count, seed=1):
    """Angles [count, 12] with the feet below the hips and the knees bent inwards."""
    random = np.random.default_rng(seed)
    low, high = [-0.45, -0.2, -1.7], [0.45, 0.9, -0.2]
    angles = random.uniform(low, high, (count, 4, 3))
    angles[:, :, 1:] *= anymal.FRONT[:, None]
    return angles.reshape(count, 12)


def placed(model, position):
    data = mujoco.MjData(model)
    data.qpos[2] = 2.0
    data.qpos[3] = 1.0
    data.qpos[7:] = position
    mujoco.mj_forward(model, data)
    return data


def test_names_limits_and_pose_are_those_of_the_simulated_robot(model):
    assert tuple(model.joint(i).name for i in range(1, model.njnt)) == anymal.JOINT_NAMES
    assert np.allclose(model.jnt_range[1:], anymal.LIMITS)
    assert np.allclose(model.key_qpos[0, 7:], anymal.DEFAULT_POSE)


def test_forward_kinematics_agree_with_the_simulated_robot(model):
    for position in poses(20):
        data = placed(model, position)
        expected = [data.site(name).xpos - data.qpos[:3] for name in anymal.FOOT_NAMES]
        assert np.allclose(kinematics.forward(position).feet, expected, atol=1e-12)


def test_jacobians_agree_with_the_simulated_robot(model):
    for position in poses(5):
        data = placed(model, position)
        legs = kinematics.forward(position)
        for index, name in enumerate(anymal.FOOT_NAMES):
            whole = np.zeros((3, model.nv))
            mujoco.mj_jacSite(model, data, whole, None, model.site(name).id)
            columns = slice(6 + 3 * index, 9 + 3 * index)
            assert np.allclose(legs.jacobian[index], whole[:, columns], atol=1e-12)


def test_inverse_undoes_forward_kinematics():
    for position in poses(200):
        feet = kinematics.forward(position).feet
        assert np.allclose(kinematics.inverse(feet).ravel(), position, atol=1e-9)


def test_places_out_of_reach_give_a_straight_leg_and_no_nan():
    feet = kinematics.forward(anymal.DEFAULT_POSE).feet
    far = kinematics.inverse(feet - [0, 0, 1.0])
    assert np.isfinite(far).all()
    reached = kinematics.forward(far.ravel()).feet
    assert (reached[:, 2] < -0.58).all()


def test_leg_weight_is_carried_by_the_torque_that_gravity_asks_for(model):
    light = build_spec().compile()
    light.body_mass[1] = 1e6
    for position in poses(10):
        data = placed(light, position)
        expected = data.qfrc_bias[6:]
        torque = kinematics.leg_weight_torque(
            position.reshape(4, 3), np.array([0.0, 0.0, -1.0])
        ).ravel()
        assert np.allclose(torque, expected, atol=0.02)
