import numpy as np
import pytest
from policy_runner.policies.inputs import Inputs
from policy_runner.supervisor.safety import TargetLimiter
from wattwalk_core.anymal import JOINT_NAMES

STILL = (0.0, 0.0, 0.0)


def test_joints_are_found_by_name_and_not_by_place():
    inputs = Inputs()
    order = np.random.default_rng(0).permutation(12)
    values = np.arange(12.0)
    inputs.on_joints(1, [JOINT_NAMES[i] for i in order], values[order], values[order], 0.0)
    assert inputs.position.tolist() == inputs.velocity.tolist() == values.tolist()


def test_efforts_do_not_outlive_the_message_that_had_them():
    inputs, still = Inputs(), np.zeros(12)
    inputs.on_joints(1, JOINT_NAMES, still, still, 0.0, np.ones(12))
    assert inputs.effort.tolist() == [1.0] * 12
    inputs.on_joints(2, JOINT_NAMES, still, still, 0.0)
    assert not len(inputs.effort)


def test_gravity_is_that_of_the_quaternion():
    inputs = Inputs()
    half = 0.25
    inputs.on_imu(1, (np.sin(half), 0.0, 0.0, np.cos(half)), STILL, 0.0)
    assert np.allclose(inputs.gravity, [0.0, -np.sin(0.5), -np.cos(0.5)])
    inputs.on_imu(2, (0.0, np.sin(half), 0.0, np.cos(half)), STILL, 0.0)
    assert np.allclose(inputs.gravity, [np.sin(0.5), 0.0, -np.cos(0.5)])


def test_targets_move_no_faster_than_their_rate():
    limiter = TargetLimiter(10.0)
    limiter.reset(np.zeros(12))
    assert limiter(np.full(12, 0.4), 0.005).max() == pytest.approx(0.05)
    assert limiter(np.full(12, -0.4), 0.005).min() == pytest.approx(0.0)
    assert limiter(np.full(12, -0.4), 1.0).min() == pytest.approx(-0.4)


def test_targets_stay_within_reach_of_the_joint_limits():
    limiter = TargetLimiter(1e6)
    limited = limiter(np.full(12, 2.0), 0.005)
    assert limited[0] == pytest.approx(0.49 + 0.5)
    assert limited[3] == pytest.approx(0.72 + 0.5)
    assert limited[1] == 2.0
