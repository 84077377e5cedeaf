"""Compiled legs are those of the same functions that Python interprets."""

import numpy as np
from policy_runner.policies import kinematics, leg_steps
from policy_runner.policies.trot import Feedback, stance_torque
from wattwalk_core.anymal import DEFAULT_POSE


def legs(count=20):
    """Return feet, joint angles of moved feet, weight and stance torques of random robots."""
    random = np.random.default_rng(0)
    state = kinematics.forward(DEFAULT_POSE + random.normal(0, 0.3, (count, 12)))
    moved = kinematics.inverse(state.feet + random.normal(0, 0.05, state.feet.shape))
    gravity = random.normal(0, 0.1, (count, 3)) - (0.0, 0.0, 1.0)
    weight = kinematics.leg_weight_torque(state.angles, gravity)
    load = np.clip(random.uniform(-0.5, 1.5, (count, 4)), 0.0, 1.0)
    load[0] = 0.0
    spin, error = random.normal(0, 0.3, (2, count, 3))
    torque = [
        stance_torque(
            Feedback(),
            kinematics.LegState(state.angles[n], state.feet[n], state.jacobian[n]),
            load[n],
            height=0.5,
            gravity=gravity[n],
            spin=spin[n],
            velocity_error=error[n],
        )
        for n in range(count)
    ]
    return state.feet, state.jacobian, moved, weight, np.array(torque)


def test_compiled_and_interpreted_legs_differ_by_rounding_alone(monkeypatch):
    compiled = legs()
    for name in ('forward_steps', 'inverse_steps', 'weight_steps', 'stance_steps'):
        monkeypatch.setattr(leg_steps, name, getattr(leg_steps, name).py_func)
    for found, expected in zip(legs(), compiled, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_a_robot_without_a_bearing_foot_gets_no_stance_torque():
    assert not legs()[4][0].any()
