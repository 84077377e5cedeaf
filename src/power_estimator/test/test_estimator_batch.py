from dataclasses import replace

import numpy as np
import pytest
import torch
from power_daq.cli import InputError
from power_estimator.batch import BatchPower
from power_estimator.drive_types import infer_types
from power_estimator.effect_design import Active
from power_estimator.effect_training import fit_model, material
from power_estimator.effects import builtin_catalogue
from power_estimator.features import features
from power_estimator.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy
from power_estimator.scores import block_means

DRIVES = ('LF_HAA', 'RF_HFE', 'RF_HAA')


@pytest.fixture(scope='module')
def ppn(checkpoint):
    return PowerPredictionNetwork(checkpoint)


@pytest.fixture(scope='module')
def robots(drives):
    """Three robots that move differently for 2 s."""
    return [drives(2.0, DRIVES, seed=seed) for seed in (1, 2, 3)]


@pytest.fixture(scope='module')
def effects(drives):
    data, catalogue = drives(60.0, DRIVES), builtin_catalogue()
    active = [Active.of(catalogue[name]) for name in ('shaft', 'copper_loss', 'idle')]
    return fit_model('base', material(data), active, catalogue)[0]


def walk(batch, robots, samples=4, steps=range(100)):
    """Watts [steps, N, D] of stepping through the robots' signals."""
    x = np.stack([features(data) for data in robots])
    rows = [x[:, step * samples : (step + 1) * samples] for step in steps]
    return np.array([batch.step(*np.moveaxis(r, 3, 0)) for r in rows])


def offline(model, data, block=4):
    return block_means(model.predict(data), data.segments(), block)


def test_networks_say_step_by_step_what_they_say_of_the_whole(ppn, robots):
    found = walk(BatchPower(ppn, DRIVES, 3), robots)
    for number, data in enumerate(robots):
        expected = offline(ppn, data)
        known = np.isfinite(expected)
        assert known.mean() > 0.9
        assert np.allclose(found[:, number][known], expected[known], atol=2e-2)


def test_one_sample_at_a_time_gives_the_same_as_four(ppn, robots):
    single = walk(BatchPower(ppn, DRIVES, 3), robots, 1, range(40))
    four = walk(BatchPower(ppn, DRIVES, 3), robots, 4, range(10))
    assert np.allclose(single.reshape(10, 4, 3, 3).mean(axis=1), four, atol=1e-3)


def test_a_reset_makes_one_robot_begin_anew_and_leaves_the_others(ppn, robots):
    batch, fresh = (BatchPower(ppn, DRIVES, 3) for _ in range(2))
    unbroken = walk(BatchPower(ppn, DRIVES, 3), robots)
    walk(batch, robots, steps=range(50))
    batch.reset([1])
    after = walk(batch, robots, steps=range(50, 100))
    begun = walk(fresh, robots, steps=range(50, 100))
    assert np.allclose(after[:, 1], begun[:, 1], atol=1e-4)
    assert np.allclose(after[:, [0, 2]], unbroken[50:][:, [0, 2]], atol=1e-4)
    assert np.abs(after[0, 1] - unbroken[50, 1]).max() > 0.1


def test_it_says_whose_estimate_is_past_its_warm_up(ppn, robots):
    batch = BatchPower(ppn, DRIVES, 3)
    ready = []
    for step in range(6):
        if step == 2:
            batch.reset(torch.tensor([0]))
        walk(batch, robots, steps=[step])
        ready.append(batch.ready.tolist())
    assert ready[:4] == [[False] * 3] * 3 + [[False, True, True]]
    assert ready[5] == [True, True, True]


def test_tensors_give_tensors_and_arrays_arrays(ppn, robots):
    x = np.stack([features(data)[:4] for data in robots])
    signals = np.moveaxis(x, 3, 0)
    watts = BatchPower(ppn, DRIVES, 3).step(*signals)
    tensor = BatchPower(ppn, DRIVES, 3).step(*map(torch.tensor, signals))
    assert isinstance(watts, np.ndarray)
    assert isinstance(tensor, torch.Tensor)
    assert not tensor.is_inference()
    assert np.array_equal(watts, tensor.numpy())


def test_a_nan_harms_no_other_robot_and_is_gone_after_a_reset(ppn, robots):
    batch = BatchPower(ppn, DRIVES, 3)
    broken = [robots[0], replace(robots[1], torque=robots[1].torque * np.nan), robots[2]]
    found = walk(batch, broken, steps=range(2))
    assert np.isnan(found[:, 1]).all()
    assert np.isfinite(found[:, [0, 2]]).all()
    batch.reset([1])
    assert np.isfinite(walk(batch, robots, steps=[2])).all()


def test_a_model_of_effects_steps_to_what_it_says_of_the_whole(effects, robots):
    lagless = replace(
        effects, groups=tuple(replace(group, velocity_lag=0.0) for group in effects.groups)
    )
    found = walk(BatchPower(lagless, DRIVES, 3), robots)
    for number, data in enumerate(robots):
        assert np.allclose(found[:, number], offline(lagless, data), rtol=1e-4, atol=1e-2)


def test_effects_with_derivatives_are_nearly_those_of_the_whole(effects, robots):
    inertia = Active.of(builtin_catalogue()['rotor_inertia'])
    value = replace(effects.groups[0].coefficients['idle'][0], value=0.05)
    groups = tuple(
        replace(g, velocity_lag=0.0, coefficients={**g.coefficients, 'rotor_inertia': (value,)})
        for g in effects.groups
    )
    model = replace(effects, structure=effects.structure.plus(inertia), groups=groups)
    found = walk(BatchPower(model, DRIVES, 3), robots)
    for number, data in enumerate(robots):
        expected = offline(model, data)[1:]
        assert np.corrcoef(found[1:, number].ravel(), expected.ravel())[0, 1] > 0.98


def test_a_reset_keeps_the_past_of_an_effect_model_out(effects, robots):
    batch, fresh = (BatchPower(effects, DRIVES, 3) for _ in range(2))
    walk(batch, robots, steps=range(10))
    batch.reset()
    again = walk(batch, robots, steps=range(20, 30))
    assert np.allclose(again, walk(fresh, robots, steps=range(20, 30)))


def test_a_scaled_proxy_steps_too_and_an_unscaled_one_is_refused(robots, drives):
    data = drives(20.0, DRIVES)
    proxy = Proxy('mechanical_power').fit(data, infer_types(data.names))
    found = walk(BatchPower(proxy, DRIVES, 3), robots)
    assert np.allclose(found[:, 0], offline(proxy, robots[0]), rtol=1e-4, atol=1e-3)
    with pytest.raises(InputError, match='mechanical_power has no unit of power for LF_HAA'):
        BatchPower.load('mechanical_power', DRIVES, 3)


def test_models_that_cannot_be_stepped_are_refused_by_name(ppn, effects):
    with pytest.raises(InputError, match='does not know the drive LF_KFE'):
        BatchPower(ppn, ('LF_HAA', 'LF_KFE'), 2)
    with pytest.raises(InputError, match='does not know the drive arm_1'):
        BatchPower(effects, ('arm_1',), 2)
    with pytest.raises(InputError, match='robots = 0'):
        BatchPower(ppn, DRIVES, 0)
    with pytest.raises(InputError, match='base has no coefficients yet'):
        BatchPower(replace(effects, groups=()), DRIVES, 1)
    catalogue = builtin_catalogue()
    cogging = Active.of(catalogue['cogging'])
    value = effects.groups[0].coefficients['idle'][0]
    terms = (value,) * len(cogging.effect.terms)
    groups = tuple(
        replace(g, coefficients={**g.coefficients, 'cogging': terms}) for g in effects.groups
    )
    ripple = replace(effects, structure=effects.structure.plus(cogging), groups=groups)
    with pytest.raises(InputError, match=r"needs more than .* 'cogging'"):
        BatchPower(ripple, DRIVES, 2)


def test_another_shape_is_refused_by_name(ppn):
    batch = BatchPower(ppn, DRIVES, 2)
    good = np.zeros((2, 4, 3), np.float32)
    with pytest.raises(ValueError, match=r'are not all \(2, 4, 3\)'):
        batch.step(good, good[:, :3], good)
    with pytest.raises(ValueError, match='are not all'):
        batch.step(good[:1], good[:1], good[:1])
