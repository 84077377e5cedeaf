import numpy as np
import pytest
from policy_runner.policies.kinematics import forward
from policy_runner.policies.trot import Feedback, stance_torque
from wattwalk_core.anymal import DEFAULT_POSE, FOOT_RADIUS

LEVEL = np.array([0.0, 0.0, -1.0])
LEGS = forward(DEFAULT_POSE)
HEIGHT = FOOT_RADIUS - LEGS.feet[0, 2]
WEIGHT = 52.135 * 9.81


def forces(load=(1, 1, 1, 1), gravity=LEVEL, error=(0, 0, 0), height=HEIGHT, spin=(0, 0, 0)):
    torque = stance_torque(
        Feedback(),
        forward(DEFAULT_POSE),
        np.array(load, dtype=float),
        height=height,
        gravity=np.asarray(gravity),
        spin=np.array(spin, dtype=float),
        velocity_error=np.array(error, dtype=float),
    )
    return np.array([np.linalg.solve(-LEGS.jacobian[leg].T, torque[leg]) for leg in range(4)])


def test_four_feet_carry_a_quarter_of_the_weight_each():
    assert np.allclose(forces()[:, 2], WEIGHT / 4, rtol=1e-3)
    assert np.allclose(forces()[:, :2], 0.0, atol=1e-6)


def test_a_diagonal_pair_carries_half_each_and_swing_feet_nothing():
    vertical = forces(load=(1, 0, 0, 1))[:, 2]
    assert np.allclose(vertical, [WEIGHT / 2, 0, 0, WEIGHT / 2], rtol=1e-3, atol=1e-6)


def test_a_body_too_low_is_pushed_up_and_one_too_high_let_down():
    assert forces(height=HEIGHT + 0.01)[:, 2].sum() == pytest.approx(WEIGHT + 30.0, rel=1e-3)
    assert forces(height=HEIGHT - 0.01)[:, 2].sum() == pytest.approx(WEIGHT - 30.0, rel=1e-3)


@pytest.mark.parametrize(
    ('angle', 'stronger'),
    [
        ((0.1, 0.0), (1, 3)),  # rolled to the right: right feet
        ((-0.1, 0.0), (0, 2)),
        ((0.0, 0.1), (0, 1)),  # nose down: front feet
        ((0.0, -0.1), (2, 3)),
    ],
)
def test_feet_on_the_side_that_hangs_push_harder(angle, stronger):
    roll, pitch = angle
    gravity = np.array([np.sin(pitch), -np.sin(roll), -np.cos(roll) * np.cos(pitch)])
    vertical = forces(gravity=gravity)[:, 2]
    weaker = [foot for foot in range(4) if foot not in stronger]
    assert vertical[list(stronger)].min() > vertical[weaker].max() + 10.0


def test_slowness_is_met_by_pushing_in_the_direction_that_lacks():
    ahead = forces(error=(0.2, 0, 0)).sum(axis=0)
    aside = forces(error=(0, -0.2, 0)).sum(axis=0)
    assert ahead[:2] == pytest.approx([36.0, 0.0], abs=1e-6)
    assert aside[:2] == pytest.approx([0.0, -36.0], abs=1e-6)


def test_turning_too_slowly_is_met_by_a_moment_about_the_vertical():
    force = forces(error=(0, 0, 0.5))
    moment = (LEGS.feet[:, 0] * force[:, 1] - LEGS.feet[:, 1] * force[:, 0]).sum()
    assert moment == pytest.approx(40.0, rel=1e-2)
    assert np.allclose(force[:, :2].sum(axis=0), 0.0, atol=1e-6)


def test_no_foot_pulls_on_the_ground():
    assert forces(gravity=np.array([0.0, -0.7, -0.714]), spin=(5, 5, 0))[:, 2].min() > -1e-9


def test_without_a_foot_on_the_ground_there_is_no_force():
    assert not forces(load=(0, 0, 0, 0)).any()
