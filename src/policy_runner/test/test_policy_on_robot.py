"""Policies behind the supervisor, on the simulated robot."""

import mujoco
import numpy as np
import policy_folders
import pytest
from policy_runner.policies.by_name import load_policy
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.kinematics import forward
from policy_runner.policies.learned import BaseVelocity
from policy_runner.policies.trot import TROTS, ScriptedTrot
from policy_runner.supervisor.safety import FaultKind
from policy_runner.supervisor.supervisor import State, Supervisor, SupervisorOutput
from sim_bridge.plant.anymal_model import build_spec
from wattwalk_core.anymal import DEFAULT_POSE, JOINT_NAMES


class Robot:
    """Ideal drives with friction; a supervisor is asked every 5 ms, as by the node."""

    def __init__(self, policy):
        self.model = build_spec().compile()
        self.model.dof_damping[6:] = 5.0
        self.model.dof_frictionloss[6:] = 2.0
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        mujoco.mj_forward(self.model, self.data)
        self.supervisor = Supervisor(policy)
        self.odometry = True
        self.felt = np.zeros(3)
        self.poison = None

    def run(self, seconds, command=(0.0, 0.0, 0.0)):
        """Rows of vx, vy, yaw rate, height and the command in force."""
        rows = []
        for _ in range(round(seconds / 0.005)):
            self.tell(command)
            output = self.supervisor.update(self.data.time)
            self.move(output)
            base = self.velocity()
            in_force = self.supervisor.command(self.data.time)
            rows.append([*base[:2], self.data.qvel[5], self.data.qpos[2], *in_force])
        return np.array(rows)

    def down(self):
        return -self.data.xmat[1].reshape(3, 3)[2]

    def velocity(self):
        return self.data.xmat[1].reshape(3, 3).T @ self.data.qvel[:3]

    def tell(self, command):
        data, inputs = self.data, self.supervisor.inputs
        now, stamp = data.time, round(data.time * 1e9) + 1
        w, x, y, z = data.qpos[3:7]
        position = data.qpos[7:].copy()
        if self.poison is not None:
            position[self.poison] = np.nan
        inputs.on_joints(stamp, JOINT_NAMES, position, data.qvel[6:], now)
        inputs.on_imu(
            stamp, (x, y, z, w), data.qvel[3:6], now, data.sensor('imu_acceleration').data
        )
        if self.odometry:
            inputs.on_odom(stamp, self.velocity(), now)
        inputs.on_command(command, now)

    def move(self, output):
        data = self.data
        for _ in range(10):
            torque = -2.0 * data.qvel[6:]
            if output is not None and output.targets is not None:
                torque += 80.0 * (output.targets - data.qpos[7:])
            elif output is None:
                torque += 80.0 * (DEFAULT_POSE - data.qpos[7:])
            data.ctrl = np.clip(torque, -80.0, 80.0)
            mujoco.mj_step(self.model, data)


def start(machine):
    machine.tell((0.0, 0.0, 0.0))
    assert machine.supervisor.start(machine.data.time)[0]
    machine.run(2.0)
    assert machine.supervisor.state is State.RUNNING


def test_a_policy_folder_stands_up_and_stands(tmp_path):
    machine = Robot(load_policy(str(policy_folders.save(tmp_path / 'stand'))))
    start(machine)
    rows = machine.run(1.0)
    assert rows[:, 3].min() > 0.4
    assert np.abs(rows[:, :2]).max() < 0.1


def test_policies_change_while_it_walks_without_a_fall(tmp_path):
    machine = Robot(load_policy('trot'))
    start(machine)
    walking = machine.run(3.0, (0.4, 0.0, 0.0))
    assert walking[-200:, 0].mean() == pytest.approx(0.4, abs=0.1)
    standing = load_policy(str(policy_folders.save(tmp_path / 'stand')))
    assert machine.supervisor.change(standing, machine.data.time)[0]
    changing = machine.run(3.0, (0.4, 0.0, 0.0))
    assert machine.supervisor.state is State.RUNNING
    assert changing[:, 3].min() > 0.4
    assert np.abs(changing[-100:, :2]).max() < 0.05
    np.testing.assert_array_equal(changing[:300, 4], 0.0)
    assert machine.supervisor.change(load_policy('trot_high'), machine.data.time)[0]
    machine.run(3.5, (0.4, 0.0, 0.0))
    again = machine.run(2.0, (0.4, 0.0, 0.0))
    assert again[-200:, 0].mean() == pytest.approx(0.4, abs=0.1)
    assert again[:, 3].min() > 0.4


def test_one_change_at_a_time(tmp_path):
    machine = Robot(load_policy('trot'))
    start(machine)
    assert machine.supervisor.change(load_policy('trot_slow'), machine.data.time)[0]
    done, why = machine.supervisor.change(load_policy('trot_high'), machine.data.time)
    assert not done
    assert 'under way' in why


def test_a_fault_during_a_change_damps_and_the_next_start_runs_the_new_policy(tmp_path):
    machine = Robot(load_policy('trot'))
    start(machine)
    new = load_policy(str(policy_folders.save(tmp_path / 'stand')))
    machine.supervisor.change(new, machine.data.time)
    machine.run(1.3)
    machine.poison = 4
    machine.run(0.02)
    assert machine.supervisor.state is State.DAMPING
    assert machine.supervisor.fault.kind is FaultKind.NOT_FINITE
    machine.poison = None
    machine.tell((0.0, 0.0, 0.0))
    assert machine.supervisor.start(machine.data.time)[0]
    assert machine.supervisor._policy is new


def test_a_policy_that_goes_wild_ends_in_damping(tmp_path):
    machine = Robot(load_policy(str(policy_folders.save(tmp_path / 'wild', scale=50.0))))
    machine.tell((0.0, 0.0, 0.0))
    machine.supervisor.start(machine.data.time)
    machine.run(2.5)
    assert machine.supervisor.state is State.DAMPING
    assert machine.supervisor.fault.kind is FaultKind.TARGET_RANGE


@pytest.mark.parametrize('measured', [True, False, 'nan'])
def test_a_low_foot_that_bears_nothing_does_not_count_as_standing(measured):
    """One leg swings its foot level with the ground; the others bear a third of the weight."""
    down, legs = np.array([0.0, 0.0, -1.0]), forward(DEFAULT_POSE)
    turning = np.zeros((4, 3))
    turning[0] = np.linalg.solve(legs.jacobian[0], [1.0, 0.0, 0.0])  # m/s, ahead
    effort = np.zeros((4, 3))
    effort[1:] = np.swapaxes(legs.jacobian[1:], 1, 2) @ (52.1 * 9.81 / 3 * down)
    given = {True: effort.ravel(), False: np.zeros(0), 'nan': np.full(12, np.nan)}[measured]
    estimator = BaseVelocity()
    inputs = Inputs(position=DEFAULT_POSE, velocity=turning.ravel(), gravity=down, effort=given)
    for index in range(100):
        found = estimator.update(0.02 * index, inputs)
    assert abs(found[0]) < 0.01 if measured is True else found[0] < -0.2


@pytest.mark.parametrize(('feels', 'limit'), [(True, 0.05), (False, 0.1)])
def test_the_velocity_of_the_base_is_known_from_legs_and_imu(feels, limit):
    machine = Robot(load_policy('trot'))
    estimator, trot = BaseVelocity(), ScriptedTrot(TROTS['trot'])
    data, errors = machine.data, []
    for index in range(1000):
        spin = data.qvel[3:6].copy()
        command = np.array([0.4, 0.1, 0.3]) if data.time > 2.0 else np.zeros(3)
        read = Inputs(position=data.qpos[7:], gravity=machine.down(), spin=spin)
        targets = trot.step(data.time, command, read, machine.velocity())
        machine.move(SupervisorOutput(targets))
        felt = data.sensor('imu_acceleration').data.copy()
        inputs = Inputs(
            position=data.qpos[7:].copy(),
            velocity=data.qvel[6:].copy(),
            gravity=machine.down(),
            spin=data.qvel[3:6].copy(),
            acceleration=felt if feels else None,
        )
        estimate = estimator.update(data.time, inputs)
        if index > 600:
            errors.append(estimate - machine.velocity())
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms[:2].max() < limit
    assert np.abs(np.mean(errors, axis=0))[:2].max() < 0.04
