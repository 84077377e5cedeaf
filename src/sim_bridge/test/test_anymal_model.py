import mujoco
import numpy as np
import pytest
from sim_bridge.plant import anymal_model as robot
from sim_bridge.plant.terrain import FLAT, Terrain, rough
from wattwalk_core.errors import InputError

from wattwalk_core import anymal


@pytest.fixture(scope='module')
def model():
    return robot.build_spec().compile()


def standing(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return data


def feet(data):
    return np.array([data.site(name).xpos for name in anymal.FOOT_NAMES])


def hold(model, data, seconds):
    for _ in range(round(seconds / model.opt.timestep)):
        data.ctrl = 80 * (anymal.DEFAULT_POSE - data.qpos[7:]) - 2 * data.qvel[6:]
        mujoco.mj_step(model, data)


def damped_like_drives(**options):
    model = robot.build_spec(**options).compile()
    model.dof_damping[6:] = 5.0
    model.dof_frictionloss[6:] = 2.0
    return model


def test_robot_weighs_what_the_urdf_says(model):
    assert model.body_mass.sum() == pytest.approx(52.135, abs=1e-3)
    assert robot.build_spec(payload=4.0).compile().body_mass.sum() == pytest.approx(
        56.135, abs=1e-3
    )


def test_actuators_and_joints_are_in_the_order_of_the_contract(model):
    names = [model.actuator(index).name for index in range(model.nu)]
    assert names == list(anymal.JOINT_NAMES)
    assert names[:4] == ['LF_HAA', 'LF_HFE', 'LF_KFE', 'RF_HAA']
    assert [model.joint(index + 1).name for index in range(12)] == names
    assert np.array_equal(model.actuator_gear[:, 0], np.ones(12))


def test_a_torque_acts_on_the_joint_of_its_name_and_nothing_else(model):
    data = standing(model)
    data.ctrl[4] = 7.0
    mujoco.mj_fwdActuation(model, data)
    expected = np.zeros(18)
    expected[6 + anymal.JOINT_NAMES.index('RF_HFE')] = 7.0
    assert np.allclose(data.qfrc_actuator, expected)


def test_joint_friction_and_damping_are_left_to_the_drives(model):
    assert not model.dof_damping.any()
    assert not model.dof_frictionloss.any()
    assert not model.actuator_forcelimited.any()
    assert np.allclose(robot.build_spec(armature=0.05).compile().dof_armature[6:], 0.05)


def test_limits_are_mirrored_between_left_and_right(model):
    assert np.allclose(model.jnt_range[1:], anymal.LIMITS)
    assert anymal.LIMITS[0].tolist() == [-0.72, 0.49]
    assert anymal.LIMITS[3].tolist() == [-0.49, 0.72]
    assert anymal.LIMITS[1].tolist() == anymal.LIMITS[11].tolist() == [-9.42, 9.42]


def test_legs_are_mirror_images_in_the_default_pose(model):
    position = feet(standing(model))
    left_front = position[0]
    for foot, (sx, sy) in zip(position, ((1, 1), (1, -1), (-1, 1), (-1, -1)), strict=True):
        assert np.allclose(foot, left_front * (sx, sy, 1), atol=1e-12)


def test_mirrored_legs_have_mirrored_mass_matrices(model):
    data = standing(model)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    left, right = mass[6:9, 6:9], mass[9:12, 9:12]
    flip = np.array([-1, 1, 1])
    assert np.allclose(left, right * np.outer(flip, flip), atol=1e-9)


def test_default_pose_puts_the_soles_on_the_ground(model):
    soles = feet(standing(model))[:, 2] - anymal.FOOT_RADIUS
    assert np.allclose(soles, 0.0, atol=3e-4)


@pytest.mark.parametrize('terrain', [FLAT, rough(3)])
def test_standing_feet_creep_by_less_than_half_a_millimetre_in_four_seconds(terrain):
    model = damped_like_drives(terrain=terrain)
    data = standing(model)
    hold(model, data, 1.0)
    before = feet(data)
    hold(model, data, 4.0)
    assert np.abs(feet(data) - before).max() < 5e-4
    assert data.qpos[2] > 0.5


def test_foot_forces_of_a_standing_robot_carry_its_weight():
    model = damped_like_drives()
    data = standing(model)
    hold(model, data, 2.0)
    forces = robot.FootForce(model)(data)
    assert forces.sum() == pytest.approx(52.135 * 9.81, rel=0.01)
    assert forces.min() > 100.0


def test_foot_forces_of_a_lifted_robot_are_zero(model):
    data = standing(model)
    data.qpos[2] += 1.0
    mujoco.mj_forward(model, data)
    assert robot.FootForce(model)(data).tolist() == [0.0, 0.0, 0.0, 0.0]


def test_a_limp_robot_falls_on_its_shells_and_not_through_the_floor():
    model = damped_like_drives()
    data = standing(model)
    data.qpos[3:7] = [np.cos(0.7), np.sin(0.7), 0, 0]
    data.qpos[2] = 0.7
    for _ in range(4000):
        mujoco.mj_step(model, data)
    assert data.xpos[1:, 2].min() > 0.0
    assert 0.05 < data.qpos[2] < 0.45


def test_imu_at_rest_measures_gravity_upwards():
    model = damped_like_drives()
    data = standing(model)
    hold(model, data, 2.0)
    assert np.allclose(data.sensor('imu_acceleration').data, [0, 0, 9.81], atol=0.2)
    assert np.allclose(data.sensor('imu_angular_velocity').data, 0.0, atol=0.02)


def test_rough_ground_has_the_papers_noise_and_slope():
    heights = rough(5).heights()
    slopes = Terrain(noise=0.0, slope=0.02, seed=5).heights()
    centre = slice(60, -60)
    noise = np.abs(np.diff(heights[centre, centre], axis=0))
    assert 0.03 < noise.max() < 0.05
    steepest = np.abs(np.diff(slopes[centre, centre], axis=0)).max() / 0.2
    assert 0.005 < steepest <= 0.02


def test_ground_is_level_at_the_start_and_the_same_for_the_same_seed():
    heights = rough(5).heights()
    middle = len(heights) // 2
    assert heights[middle, middle] == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(heights[middle - 4 : middle + 5, middle - 4 : middle + 5]) < 0.04
    assert np.array_equal(heights, rough(5).heights())
    assert not np.array_equal(heights, rough(6).heights())


@pytest.mark.parametrize(('field', 'value'), [('noise', -0.01), ('slope', 0.5), ('cell', 0.0)])
def test_impossible_ground_is_refused_with_its_value_and_range(field, value):
    with pytest.raises(InputError, match=rf'{field}: expected .* there is {value}'):
        Terrain(**{field: value})


def test_impossible_model_is_refused():
    with pytest.raises(ValueError, match=r'armature -1\.0'):
        robot.build_spec(armature=-1.0).compile()


@pytest.mark.parametrize(('friction', 'slides'), [(0.1, True), (0.4, False)])
def test_a_robot_slides_down_a_slope_that_is_steeper_than_its_friction(friction, slides):
    model = robot.build_spec(friction=friction, timestep=0.005).compile()
    model.opt.gravity[:] = 9.81 * np.array([np.sin(0.2), 0.0, -np.cos(0.2)])
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(200):
        data.ctrl[:] = 400.0 * (anymal.DEFAULT_POSE - data.qpos[7:]) - 10.0 * data.qvel[6:]
        mujoco.mj_step(model, data)
    assert bool(data.qpos[0] > 0.2) is slides
