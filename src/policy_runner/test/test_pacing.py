import numpy as np
import pytest
from policy_runner.policies.gait_phase import GaitPhase, check_hurry, off_balance, stride_rate
from wattwalk_core.errors import InputError

LEVEL = np.array([[0.0, 0.0, -1.0]])
STILL = np.zeros((1, 3))
FORWARD = np.array([[0.5, 0.0, 0.0]])
HURRY = (3.0, 0.25, 0.6)


def test_the_clock_of_the_gait_runs_while_a_robot_is_told_to_move():
    clock = GaitPhase(2.0, count=2)
    told = np.array([[0.5, 0.0, 0.0], [0.05, 0.0, 0.05]])
    rest, level = np.zeros((2, 3)), np.repeat(LEVEL, 2, axis=0)
    seen = []
    for _ in range(6):
        clock.advance(0.1, told, told, rest, level)
        seen.append(clock.values())
    np.testing.assert_allclose(seen[0][0], [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(seen[5][0], [0.0, 1.0], atol=1e-9)  # half a second is a stride
    np.testing.assert_allclose(seen[1][0], [np.sin(0.4 * np.pi), np.cos(0.4 * np.pi)])
    assert not np.array(seen)[:, 1].any()
    clock.advance(0.1, rest, rest, rest, level)
    assert not clock.values().any()
    clock.advance(0.1, told, told, rest, level)
    np.testing.assert_allclose(clock.values()[0], [0.0, 1.0])


def test_the_clock_runs_on_while_a_command_crosses_zero_on_its_way():
    clock = GaitPhase(2.0)
    for shown in (0.2, 0.0, -0.2):
        clock.advance(0.1, np.array([[shown, 0.0, 0.0]]), -FORWARD, STILL, LEVEL)
    np.testing.assert_allclose(clock.phase, 0.4)


def test_a_tilt_is_as_bad_as_the_speed_at_which_a_body_falls_from_it():
    assert off_balance(np.array([0.3, 0.4]), np.zeros(2)) == pytest.approx(0.5)
    assert off_balance(np.zeros(2), np.array([0.0, 0.1])) == pytest.approx(
        0.1 * np.sqrt(9.81 * 0.52), rel=0.01
    )


def test_strides_are_faster_the_more_a_body_is_out_of_balance():
    away = np.array([0.0, 0.25, 0.425, 0.6, 2.0])
    np.testing.assert_allclose(stride_rate(2.0, HURRY, away), [2.0, 2.0, 2.5, 3.0, 3.0])


def test_a_clock_hurries_after_a_push_and_calms_down():
    clock = GaitPhase(2.0, HURRY)
    pushed = FORWARD + np.array([[0.0, 1.0, 0.0]])
    steps = []
    for velocity in [FORWARD] * 5 + [pushed] * 10 + [FORWARD] * 20:
        before = clock.phase[0]
        clock.advance(0.02, FORWARD, FORWARD, velocity, LEVEL)
        steps.append((clock.phase[0] - before) % 1.0 / 0.02)
    assert steps[4] == pytest.approx(2.0)
    assert steps[14] == pytest.approx(3.0)
    assert steps[34] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ('velocity', 'gravity'),
    [((0.0, 0.8, 0.0), (0.0, 0.0, -1.0)), ((0.0, 0.0, 0.0), (0.3, 0.0, -0.95))],
    ids=['pushed', 'tilted'],
)
def test_a_robot_that_is_to_stand_steps_while_it_is_out_of_balance(velocity, gravity):
    calm, hurried = GaitPhase(2.0), GaitPhase(2.0, HURRY)
    for clock in (calm, hurried):
        for _ in range(5):
            clock.advance(0.02, STILL, STILL, np.array([velocity]), np.array([gravity]))
    assert hurried.values().any()
    assert not calm.values().any()
    for _ in range(20):
        hurried.advance(0.02, STILL, STILL, STILL, LEVEL)
    assert not hurried.values().any()


def test_the_noise_of_sensors_does_not_make_a_clock_hurry():
    clock, random = GaitPhase(2.0, HURRY), np.random.default_rng(1)
    for _ in range(500):
        shake = random.uniform(-1.0, 1.0, (1, 3))
        clock.advance(0.02, STILL, STILL, 0.1 * shake, LEVEL + 0.05 * shake[:, ::-1])
        assert not clock.walking.any()


def test_robots_that_start_anew_have_no_past():
    clock = GaitPhase(2.0, HURRY, 2)
    fast = np.array([[0.0, 2.0, 0.0]] * 2)
    both = np.repeat(LEVEL, 2, axis=0)
    clock.advance(0.02, np.zeros((2, 3)), np.zeros((2, 3)), fast, both)
    clock.start(np.array([1]))
    assert clock.walking.tolist() == [True, False]
    clock.advance(0.02, np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), both)
    assert clock.walking.tolist() == [True, False]


@pytest.mark.parametrize('hurry', [(3.0,), (1.5, 0.2, 0.6), (3.0, 0.6, 0.2), (9.0, 0.2, 0.6)])
def test_a_hurry_that_does_not_fit_is_refused(hurry):
    with pytest.raises(InputError, match=r'2\.0\.\.5 Hz'):
        check_hurry(hurry, 2.0)
    check_hurry((), 2.0)
