from dataclasses import asdict

import numpy as np
import pytest
from power_estimator.network.out_of_distribution import Guard, OutOfDistributionScore
from wattwalk_core.errors import InputError
from wattwalk_core.schema import parse


def motion(count=20_000, seed=0, period=2.0, amplitude=1.0):
    """Features [T, 3] at 200 Hz of a drive that swings: torque = 80 · error."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / 200
    phase = 2 * np.pi * (t / period + 0.3 * np.sin(0.2 * t))
    torque = amplitude * (20 * np.sin(phase) + 5 * np.sin(2.3 * phase + seed))
    speed = amplitude * 3 * np.cos(phase)
    noise = rng.standard_normal((3, count)) * np.array([[1e-3], [0.1], [0.02]])
    return (np.stack([torque / 80, torque, speed]) + noise).T.astype(np.float32)


def blocks(x):
    return x[: len(x) // 4 * 4].reshape(-1, 4, 3)


def alarms(score, x):
    return float(Guard([score]).unlike(blocks(x)[:, :, None]).mean())


@pytest.fixture(scope='module')
def score():
    return OutOfDistributionScore.fit(blocks(motion()), mirror=True)


def test_the_same_motion_at_another_time_raises_no_alarm(score):
    assert alarms(score, motion(seed=1)) < 0.001
    assert alarms(score, -motion(seed=2)) < 0.001


def test_signals_that_do_not_belong_together_raise_it_though_each_is_in_its_range(score):
    home = motion()
    torn = home.copy()
    torn[:, 0] = np.roll(home[:, 0], 60)
    low, high = home.min(axis=0), home.max(axis=0)
    assert ((torn >= low) & (torn <= high)).all()
    assert alarms(score, torn) > 0.5


def test_a_motion_much_faster_than_any_that_was_seen_raises_it(score):
    fast = motion(period=0.1)
    assert (np.abs(fast) < 1.05 * np.abs(motion()).max(axis=0)).all()
    assert alarms(score, fast) > 0.3


def test_slower_and_smaller_motion_is_no_alarm(score):
    assert alarms(score, motion(period=5.0, amplitude=0.5)) == 0


def test_each_drive_is_compared_with_its_own_and_unknown_ones_never(score):
    torn = motion()
    torn[:, 0] *= -1
    x = np.stack([motion(), torn, torn], axis=1)
    guard = Guard([score, score, None])
    found = np.array([guard.unlike(x[i : i + 4]) for i in range(0, 4000, 4)]).mean(axis=0)
    assert found[0] < 0.001
    assert found[1] > 0.5
    assert found[2] == 0


def test_few_or_constant_blocks_give_nothing_to_compare_with():
    assert OutOfDistributionScore.fit(blocks(motion(400)), mirror=True) is None
    assert OutOfDistributionScore.fit(np.ones((500, 4, 3), np.float32), mirror=False) is None


def test_a_card_gives_back_the_same_and_nonsense_is_refused(score):
    content = asdict(score)
    assert parse(OutOfDistributionScore, content, 'card') == score
    with pytest.raises(InputError, match='mean and inverse are not 6 and 6 × 6 numbers'):
        parse(OutOfDistributionScore, {**content, 'mean': [0.0]}, 'card')
    with pytest.raises(InputError, match='limit: expected 1e-30 to'):
        parse(OutOfDistributionScore, {**content, 'limit': -1}, 'card')
