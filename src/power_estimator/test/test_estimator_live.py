import numpy as np
import pytest
from power_estimator.live.estimator import CausalSampler, LiveConfig, LiveEstimator, Status
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy
from power_estimator.scores import block_means
from wattwalk_core.errors import InputError

START = 1_700_000_000_000_000_000
PERIOD = 2_500_000


@pytest.fixture(scope='module')
def ppn(checkpoint):
    return PowerPredictionNetwork(checkpoint)


def play(live, data, *, rate=400, skip=(), start=START, command_every=1):
    """Feed a dataset of 200 Hz, each sample repeated at a higher rate; returns the estimates."""
    found = []
    repeat = round(rate / 200)
    for index in range(len(data.time) * repeat):
        stamp, row = start + index * (1_000_000_000 // rate), index // repeat
        if index in skip:
            continue
        if index % command_every == 0:
            live.command(stamp, data.command[row].astype(float))
        signals = (data.position, data.velocity, data.torque)
        estimate = live.joint_state(stamp, *(s[row].astype(float) for s in signals))
        if estimate is not None:
            found.append(estimate)
    return found


@pytest.mark.parametrize('rate', [200, 400])
def test_live_estimates_are_those_of_the_same_samples_offline(ppn, drives, rate):
    data = drives(4.0)
    found = play(LiveEstimator(ppn, data.names), data, rate=rate)
    expected = block_means(ppn.predict(data), data.segments())
    assert len(found) == len(expected) == 200
    power = np.array([e.power for e in found])
    known = np.isfinite(expected)
    assert np.allclose(power[known], expected[known], atol=1e-2)


def test_an_estimate_bears_the_stamp_of_its_newest_joint_state(ppn, drives):
    found = play(LiveEstimator(ppn, ('LF_HAA', 'LF_HFE')), drives(0.2))
    assert [e.stamp - START for e in found] == [(8 * k + 7) * PERIOD for k in range(10)]


def test_it_says_that_it_warms_up_at_first_and_after_a_gap(ppn, drives):
    data = drives(2.0)
    quiet = range(400, 440)  # 100 ms without joint states
    found = play(LiveEstimator(ppn, data.names), data, skip=quiet)
    statuses = [e.status for e in found]
    first = [Status.WARMING_UP] * 4 + [Status.OK] * 46
    assert statuses[:50] == first
    assert statuses[50:55] == [Status.WARMING_UP] * 4 + [Status.OK]


def test_after_a_gap_it_estimates_as_if_it_had_just_begun(ppn, drives):
    data = drives(2.0)
    broken = play(LiveEstimator(ppn, data.names), data, skip=range(400, 440))
    begun = play(
        LiveEstimator(ppn, data.names), data.rows(slice(220, None)), start=START + 440 * PERIOD
    )
    assert [e.stamp for e in broken[50:]] == [e.stamp for e in begun]
    assert np.allclose([e.power for e in broken[50:]], [e.power for e in begun])


def test_a_few_lost_joint_states_change_little(ppn, drives):
    data = drives(4.0)
    whole = play(LiveEstimator(ppn, data.names), data)
    lossy = play(LiveEstimator(ppn, data.names), data, skip={403, 800, 801, 1200})
    assert {e.status for e in lossy[4:]} == {Status.OK}
    power, expected = (np.array([e.power for e in run[5:]]) for run in (lossy, whole))
    assert len(power) == len(expected)
    assert np.abs(power - expected).max() < 0.3 * expected.std()


def test_commands_count_from_their_stamp_on_even_if_they_come_early(ppn):
    live = LiveEstimator(ppn, ('LF_HAA',), LiveConfig(command_timeout=1.0))
    still = (np.zeros(1), np.zeros(1), np.full(1, 5.0))
    live.command(START, np.zeros(1))
    live.command(START + 80 * PERIOD, np.full(1, 0.3))
    power = []
    for index in range(240):
        estimate = live.joint_state(START + index * PERIOD, *still)
        power += [] if estimate is None else [float(estimate.power[0])]
    before, after = power[5:10], power[10:]
    assert np.ptp(before) < np.abs(np.array(after) - before[-1]).max() / 3


def test_without_commands_there_is_no_estimate_and_old_ones_are_stale(ppn, drives):
    data = drives(1.0)
    live = LiveEstimator(ppn, data.names)
    signals = [s[0].astype(float) for s in (data.position, data.velocity, data.torque)]
    assert all(live.joint_state(START + k * PERIOD, *signals) is None for k in range(40))
    found = play(live, data, start=START + 100 * PERIOD, command_every=10_000)
    ages = [(e.stamp - START - 100 * PERIOD) / 1e9 for e in found]
    assert [e.status == Status.INPUT_STALE for e in found] == [age > 0.2 for age in ages]
    assert any(age > 0.2 for age in ages)


def test_commands_without_targets_end_the_estimates_until_there_are_targets(ppn, drives):
    data = drives(1.0)
    live = LiveEstimator(ppn, data.names)
    assert play(live, data.rows(slice(0, 100)))
    live.command(START + 200 * PERIOD, np.full(2, np.nan))
    signals = [s[0].astype(float) for s in (data.position, data.velocity, data.torque)]
    for k in range(200, 240):
        assert live.joint_state(START + k * PERIOD, *signals) is None
    again = play(live, data, start=START + 300 * PERIOD)
    assert again[0].status == Status.WARMING_UP
    assert again[-1].status == Status.OK


def test_a_joint_state_with_nan_does_no_harm_and_is_counted(ppn, drives):
    data = drives(2.0)
    live = LiveEstimator(ppn, data.names)
    play(live, data.rows(slice(0, 200)))
    live.joint_state(START + 400 * PERIOD, np.full(2, np.nan), np.zeros(2), np.zeros(2))
    assert live.refused == 1
    found = play(live, data, start=START + 401 * PERIOD)
    assert np.isfinite([e.power for e in found]).all()


def test_time_that_starts_anew_starts_the_estimate_anew(ppn, drives):
    data = drives(1.0)
    live = LiveEstimator(ppn, data.names)
    first = play(live, data)
    again = play(live, data, start=START - 3_600_000_000_000)
    assert [e.status for e in again] == [e.status for e in first]
    assert np.allclose([e.power for e in again], [e.power for e in first])


def test_motion_outside_the_training_data_is_said_and_motion_inside_is_not(ppn, drives):
    data = drives(20.0, seed=3)
    inside = play(LiveEstimator(ppn, data.names), data)
    assert np.mean([e.status == Status.OUTSIDE_TRAINING_DATA for e in inside]) < 0.01
    data.velocity[400:440, 0] = 60.0
    outside = play(LiveEstimator(ppn, data.names), data.rows(slice(0, 800)))
    flagged = [k for k, e in enumerate(outside) if e.status == Status.OUTSIDE_TRAINING_DATA]
    assert set(flagged) >= set(range(100, 110))
    assert len(flagged) < 13


def test_other_models_run_live_too(drives):
    data = drives(2.0)
    proxy = Proxy('torque_squared').fit(data)
    found = play(LiveEstimator(proxy, data.names), data)
    expected = block_means(proxy.predict(data), data.segments())
    assert np.allclose([e.power for e in found], expected, rtol=1e-3, atol=1e-2)
    assert found[-1].total == pytest.approx(float(expected[-1].sum()), rel=1e-3)


def test_a_sample_comes_with_the_last_joint_state_of_its_bin():
    sampler = CausalSampler(200.0)
    given = [
        [
            (when - START) // PERIOD
            for when, _, _ in sampler.add(START + k * PERIOD, np.ones((4, 1)))
        ]
        for k in range(8)
    ]
    # the period is not known before the second joint state
    assert given == [[], [1], [], [3], [], [5], [], [7]]


def test_jitter_of_a_millisecond_neither_drops_nor_adds_samples():
    sampler = CausalSampler(200.0)
    rng = np.random.default_rng(5)
    count = sum(
        len(
            list(
                sampler.add(
                    START + k * PERIOD + int(rng.integers(-900_000, 900_000)), np.ones((4, 1))
                )
            )
        )
        for k in range(1, 2001)
    )
    assert abs(count - 1000) <= 1


def test_a_timing_out_of_range_is_refused():
    with pytest.raises(InputError, match=r'command_timeout: expected 0.01 to 60 s, there is 0.0'):
        LiveConfig(command_timeout=0.0)
