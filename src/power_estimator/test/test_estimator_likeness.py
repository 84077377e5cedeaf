import numpy as np
import pytest
from power_estimator.network.out_of_distribution import Guard, OutOfDistributionScore
from wattwalk_core.errors import InputError


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


def alarms(likeness, x):
    return float(Guard([likeness]).unlike(blocks(x)[:, :, None]).mean())


@pytest.fixture(scope='module')
def likeness():
    return OutOfDistributionScore.fit(blocks(motion()), mirror=True)


def test_the_same_motion_at_another_time_raises_no_alarm(likeness):
    assert alarms(likeness, motion(seed=1)) < 0.001
    assert alarms(likeness, -motion(seed=2)) < 0.001


def test_signals_that_do_not_belong_together_raise_it_though_each_is_in_its_range(likeness):
    home = motion()
    torn = home.copy()
    torn[:, 0] = np.roll(home[:, 0], 60)
    low, high = home.min(axis=0), home.max(axis=0)
    assert ((torn >= low) & (torn <= high)).all()
    assert alarms(likeness, torn) > 0.5


def test_a_motion_much_faster_than_any_that_was_seen_raises_it(likeness):
    fast = motion(period=0.1)
    assert (np.abs(fast) < 1.05 * np.abs(motion()).max(axis=0)).all()
    assert alarms(likeness, fast) > 0.3


def test_slower_and_smaller_motion_is_no_alarm(likeness):
    assert alarms(likeness, motion(period=5.0, amplitude=0.5)) == 0


def test_each_drive_is_compared_with_its_own_and_unknown_ones_never(likeness):
    torn = motion()
    torn[:, 0] *= -1
    x = np.stack([motion(), torn, torn], axis=1)
    guard = Guard([likeness, likeness, None])
    found = np.array([guard.unlike(x[i : i + 4]) for i in range(0, 4000, 4)]).mean(axis=0)
    assert found[0] < 0.001
    assert found[1] > 0.5
    assert found[2] == 0


def test_few_or_constant_blocks_give_nothing_to_compare_with():
    assert OutOfDistributionScore.fit(blocks(motion(400)), mirror=True) is None
    assert OutOfDistributionScore.fit(np.ones((500, 4, 3), np.float32), mirror=False) is None


def test_a_card_gives_back_the_same_and_nonsense_is_refused(likeness):
    assert OutOfDistributionScore.of(likeness.content()) == likeness
    with pytest.raises(InputError, match='likeness of shapes'):
        OutOfDistributionScore.of({**likeness.content(), 'mean': [0.0]})
    with pytest.raises(InputError, match='limit -1'):
        OutOfDistributionScore.of({**likeness.content(), 'limit': -1})
