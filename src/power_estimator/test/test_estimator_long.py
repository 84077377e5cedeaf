"""State that is carried for long, and motion at home and elsewhere."""

import numpy as np
import pytest
from power_estimator.live.estimator import LiveEstimator, Status
from power_estimator.network.features import features
from power_estimator.network.lstm import LstmBank
from power_estimator.network.ppn import PowerPredictionNetwork

PERIOD = 5_000_000


@pytest.fixture(scope='module')
def ppn(checkpoint):
    return PowerPredictionNetwork(checkpoint)


def as_64_bit(bank):
    """The same bank with all numbers in double precision."""
    for name in ('_input', '_recurrent', '_bias', '_output', '_offset', '_h', '_c'):
        setattr(bank, name, getattr(bank, name).astype(np.float64))
    return bank


def test_after_long_the_state_is_that_of_a_network_that_has_just_begun(ppn, drives):
    x = features(drives(300.0, seed=4))
    long, begun = (ppn.stream(('LF_HAA', 'LF_HFE')) for _ in range(2))
    late = x[-1000:]
    long.run(x[:-1000])
    unbroken, fresh = long.run(late), begun.run(late)
    spread = unbroken.std(axis=0)
    assert (np.abs(unbroken - fresh)[200:] < 0.02 * spread).all()
    assert (np.abs(unbroken - fresh)[600:] < 1e-3 * spread).all()


def test_rounding_to_32_bit_does_not_add_up(ppn, drives):
    x = features(drives(300.0, seed=4))
    single = ppn.stream(('LF_HAA', 'LF_HFE'))
    double = as_64_bit(ppn.stream(('LF_HAA', 'LF_HFE')))
    assert isinstance(double, LstmBank)
    apart = np.abs(single.run(x) - double.run(x.astype(np.float64)))
    assert apart[-2000:].max() < 2 * apart[:2000].max() + 1e-3
    assert apart.max() < 0.05


def said(live, data):
    """Statuses after the warm-up of playing a dataset at 200 Hz."""
    found = []
    signals = (data.position, data.velocity, data.torque)
    for row in range(len(data.time)):
        live.command(row * PERIOD, data.command[row].astype(float))
        estimate = live.joint_state(row * PERIOD, *(s[row].astype(float) for s in signals))
        if estimate is not None:
            found.append(estimate.status)
    return np.array(found[5:])


def test_at_home_there_is_hardly_an_alarm(ppn, drives):
    data = drives(60.0, seed=11)
    alarms = said(LiveEstimator(ppn, data.names), data) == Status.OUTSIDE_TRAINING_DATA
    assert alarms.mean() < 0.01


@pytest.mark.parametrize('unlike', ['torque without its error', 'reversed torque', 'shaking'])
def test_motion_unlike_the_training_set_is_noticed_within_the_range_of_each_signal(
    ppn, drives, unlike
):
    data = drives(20.0, seed=12)
    if unlike == 'torque without its error':
        data.torque[:] = np.roll(data.torque, 150, axis=0)
    elif unlike == 'reversed torque':
        data.torque[:] *= -1
    else:
        time = np.arange(len(data.time)) / data.rate
        data.velocity[:] = 6 * np.sin(2 * np.pi * 22 * time)[:, None]
    low, high = ppn.range_of(data.names)
    x = features(data)
    inside = ((x > low - 0.05 * (high - low)) & (x < high + 0.05 * (high - low))).all(axis=(1, 2))
    assert inside.mean() > 0.99
    alarms = said(LiveEstimator(ppn, data.names), data) == Status.OUTSIDE_TRAINING_DATA
    assert alarms.mean() > 0.3
