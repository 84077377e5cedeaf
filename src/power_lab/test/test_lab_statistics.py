"""Regimes in which a model fails, in words."""

import numpy as np
import pytest
from power_lab.compare.regimes import Regime, bins, worst_regimes


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
