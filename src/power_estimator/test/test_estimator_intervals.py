import math
from dataclasses import replace

import numpy as np
import pytest
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.network.checkpoint import Checkpoint, Intervals
from power_estimator.network.ppn import PowerPredictionNetwork
from wattwalk_core.errors import InputError
from wattwalk_core.schema import parse


def noisy(count, seed):
    """Pairs whose error grows with the power: 2 % of it and 1 W."""
    rng = np.random.default_rng(seed)
    estimated = rng.uniform(0, 200, count).astype(np.float32)
    error = (1 + 0.02 * estimated) * rng.standard_normal(count)
    return (estimated + error).astype(np.float32), estimated


def test_an_interval_holds_as_many_of_the_measured_as_it_says():
    intervals = Intervals.fit(*noisy(4000, 0))
    measured, estimated = noisy(20_000, 1)
    low, high = intervals.around(estimated)
    assert np.mean((low <= measured) & (measured <= high)) == pytest.approx(0.9, abs=0.015)
    large = estimated > 150
    assert np.mean((low <= measured)[large] & (measured <= high)[large]) > 0.86


def test_intervals_are_wider_where_errors_are_larger():
    intervals = Intervals.fit(*noisy(4000, 0))
    low, high = intervals.around(np.array([5.0, 190.0], np.float32))
    assert (high - low)[1] > 2.5 * (high - low)[0]


def test_an_error_to_one_side_makes_the_interval_lean():
    _, estimated = noisy(1000, 0)
    intervals = Intervals.fit(estimated + np.float32(7.0), estimated)
    low, high = intervals.around(np.array([50.0], np.float32))
    assert (low[0], high[0]) == (pytest.approx(57.0), pytest.approx(57.0))


def test_few_pairs_give_fewer_bins_and_too_few_give_no_interval():
    assert len(Intervals.fit(*noisy(4000, 0)).below) == 8
    assert len(Intervals.fit(*noisy(150, 0)).below) == 1
    assert Intervals.fit(*noisy(99, 0)) is None
    measured, estimated = noisy(150, 0)
    measured[:60] = np.nan
    assert Intervals.fit(measured, estimated) is None


@pytest.mark.parametrize(('tied', 'count', 'bins'), [(1000, 1000, 1), (2000, 4000, 5)])
def test_equal_estimates_share_a_bin_and_no_bin_has_fewer_than_100(tied, count, bins):
    measured, estimated = noisy(count, 0)
    smallest = np.argsort(estimated)[:tied]
    estimated[smallest] = 8.0
    estimated[estimated < 8.0] = 8.5
    measured[smallest] = 8.0 + np.random.default_rng(1).uniform(-1, 1, tied)
    intervals = Intervals.fit(measured, estimated)
    assert len(intervals.below) == bins
    index = np.searchsorted(intervals.edges, estimated, side='right')
    assert np.bincount(index, minlength=bins).min() >= 100
    low, high = intervals.around(np.array([8.0], np.float32))
    assert (low[0], high[0]) == (pytest.approx(7.1, abs=0.1), pytest.approx(8.9, abs=0.1))


def test_nonsense_is_refused():
    with pytest.raises(InputError, match=r'level: expected 0.01 to 0.999, there is 1.5'):
        Intervals(1.5, (), (1.0,), (1.0,))
    with pytest.raises(InputError, match='not finite numbers by ascending bins'):
        Intervals(0.9, (5.0, 1.0), (1.0,) * 3, (1.0,) * 3)
    with pytest.raises(InputError, match=r'below\[0\]: expected .* W, there is nan'):
        parse(Intervals, {'level': 0.9, 'edges': [], 'below': [math.nan], 'above': [1]}, 'card')


def test_a_network_keeps_its_intervals_on_disk_and_older_files_have_none(checkpoint, tmp_path):
    file = tmp_path / 'model.safetensors'
    checkpoint.save(file)
    loaded = Checkpoint.load(file)
    assert [n.intervals for n in loaded.networks] == [n.intervals for n in checkpoint.networks]
    assert all(n.intervals is not None for n in loaded.networks)
    older = (replace(n, intervals=None, out_of_distribution=None) for n in checkpoint.networks)
    replace(checkpoint, networks=tuple(older)).save(file)
    ppn = PowerPredictionNetwork(Checkpoint.load(file))
    low, high = ppn.interval(np.zeros((4, 2), np.float32), ('LF_HAA', 'LF_HFE'))
    assert np.isnan(low).all()
    assert np.isnan(high).all()
    assert not ppn.guard(('LF_HAA',)).unlike(np.full((4, 1, 3), 1e6, np.float32)).any()


def test_coverage_is_measured_per_drive_and_type_beside_the_scores(checkpoint, drives):
    ppn = PowerPredictionNetwork(checkpoint)
    data = drives(40.0, seed=7)
    found = Judge(Loaded.of(data)).score(ppn)
    low, high = ppn.interval(found.estimated.astype(np.float32), data.names)
    known = found.rows[:, 0]
    measured = found.measured[:, 0]
    inside = (low[:, 0] <= measured) & (measured <= high[:, 0])
    assert found.drives['LF_HAA'].coverage == pytest.approx(inside[known].mean())
    assert found.types['HAA'].coverage == found.drives['LF_HAA'].coverage
    width = (high - low)[known, 0].mean()
    assert found.drives['LF_HAA'].interval_w == pytest.approx(width, rel=1e-5)
    assert 0.6 < found.drives['LF_HAA'].coverage < 1
