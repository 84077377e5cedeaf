import numpy as np
import pytest
from policy_training.config import RewardConfig
from policy_training.environment.rewards import FootClock, Moment, Rewards
from policy_training.environment.robots import Motion
from wattwalk_core.anymal import DEFAULT_POSE

STEP = 0.02


def motion(**changes):
    one = {
        'velocity': np.zeros((1, 3)),
        'rate': np.zeros((1, 3)),
        'gravity': np.array([[0.0, 0.0, -1.0]]),
        'position': DEFAULT_POSE[None],
        'joint_velocity': np.zeros((1, 12)),
        'torque': np.zeros((1, 12)),
        'foot_force': np.full((1, 4), 120.0),
        'collisions': np.zeros(1),
        'fallen': np.zeros(1, bool),
    }
    return Motion(**{**one, **changes})


def moment(**changes):
    one = {
        'command': np.zeros((1, 3)),
        'asked': np.ones(1, bool),
        'action': np.zeros((1, 12)),
        'last_action': np.zeros((1, 12)),
        'acceleration': np.zeros((1, 12)),
        'flight': np.zeros(1),
    }
    return Moment(**{**one, **changes})


def terms(seen, now, config=None):
    return {
        k: float(v[0]) for k, v in Rewards(config or RewardConfig(), STEP).terms(seen, now).items()
    }


def test_perfect_tracking_earns_the_full_weights():
    command = np.array([[0.5, -0.2, 0.7]])
    found = terms(
        motion(velocity=np.array([[0.5, -0.2, 0.0]]), rate=np.array([[0.0, 0.0, 0.7]])),
        moment(command=command),
    )
    assert found['velocity'] == pytest.approx(1.0 * STEP)
    assert found['yaw'] == pytest.approx(0.5 * STEP)
    assert all(value == 0.0 for name, value in found.items() if name not in ('velocity', 'yaw'))


def test_half_a_metre_a_second_astray_earns_exp_minus_one():
    found = terms(motion(), moment(command=np.array([[0.3, 0.4, 0.5]])))
    assert found['velocity'] == pytest.approx(np.exp(-1.0) * STEP)
    assert found['yaw'] == pytest.approx(0.5 * np.exp(-1.0) * STEP)


@pytest.mark.parametrize(
    ('name', 'seen', 'now', 'expected'),
    [
        ('vertical', {'velocity': np.array([[0.0, 0.0, 0.5]])}, {}, -2.0 * 0.25),
        ('rolling', {'rate': np.array([[1.0, 2.0, 9.0]])}, {}, -0.05 * 5.0),
        ('orientation', {'gravity': np.array([[0.6, 0.0, -0.8]])}, {}, -5.0 * 0.36),
        ('torque', {'torque': np.full((1, 12), 10.0)}, {}, -2.5e-5 * 1200.0),
        ('collision', {'collisions': np.array([3.0])}, {}, -3.0),
        ('acceleration', {}, {'acceleration': np.full((1, 12), 100.0)}, -2.5e-7 * 120_000.0),
        ('action_rate', {}, {'action': np.ones((1, 12))}, -0.01 * 12.0),
        ('air_time', {}, {'flight': np.array([0.2])}, 2.0 * 0.2),
    ],
)
def test_each_term_by_hand(name, seen, now, expected):
    assert terms(motion(**seen), moment(**now))[name] == pytest.approx(expected * STEP)


def test_steps_in_place_earn_nothing_without_a_command():
    still = moment(flight=np.array([0.2]), asked=np.zeros(1, bool))
    assert terms(motion(), still)['air_time'] == 0.0


def test_the_sum_is_not_negative_unless_asked():
    bad = {'a': np.array([0.1]), 'b': np.array([-3.0])}
    assert Rewards(RewardConfig(), STEP).total(bad)[0] == 0.0
    free = RewardConfig(only_positive=False)
    assert Rewards(free, STEP).total(bad)[0] == pytest.approx(-2.9)


def test_a_foot_that_lands_after_0_6_s_earns_0_1_s():
    clock = FootClock(1, STEP, 0.5)
    down, up = np.full((1, 4), 100.0), np.array([[0.0, 100.0, 100.0, 100.0]])
    assert clock.land(down)[0] == 0.0
    flights = [clock.land(up)[0] for _ in range(30)]
    assert flights == [0.0] * 30
    assert clock.land(down)[0] == pytest.approx(30 * STEP - 0.5)
    assert clock.land(down)[0] == 0.0
