from dataclasses import replace

import numpy as np
import pytest
import torch
from power_estimator.batch.power import BatchPower
from power_estimator.drive_types import infer_types
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.training import fit_model, material
from power_estimator.network.features import features
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy
from power_estimator.scores import block_means
from wattwalk_core.errors import InputError

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


def with_effect(model, name, shape, *values):
    """The model with an effect more, at these coefficients and without a lag."""
    active = Active.of(builtin_catalogue()[name], shape)
    like = model.groups[0].coefficients['idle'][0]
    terms = tuple(replace(like, value=value) for value in values)
    groups = tuple(
        replace(g, velocity_lag=0.0, coefficients={**g.coefficients, name: terms})
        for g in model.groups
    )
    return replace(model, structure=model.structure.plus(active), groups=groups)


def test_robots_share_no_bus(effects):
    model = with_effect(effects, 'regeneration_limit', {}, 1.0)
    torque = np.array([[-2.0, -2.0, -2.0], [40.0, 40.0, 40.0]], np.float32)
    speed = np.full((2, 3), 10.0, np.float32)
    both = BatchPower(model, DRIVES, 2).step(0 * torque, torque, speed)
    for robot in range(2):
        own = slice(robot, robot + 1)
        alone = BatchPower(model, DRIVES, 1).step(0 * torque[own], torque[own], speed[own])
        assert np.allclose(both[robot], alone[0], rtol=1e-6, atol=1e-5)
    assert both[0].sum() == pytest.approx(0.0, abs=1e-4)
    assert both[1].min() > 300


def test_mechanical_power_is_in_watts_without_a_factor():
    torque = np.array([[[20.0, -20.0, 5.0]] * 2], np.float32)
    speed = np.array([[[3.0, 3.0, -1.0]] * 2], np.float32)
    watts = BatchPower(Proxy('mechanical_power'), DRIVES, 1).step(0 * torque, torque, speed)
    assert watts.tolist() == [[60.0, 60.0, 5.0]]


def test_a_nan_stays_within_its_robot_with_any_kind_of_model(effects, robots, drives):
    limited = with_effect(effects, 'regeneration_limit', {}, 1.0)
    proxy = Proxy('torque_squared').fit(drives(20.0, DRIVES))
    broken = [robots[0], replace(robots[1], torque=robots[1].torque * np.nan), robots[2]]
    for model in (limited, proxy):
        batch, whole = (BatchPower(model, DRIVES, 3) for _ in range(2))
        found = walk(batch, broken, steps=range(2))
        assert np.isnan(found[:, 1]).all()
        assert np.allclose(found[:, [0, 2]], walk(whole, robots, steps=range(2))[:, [0, 2]])
        assert np.isnan(walk(batch, robots, steps=[2])[0, 1]).all()
        batch.reset([1])
        assert np.isfinite(walk(batch, robots, steps=[3])).all()


def test_an_effect_that_remembers_more_than_is_kept_is_refused_and_a_spring_is_not(
    effects, robots
):
    for seconds in (8.0, 1500.0):
        warm = with_effect(effects, 'winding_heating', {'time_constant': seconds}, 0.05, 0.0)
        with pytest.raises(InputError, match='base: winding_heating remembers more than'):
            BatchPower(warm, DRIVES, 2)
        with pytest.raises(InputError, match='base: winding_heating remembers more than'):
            BatchPower(replace(warm, groups=warm.groups[:1]), DRIVES[:1], 2)
    measured = with_effect(effects, 'winding_heating', {'time_constant': 0.0}, 0.05, 0.0)
    with pytest.raises(InputError, match='base: winding_heating needs temperature'):
        BatchPower(measured, DRIVES, 2)
    sprung = with_effect(effects, 'spring', {'relaxation': 0.012}, 0.002)
    found = walk(BatchPower(sprung, DRIVES, 3), robots)
    for number, data in enumerate(robots):
        expected = offline(sprung, data)[3:]
        assert np.corrcoef(found[3:, number].ravel(), expected.ravel())[0, 1] > 0.99


def test_a_scaled_proxy_steps_too_and_an_unscaled_one_is_refused(robots, drives):
    data = drives(20.0, DRIVES)
    proxy = Proxy('mechanical_power').fit(data, infer_types(data.names))
    found = walk(BatchPower(proxy, DRIVES, 3), robots)
    assert np.allclose(found[:, 0], offline(proxy, robots[0]), rtol=1e-4, atol=1e-3)
    with pytest.raises(InputError, match='torque_squared has no unit of power for LF_HAA'):
        BatchPower.load('torque_squared', DRIVES, 3)


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
    with pytest.raises(
        InputError, match='base: cogging needs position, and simulated robots give'
    ):
        BatchPower(ripple, DRIVES, 2)


def test_another_shape_is_refused_by_name(ppn):
    batch = BatchPower(ppn, DRIVES, 2)
    good = np.zeros((2, 4, 3), np.float32)
    with pytest.raises(ValueError, match=r'are not all \(2, 4, 3\)'):
        batch.step(good, good[:, :3], good)
    with pytest.raises(ValueError, match='are not all'):
        batch.step(good[:1], good[:1], good[:1])
