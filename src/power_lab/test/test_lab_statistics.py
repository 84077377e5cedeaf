from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.signals.prepared import prepare
from power_lab.compare.regimes import Regime, bins, worst_regimes
from power_lab.diagnose.confidence_set import confidence_set
from power_lab.diagnose.residual_structure import examine_structure
from truth_circuit import Truth, record


def test_a_clearly_better_model_stands_alone_in_the_set():
    random = np.random.default_rng(0)
    common = random.normal(size=200)
    losses = [common + random.normal(0, 0.1, 200) + step for step in (0.3, 0.0, 0.2)]
    assert confidence_set(losses) == [1]


def test_models_that_differ_by_chance_all_stay():
    random = np.random.default_rng(1)
    common = random.normal(size=200)
    losses = [common + random.normal(0, 0.3, 200) for _ in range(4)]
    assert len(confidence_set(losses)) >= 3


def test_models_that_say_the_same_stand_or_fall_together():
    random = np.random.default_rng(2)
    best = random.normal(size=200)
    assert confidence_set([best + 0.5, best, best.copy()]) == [1, 2]
    assert confidence_set([best, best.copy()]) == [0, 1]


def test_the_best_model_is_kept_about_as_often_as_promised():
    kept = 0
    for seed in range(30):
        random = np.random.default_rng(seed)
        common = np.convolve(random.normal(size=220), np.ones(5) / 5, 'same')[10:-10]
        losses = [common + random.normal(0, 0.2, 200) + 0.01 * step for step in range(3)]
        kept += 0 in confidence_set(losses, seed=seed)
    assert kept >= 25


@pytest.fixture(scope='module')
def walk():
    data = record(Truth({'copper_loss': 1.0, 'idle': 1.0}, seconds=60.0, seed=4))
    prepared = prepare(data)
    blocks = Blocks.of(prepared)
    return prepared, blocks, Folds.of(blocks)


def noise(prepared):
    shape = (len(prepared.time), len(prepared.names))
    return np.random.default_rng(5).normal(0, 0.2, shape)


def test_noise_has_no_structure(walk):
    prepared, blocks, folds = walk
    left = examine_structure(noise(prepared), prepared, blocks, folds)
    assert left.explained.max() < 0.05**2
    assert left.total == pytest.approx(0.04, rel=0.1)
    assert np.isnan(left.period).all()


def test_structure_over_position_is_found_in_the_state(walk):
    prepared, blocks, folds = walk
    position = prepared.state()['position']
    bump = 0.8 * np.sin(3.0 * (position - position.mean(axis=0)) / position.std(axis=0))
    left = examine_structure(noise(prepared) + bump, prepared, blocks, folds)
    expected = np.mean(np.square(bump), axis=0)
    assert (left.state > 0.6 * expected).all()
    assert left.slow.max() < 0.1 * expected.min()


def test_what_lives_in_time_alone_is_found_with_its_period(walk):
    prepared, blocks, folds = walk
    since = prepared.time - prepared.time[0]
    cycle = np.sign(np.sin(2 * np.pi * since / 10.0))[:, None]
    left = examine_structure(noise(prepared) + cycle, prepared, blocks, folds)
    assert left.slow.min() > 0.15
    assert left.period == pytest.approx([10.0] * 3, rel=0.25)
    assert left.ljung_box.max() < 1e-6


def test_the_period_is_looked_for_within_the_longest_recording(walk):
    prepared, blocks, _ = walk
    later = np.arange(len(blocks.starts)) >= 45
    two = replace(
        blocks,
        recording=later.astype(np.int32),
        time=blocks.time - 600_000.0 * later,  # the second recording is a week older
    )
    since = prepared.time - prepared.time[0]
    cycle = np.sign(np.sin(2 * np.pi * since / 10.0))[:, None]
    left = examine_structure(noise(prepared) + cycle, prepared, two, Folds.of(two))
    assert left.period == pytest.approx([10.0] * 3, rel=0.35)


def test_a_neighbours_power_is_found_as_cross_talk(walk):
    prepared, blocks, folds = walk
    power = prepared.power_at(0.0)
    leak = np.zeros_like(power)
    leak[:, 0] = 0.05 * (power[:, 2] - power[:, 2].mean())
    left = examine_structure(noise(prepared) + leak, prepared, blocks, folds)
    assert left.state[0] + left.cross[0] > 0.7 * np.mean(np.square(leak[:, 0]))
    assert left.cross[1:].max() < 0.01


def rows(count=4000):
    random = np.random.default_rng(3)
    state = {
        'torque': random.uniform(-50, 50, (count, 2)),
        'velocity': random.uniform(-8, 8, (count, 2)),
        'acceleration': random.normal(0, 20, (count, 2)),
        'position': random.uniform(-1, 1, (count, 2)),
        'time': np.tile(np.arange(count)[:, None] / 50.0, (1, 2)),
    }
    return state, random.normal(0, 0.3, (count, 2))


def test_the_worst_regime_is_said_in_words():
    state, residual = rows()
    torque, velocity = state['torque'][:, 1], state['velocity'][:, 1]
    where = (np.abs(torque) > 20) & (np.abs(torque) < 40) & (np.abs(velocity) > 3)
    where &= torque * velocity > 0
    residual[where, 1] += 14.0
    worst = worst_regimes(residual, state, ('LF_HFE', 'LF_KFE'))[0]
    assert worst.text == 'LF_KFE, driving, 20 to 40 N·m, above 3 rad/s: 14 W too low'
    assert worst.bounds['torque'] == (20.0, 40.0)
    assert worst.json()['seconds'] == pytest.approx(where.sum() / 50.0, abs=0.02)


def test_an_error_over_position_is_said_as_a_range_of_position():
    state, residual = rows()
    position = state['position'][:, 0]
    residual[(position > 0.25) & (position < 0.75), 0] -= 3.0
    worst = worst_regimes(residual, state, ('LF_HFE', 'LF_KFE'))[0]
    assert worst.drive == 'LF_HFE'
    assert 'position' in worst.text
    assert worst.text.endswith('3 W too high')
    low, high = worst.bounds['position']
    assert (low, high) == pytest.approx((0.25, 0.75), abs=0.05)


def test_stance_and_swing_are_told_apart():
    state, residual = rows()
    phase = np.where(np.arange(4000) % 40 < 20, 'stance', 'swing')
    residual[phase == 'stance', 0] += 2.0
    labels = {'phase': np.stack([phase, phase], axis=1)}
    found = worst_regimes(residual, state, ('LF_HFE', 'LF_KFE'), labels)
    assert any(regime.text == 'LF_HFE, stance: 2 W too low' for regime in found)


def test_noise_has_no_worst_regime():
    state, residual = rows()
    assert worst_regimes(residual, state, ('LF_HFE', 'LF_KFE')) == []


def test_bins_give_the_mean_error_with_the_sign_of_the_model():
    values = np.repeat(np.arange(10.0), 100)
    found = bins(values, np.where(values > 4, 1.0, 0.0), 10)
    assert found[0].mean == 0.0
    assert found[-1].mean == -1.0
    assert sum(b.count for b in found) >= 900


def test_small_errors_are_said_with_two_digits():
    regime = Regime('LF_HAA', ('at rest',), {}, 0.1234, 3.0, 0.5)
    assert regime.text == 'LF_HAA, at rest: 0.12 W too high'
