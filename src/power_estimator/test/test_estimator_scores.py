import math

import numpy as np
import pytest
from power_estimator.scores import block_means, energy_error, r2, rmse, score


def test_r2_is_one_for_a_perfect_estimate_and_zero_for_the_mean():
    assert r2([1, 2, 3], [1, 2, 3]) == 1.0
    assert r2([1, 2, 3], [2, 2, 2]) == 0.0


def test_r2_by_hand():
    # SS_res = 1 + 0 + 1 + 4 = 6, mean 5, SS_tot = 9 + 1 + 1 + 9 = 20
    assert r2([2, 4, 6, 8], [3, 4, 5, 10]) == pytest.approx(1 - 6 / 20)


def test_r2_is_negative_for_an_estimate_worse_than_the_mean():
    # SS_res = 4 + 0 + 4 = 8, SS_tot = 2
    assert r2([1, 2, 3], [3, 2, 1]) == pytest.approx(-3)


def test_r2_of_a_constant_measurement_is_not_a_number():
    assert math.isnan(r2([5, 5, 5], [5, 5, 5]))
    assert math.isnan(r2([], []))


def test_rmse_and_bias_by_hand():
    assert rmse([0, 0], [3, 4]) == pytest.approx(math.sqrt(12.5))
    assert score([0, 0], [3, 4], 50.0).bias_w == pytest.approx(3.5)


def test_pairs_with_a_gap_in_either_are_left_out():
    found = score([1, np.nan, 3, 5], [1, 2, np.nan, 5], 50.0)
    assert found.samples == 2
    assert found.r2 == 1.0


def test_series_of_different_length_are_refused():
    with pytest.raises(ValueError, match='measured has 2 values, estimated 3'):
        r2([1, 2], [1, 2, 3])


def test_errors_of_energy_cancel_within_a_window_but_not_between_windows():
    measured = np.full(200, 10.0)
    estimated = np.concatenate([np.full(100, 12.0), np.full(100, 8.0)])
    assert energy_error(measured, estimated, rate=1.0, window=200.0) == pytest.approx(0.0)
    assert energy_error(measured, estimated, rate=1.0, window=100.0) == pytest.approx(0.2)


def test_a_series_shorter_than_the_window_is_one_window():
    assert energy_error([10.0, 10.0], [11.0, 11.0], rate=1.0) == pytest.approx(0.1)


def test_blocks_of_four_are_averaged_inside_stretches_only():
    values = np.arange(11, dtype=np.float32)
    means = block_means(values, [slice(0, 5), slice(5, 11)], 4)
    assert means.tolist() == [1.5, 6.5]  # 0…3 and 5…8; 4 and 9, 10 fill no block


def test_a_block_with_a_gap_is_a_gap():
    values = np.array([1, np.nan, 1, 1, 2, 2, 2, 2], np.float32)
    means = block_means(values, [slice(0, 8)], 4)
    assert np.isnan(means[0])
    assert means[1] == 2
