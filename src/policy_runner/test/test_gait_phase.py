import numpy as np
import pytest
from policy_runner.policies.gait_phase import (
    GaitPhase,
    capture_point_error,
    check_cadence_adaptation,
    stride_frequency,
)
from wattwalk_core.errors import InputError

LEVEL = np.array([[0.0, 0.0, -1.0]])
STILL = np.zeros((1, 3))
FORWARD = np.array([[0.5, 0.0, 0.0]])
ADAPTATION = (3.0, 0.25, 0.6)


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


def test_a_tilt_counts_as_the_speed_at_which_a_body_falls_from_it():
    assert capture_point_error(np.array([0.3, 0.4]), np.zeros(2)) == pytest.approx(0.5)
    assert capture_point_error(np.zeros(2), np.array([0.0, 0.1])) == pytest.approx(
        0.1 * np.sqrt(9.81 * 0.52), rel=0.01
    )


def test_the_stride_frequency_rises_with_the_capture_point_error():
    away = np.array([0.0, 0.25, 0.425, 0.6, 2.0])
    np.testing.assert_allclose(stride_frequency(2.0, ADAPTATION, away), [2.0, 2.0, 2.5, 3.0, 3.0])


def test_the_cadence_rises_after_a_push_and_falls_again():
    clock = GaitPhase(2.0, ADAPTATION)
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
def test_a_standing_robot_steps_while_it_has_a_capture_point_error(velocity, gravity):
    steady, adaptive = GaitPhase(2.0), GaitPhase(2.0, ADAPTATION)
    for clock in (steady, adaptive):
        for _ in range(5):
            clock.advance(0.02, STILL, STILL, np.array([velocity]), np.array([gravity]))
    assert adaptive.values().any()
    assert not steady.values().any()
    for _ in range(20):
        adaptive.advance(0.02, STILL, STILL, STILL, LEVEL)
    assert not adaptive.values().any()


def test_sensor_noise_does_not_raise_the_cadence():
    clock, random = GaitPhase(2.0, ADAPTATION), np.random.default_rng(1)
    for _ in range(500):
        shake = random.uniform(-1.0, 1.0, (1, 3))
        clock.advance(0.02, STILL, STILL, 0.1 * shake, LEVEL + 0.05 * shake[:, ::-1])
        assert not clock.walking.any()


def test_robots_that_are_reset_have_no_past():
    clock = GaitPhase(2.0, ADAPTATION, 2)
    fast = np.array([[0.0, 2.0, 0.0]] * 2)
    both = np.repeat(LEVEL, 2, axis=0)
    clock.advance(0.02, np.zeros((2, 3)), np.zeros((2, 3)), fast, both)
    clock.start(np.array([1]))
    assert clock.walking.tolist() == [True, False]
    clock.advance(0.02, np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), both)
    assert clock.walking.tolist() == [True, False]


@pytest.mark.parametrize('adaptation', [(3.0,), (1.5, 0.2, 0.6), (3.0, 0.6, 0.2), (9.0, 0.2, 0.6)])
def test_a_cadence_adaptation_that_does_not_fit_is_refused(adaptation):
    with pytest.raises(InputError, match=r'2\.0\.\.5 Hz'):
        check_cadence_adaptation(adaptation, 2.0)
    check_cadence_adaptation((), 2.0)
