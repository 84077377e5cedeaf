import mujoco
import numpy as np
import pytest
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.trot import TROTS, ScriptedTrot
from sim_bridge.plant.anymal_model import TIMESTEP, build_spec
from sim_bridge.plant.terrain import FLAT, rough

from wattwalk_core import anymal

STEPS = 10


class Walk:
    """A robot with ideal drives whose gears have friction, under the scripted trot."""

    def __init__(self, name='trot', ground=FLAT, seed=0, odometry=True):
        self.model = build_spec(ground).compile()
        self.model.dof_damping[6:] = 5.0
        self.model.dof_frictionloss[6:] = 2.0
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        mujoco.mj_forward(self.model, self.data)
        self.trot = ScriptedTrot(TROTS[name])
        self.random = np.random.default_rng(seed)
        self.odometry = odometry

    def run(self, command, seconds, push=None):
        """Velocities vx, vy, yaw and tilt and foot heights, a row per 5 ms."""
        data, rows = self.data, []
        if push is not None:
            data.qvel[:2] += push
        for _ in range(round(seconds / (STEPS * TIMESTEP))):
            rotation = data.xmat[1].reshape(3, 3)
            velocity = rotation.T @ data.qvel[:3]
            inputs = Inputs(
                position=data.qpos[7:] + self.random.normal(0, 2e-4, 12),
                gravity=-rotation[2],
                spin=data.qvel[3:6] + self.random.normal(0, 0.02, 3),
            )
            targets = self.trot.step(
                data.time,
                np.asarray(command, dtype=float),
                inputs,
                velocity + self.random.normal(0, 0.03, 3) if self.odometry else None,
            )
            for _ in range(STEPS):
                torque = 80.0 * (targets - data.qpos[7:]) - 2.0 * data.qvel[6:]
                data.ctrl = np.clip(torque, -80.0, 80.0)
                mujoco.mj_step(self.model, data)
            feet = [data.site(name).xpos[2] for name in anymal.FOOT_NAMES]
            rows.append([*velocity[:2], data.qvel[5], np.hypot(*rotation[2, :2]), *feet])
            assert data.qpos[2] > 0.35, f'fell at {data.time:.2f} s'
        return np.array(rows)


@pytest.mark.parametrize(
    ('command', 'tolerance'),
    [
        ((0.4, 0.0, 0.0), 0.05),
        ((-0.4, 0.0, 0.0), 0.05),
        ((0.0, 0.3, 0.0), 0.05),
        ((0.0, -0.3, 0.0), 0.05),
        ((0.0, 0.0, 0.6), 0.08),
        ((0.3, 0.1, -0.4), 0.06),
    ],
)
def test_it_reaches_the_commanded_velocity(command, tolerance):
    rows = Walk().run(command, 8.0)
    reached = rows[900:, :3].mean(axis=0)
    assert reached == pytest.approx(command, abs=tolerance)
    assert rows[900:, 3].max() < 0.2


def test_feet_are_lifted_clear_of_the_ground_in_every_stride():
    rows = Walk().run((0.4, 0.0, 0.0), 6.0)
    heights = rows[700:, 4:] - anymal.FOOT_RADIUS
    assert heights.max(axis=0).min() > 0.05
    airborne = heights > 0.01
    lifts = (np.diff(airborne.astype(int), axis=0) > 0).sum(axis=0)
    strides = TROTS['trot'].frequency * 0.005 * len(heights)
    assert np.all(np.abs(lifts - strides) <= 1.5)


def test_it_stands_still_again_after_walking():
    walk = Walk()
    walk.run((0.4, 0.0, 0.2), 4.0)
    walk.run((0.0, 0.0, 0.0), 3.0)
    assert not walk.trot.walking
    rows = walk.run((0.0, 0.0, 0.0), 1.0)
    assert np.abs(rows[:, :3]).max() < 0.05


@pytest.mark.parametrize('direction', [0.0, 0.5, 1.0, 1.5])
def test_a_push_of_08_metres_a_second_is_caught_by_stepping(direction):
    walk = Walk()
    walk.run((0.0, 0.0, 0.0), 3.0)
    angle = np.pi * direction
    walk.run((0.0, 0.0, 0.0), 3.0, push=0.8 * np.array([np.cos(angle), np.sin(angle)]))
    rows = walk.run((0.0, 0.0, 0.0), 0.5)
    assert np.abs(rows[:, :3]).max() < 0.15


@pytest.mark.parametrize('name', TROTS)
def test_every_gait_walks_over_rough_ground(name):
    walk = Walk(name, rough(7))
    walk.run((0.4, 0.0, 0.0), 3.0)
    walk.run((0.3, 0.1, 0.4), 4.0, push=[0.3, -0.4])
    assert np.linalg.norm(walk.data.qpos[:2]) > 0.8


def test_without_odometry_it_walks_by_the_velocity_of_its_stance_feet():
    rows = Walk(odometry=False).run((0.4, 0.0, 0.0), 6.0)
    assert rows[800:, :3].mean(axis=0) == pytest.approx((0.4, 0.0, 0.0), abs=0.1)
