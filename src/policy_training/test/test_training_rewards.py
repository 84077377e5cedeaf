import numpy as np
import pytest
from policy_training.config import RewardConfig
from policy_training.environment.rewards import REWARDS, FootClock, Rewards, RewardState
from policy_training.environment.robots import RobotMotion
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
    return RobotMotion(**{**one, **changes})


def state(motion, **changes):
    one = {
        'command': np.zeros((1, 3)),
        'walking': np.ones(1, bool),
        'action': np.zeros((1, 12)),
        'last_action': np.zeros((1, 12)),
        'acceleration': np.zeros((1, 12)),
        'flight': np.zeros(1),
        'sigma': 0.25,
    }
    return RewardState(motion, **{**one, **changes})


def terms(now):
    found = Rewards(RewardConfig(), STEP).terms(now)
    return {name: float(values[0]) for name, values in found.items()}


def test_perfect_tracking_earns_the_full_weights():
    command = np.array([[0.5, -0.2, 0.7]])
    moving = motion(velocity=np.array([[0.5, -0.2, 0.0]]), rate=np.array([[0.0, 0.0, 0.7]]))
    found = terms(state(moving, command=command))
    assert found.pop('tracking_lin_vel') == pytest.approx(1.0 * STEP)
    assert found.pop('tracking_ang_vel') == pytest.approx(0.5 * STEP)
    assert not any(found.values())


def test_half_a_metre_a_second_astray_earns_exp_minus_one():
    found = terms(state(motion(), command=np.array([[0.3, 0.4, 0.5]])))
    assert found['tracking_lin_vel'] == pytest.approx(np.exp(-1.0) * STEP)
    assert found['tracking_ang_vel'] == pytest.approx(0.5 * np.exp(-1.0) * STEP)


@pytest.mark.parametrize(
    ('name', 'seen', 'now', 'expected'),
    [
        ('lin_vel_z', {'velocity': np.array([[0.0, 0.0, 0.5]])}, {}, -2.0 * 0.25),
        ('ang_vel_xy', {'rate': np.array([[1.0, 2.0, 9.0]])}, {}, -0.05 * 5.0),
        ('orientation', {'gravity': np.array([[0.6, 0.0, -0.8]])}, {}, -5.0 * 0.36),
        ('torques', {'torque': np.full((1, 12), 10.0)}, {}, -2.5e-5 * 1200.0),
        ('collision', {'collisions': np.array([3.0])}, {}, -3.0),
        ('dof_acc', {}, {'acceleration': np.full((1, 12), 100.0)}, -2.5e-7 * 120_000.0),
        ('action_rate', {}, {'action': np.ones((1, 12))}, -0.01 * 12.0),
        ('feet_air_time', {}, {'flight': np.array([0.2])}, 2.0 * 0.2),
    ],
)
def test_each_term_by_hand(name, seen, now, expected):
    assert terms(state(motion(**seen), **now))[name] == pytest.approx(expected * STEP)


def test_steps_in_place_earn_nothing_without_a_command():
    still = state(motion(), flight=np.array([0.2]), walking=np.zeros(1, bool))
    assert terms(still)['feet_air_time'] == 0.0


RECORDED = {
    'tracking_lin_vel': [0.00206428259, 5.940850354e-05, 0.01203123145],
    'tracking_ang_vel': [0.001603636211, 0.004467850944, 0.009561893897],
    'lin_vel_z': [-0.0007515156374, -0.0098336289, -0.002422672569],
    'ang_vel_xy': [-0.0001562335839, -0.0002192207366, -0.0005725898203],
    'orientation': [-0.02111022196, -0.006646753693, -0.0002380563249],
    'torques': [-0.002408857591, -0.0009230542274, -0.003906570066],
    'dof_acc': [-0.0004974213424, -0.001203320603, -0.0003292591047],
    'feet_air_time': [0.0025884564, 0.0, 0.006133305179],
    'collision': [0.0, -0.02, -0.06],
    'action_rate': [-0.00708513178, -0.00597153998, -0.002859261513],
    'stand_still': [0.0, -0.0159767917, 0.0],
}
"""Rewards of the robots below before there was a function for each."""


def test_rewards_are_as_recorded_before():
    random = np.random.default_rng(7)

    def normal(width, *shape):
        return random.normal(0.0, width, (3, *shape))

    moving = RobotMotion(
        velocity=normal(0.5, 3),
        rate=normal(0.5, 3),
        gravity=normal(0.2, 3),
        position=DEFAULT_POSE + normal(0.3, 12),
        joint_velocity=normal(2.0, 12),
        torque=normal(20.0, 12),
        foot_force=random.uniform(0.0, 200.0, (3, 4)),
        collisions=np.array([0.0, 1.0, 3.0]),
        fallen=np.array([False, False, True]),
    )
    now = RewardState(
        moving,
        command=random.uniform(-1.0, 1.0, (3, 3)),
        walking=np.array([True, False, True]),
        action=normal(1.0, 12),
        last_action=normal(1.0, 12),
        acceleration=normal(100.0, 12),
        flight=normal(0.3),
        sigma=0.25,
    )
    rewards = Rewards(RewardConfig(stand_still=-0.3, only_positive=False), STEP)
    found = rewards.terms(now)
    assert list(found) == list(RECORDED) == list(REWARDS)
    for name, values in RECORDED.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-8, err_msg=name)
    expected = [-0.02575301, -0.05624705, -0.04260198]
    np.testing.assert_allclose(rewards.total(found), expected, rtol=1e-6)


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
