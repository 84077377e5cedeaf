from dataclasses import replace

import numpy as np
import pytest
import torch
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.network.checkpoint import Checkpoint
from power_estimator.network.features import Scaling, features
from power_estimator.network.lstm import LstmBank, Weights
from power_estimator.network.ppn import PowerPredictionNetwork, WindowedNetwork
from power_estimator.scores import block_means, r2
from power_estimator.training.trainer import PowerLstm
from wattwalk_core.errors import InputError


def random_network(hidden, seed):
    torch.manual_seed(seed)
    return PowerLstm(hidden)


SCALING = Scaling((0.1, -2.0, 0.3), (0.05, 12.0, 3.0), 40.0, 55.0)


@pytest.mark.parametrize('hidden', [1, 7, 100])
def test_numpy_and_torch_agree_to_1e_4(hidden):
    network = random_network(hidden, 1)
    rng = np.random.default_rng(0)
    x = (rng.standard_normal((300, 5, 3)) * SCALING.scale + SCALING.mean).astype(np.float32)
    bank = LstmBank({'a': (network.weights(), SCALING)}, {'a': range(5)}, 5)
    scaled = (torch.from_numpy(x) - torch.tensor(SCALING.mean)) / torch.tensor(SCALING.scale)
    with torch.no_grad():
        expected = network(scaled)[0].numpy() * SCALING.power_scale + SCALING.power_mean
    assert np.abs(bank.run(x) - expected).max() < 1e-4 * SCALING.power_scale


def test_steps_and_runs_agree_whatever_the_order_of_the_drives():
    networks = {name: (random_network(6, i).weights(), SCALING) for i, name in enumerate('ab')}
    columns = {'a': [4, 0], 'b': [2, 1]}  # drive 3 is unknown
    x = np.random.default_rng(1).standard_normal((50, 5, 3)).astype(np.float32)
    whole = LstmBank(networks, columns, 5).run(x)
    bank = LstmBank(networks, columns, 5)
    assert np.allclose(np.stack([bank.step(row) for row in x]), whole, atol=1e-4, equal_nan=True)
    assert np.isnan(whole[:, 3]).all()
    alone = LstmBank({'b': networks['b']}, {'b': [0]}, 1).run(x[:, 1:2])
    assert np.allclose(whole[:, 1], alone[:, 0], atol=1e-4)


def test_a_reset_forgets_the_past_of_the_drives_that_it_names_only():
    networks = {'a': (random_network(6, 3).weights(), SCALING)}
    x = np.random.default_rng(2).standard_normal((40, 2, 3)).astype(np.float32)
    fresh = np.zeros((40, 2), bool)
    fresh[20, 0] = True
    cut = LstmBank(networks, {'a': [0, 1]}, 2).run(x, fresh)
    whole = LstmBank(networks, {'a': [0, 1]}, 2).run(x)
    late = LstmBank(networks, {'a': [0, 1]}, 2).run(x[20:])
    assert np.allclose(cut[20:, 0], late[:, 0], atol=1e-4)
    assert np.allclose(cut[:, 1], whole[:, 1], atol=1e-4)
    assert not np.allclose(cut[20:25, 0], whole[20:25, 0], atol=1e-3)


def test_weights_of_shapes_that_do_not_fit_are_refused():
    good = random_network(4, 0).weights()
    with pytest.raises(InputError, match=r'tensor bias has shape \(15,\), not \(16,\)'):
        Weights(good.input, good.recurrent, good.bias[:-1], good.output, good.output_bias)


@pytest.fixture(scope='module')
def ppn(checkpoint: Checkpoint) -> PowerPredictionNetwork:
    return PowerPredictionNetwork(checkpoint)


def test_the_windowed_and_the_carried_form_agree_in_r2(ppn, drives):
    data = drives(60.0, seed=7, segments=3)
    stretches = list(data.segments())
    forms = WindowedNetwork(ppn.checkpoint), ppn
    windowed, carried = (block_means(form.predict(data), stretches) for form in forms)
    measured = block_means(data.power, stretches)
    both = np.isfinite(windowed) & np.isfinite(carried)
    assert both.mean() > 0.95
    scores = [r2(measured[both], form[both]) for form in (windowed, carried)]
    assert scores[0] > 0.6
    assert scores[0] == pytest.approx(scores[1], abs=0.005)


def test_the_judge_finds_both_forms_as_good(ppn, drives):
    judge = Judge(Loaded.of(drives(60.0, seed=7, segments=3)))
    forms = WindowedNetwork(ppn.checkpoint, 'windowed'), ppn
    errors = [one.rms_w for one in judge.compare(list(forms))]
    assert errors[0] == pytest.approx(errors[1], rel=0.02)


def test_the_windowed_form_refuses_another_rate(ppn, drives):
    data = drives(5.0)
    with pytest.raises(InputError, match='is aligned to 50 Hz'):
        WindowedNetwork(ppn.checkpoint).predict(replace(data, rate=50.0))


def test_the_carried_form_is_as_good_after_ten_minutes_as_at_the_start(ppn, drives):
    data = drives(600.0, seed=8)
    power = ppn.predict(data)
    begin, end = slice(200, 24_000), slice(-24_000, None)
    early, late = (r2(data.power[rows], power[rows]) for rows in (begin, end))
    assert late > early - 0.05


def test_the_warm_up_and_missing_features_give_no_estimate(ppn, drives):
    data = drives(5.0, segments=2)
    command = data.command.copy()
    command[100, 0] = np.nan
    power = ppn.predict(replace(data, command=command))
    unknown = np.flatnonzero(np.isnan(power[:, 0])).tolist()
    assert unknown == [*range(15), *range(100, 116), *range(500, 515)]
    assert np.flatnonzero(np.isnan(power[:, 1])).tolist() == [*range(15), *range(500, 515)]


def test_what_came_before_a_gap_does_not_matter_after_it(ppn, drives):
    data = drives(4.0, segments=2)
    other = replace(data, torque=np.where(data.segment[:, None] == 0, 0, data.torque))
    assert np.array_equal(ppn.predict(data)[400:], ppn.predict(other)[400:], equal_nan=True)


def test_data_at_twice_the_rate_gives_the_same_estimates_held(ppn, drives):
    data = drives(4.0)
    index = np.repeat(np.arange(len(data.time)), 2)
    twice = replace(data.rows(index), rate=400.0)
    assert np.allclose(ppn.predict(twice)[::2], ppn.predict(data), atol=1e-3, equal_nan=True)


@pytest.mark.parametrize('rate', [100.0, 300.0])
def test_other_rates_are_refused_by_name(ppn, drives, rate):
    with pytest.raises(InputError, match=f'synthetic is aligned to {rate:g} Hz'):
        ppn.predict(replace(drives(1.0), rate=rate))


def test_a_robot_that_the_network_does_not_know_is_refused(ppn, drives):
    with pytest.raises(InputError, match=r'knows drives named .*_HAA.*the input has wheel'):
        ppn.predict(drives(1.0, ('wheel',)))


def test_features_come_in_the_order_of_the_paper(drives):
    data = drives(0.1)
    x = features(data)
    assert np.allclose(x[..., 0], data.command - data.position)
    assert np.array_equal(x[..., 1], data.torque)
    assert np.array_equal(x[..., 2], data.velocity)
