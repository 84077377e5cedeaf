import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch
from policy_training.environment.robots import Ground, Relief, add_planes
from sim_bridge.plant.anymal_model import build_spec
from sim_bridge.plant.terrain import FLAT, Terrain
from wattwalk_core.anymal import FOOT_NAMES, FOOT_RADIUS

ROUGH = Terrain(noise=0.02, slope=0.02, extent=30.0, seed=4)
DOWN = np.array([0.0, 0.0, -1.0])


def places(count, seed=0):
    return np.random.default_rng(seed).uniform(-9.0, 9.0, (count, 2))


def test_heights_are_those_of_mujocos_height_field_on_both_triangles_of_a_cell():
    model = build_spec(ROUGH).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    field = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    where = places(200)
    heights, _ = Relief(ROUGH).at(where)
    hit = np.zeros(1, np.int32)
    model.geom('terrain').group = 0
    for geom in range(model.ngeom):
        model.geom_group[geom] = 0 if geom == model.geom('terrain').id else 1
    for (x, y), height in zip(where, heights, strict=True):
        away = mujoco.mj_ray(model, data, np.array([x, y, 5.0]), DOWN, field, 1, -1, hit)
        assert 5.0 - away == pytest.approx(height, abs=1e-6)


def test_slopes_are_the_change_of_height_within_a_triangle():
    relief, where, step = Relief(ROUGH), places(300, seed=1), 1e-6
    height, slope = relief.at(where)
    for axis in range(2):
        moved = where.copy()
        moved[:, axis] += step
        np.testing.assert_allclose(
            (relief.at(moved)[0] - height) / step, slope[:, axis], atol=1e-6
        )


def test_level_ground_is_level_everywhere():
    height, slope = Relief(FLAT).at(places(5))
    assert not height.any()
    assert not slope.any()


def test_a_robot_is_put_above_all_that_is_near():
    relief, where = Relief(ROUGH), places(100, seed=2)
    around = np.random.default_rng(3).uniform(-0.3, 0.3, (50, 1, 2)) + where
    assert (relief.at(around)[0] <= relief.above(where) + 1e-12).all()


def test_planes_pass_through_the_ground_below_each_foot_and_lean_with_it():
    spec = build_spec()
    add_planes(spec, friction=0.7)
    model = spec.compile()
    batch = Batch(model, 3, 1)
    ground = Ground(ROUGH, model, batch)
    soles = np.random.default_rng(0).uniform(-5, 5, (3, 4, 3))
    ground.follow(soles)
    height, slope = ground.relief.at(soles[..., :2])
    ids = [model.geom(f'{foot}_ground').id for foot in FOOT_NAMES]
    position, attitude = batch.expand('geom_pos'), batch.expand('geom_quat')
    np.testing.assert_array_equal(position[:, ids, 2], height)
    for robot in range(3):
        for foot in range(4):
            normal = np.zeros(3)
            mujoco.mju_rotVecQuat(normal, -DOWN, attitude[robot, ids[foot]])
            expected = np.array([*-slope[robot, foot], 1.0])
            np.testing.assert_allclose(normal, expected / np.linalg.norm(expected), atol=1e-12)


def test_feet_come_to_rest_on_the_rough_ground_as_on_a_height_field():
    spec = build_spec(timestep=0.005)
    add_planes(spec, friction=0.8)
    model = spec.compile()
    batch = Batch(model, 1, 1)
    ground = Ground(ROUGH, model, batch)
    batch.reset(keyframe=0)
    qpos, qvel, control = batch.bind('qpos'), batch.bind('qvel'), batch.bind('ctrl')
    soles = batch.bind('site_xpos')
    ids = [model.site(foot).id for foot in FOOT_NAMES]
    qpos[0, :2] = 3.1, 2.2
    qpos[0, 2] += 0.1
    pose = qpos[0, 7:].copy()
    batch.forward()
    for _ in range(400):
        control[0] = 300.0 * (pose - qpos[0, 7:]) - 10.0 * qvel[0, 6:]
        ground.follow(soles[:, ids])
        batch.step()
    batch.forward()
    height, slope = ground.relief.at(soles[:, ids, :2])
    above = (soles[:, ids, 2] - height) / np.sqrt(1.0 + np.square(slope).sum(axis=-1))
    np.testing.assert_allclose(above - FOOT_RADIUS, 0.0, atol=2e-3)
