from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.candidate_screener import CandidateScreener
from power_estimator.effects.fit.design import Active, Structure, evaluate
from power_estimator.effects.fit.design_builder import DesignBuilder
from power_estimator.effects.fit.fitter import (
    Blocks,
    Fitter,
    Normal,
    measurement_terms,
    robust_weights,
)
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.signals.prepared import prepare, signals_of
from power_recordings.alignment.dataset import AlignedDataset

RATE = 400.0
CATALOGUE = builtin_catalogue()
TRUE = {
    'shaft': (),
    'copper_loss': (0.02,),
    'viscous_friction': (3.0,),
    'coulomb_friction': (2.0,),
    'rotor_inertia': (0.06,),
    'idle': (8.0,),
}


def structure(*names):
    return Structure(tuple(Active.of(CATALOGUE[name]) for name in names or TRUE))


def moving(seconds=60.0, *, seed=1, delay=0.0, noise=0.3, effects=None):
    """Two drives on a random smooth motion whose power is made by the given effects."""
    effects = TRUE if effects is None else effects
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    lines = random.uniform(0.2, 3.5, (12, 2))
    phases = random.uniform(0, 2 * np.pi, (2, 12, 2))
    waves = 2 * np.pi * lines * time[:, None, None]
    position = (0.25 / lines * np.sin(waves + phases[0])).sum(axis=1)
    velocity = (0.5 * np.pi * np.cos(waves + phases[0])).sum(axis=1)
    torque = 6.0 + (3.0 * np.sin(0.8 * waves + phases[1])).sum(axis=1)
    data = AlignedDataset.blank(
        RATE,
        ('LF_HFE', 'LF_KFE'),
        time,
        'made',
        position=position,
        velocity=velocity,
        torque=torque,
        command=position,
        voltage=48.0,
    )
    model = structure(*effects)
    row = [value for active in model.free for value in effects[active.name]]
    power = evaluate(model, np.array([row, row], dtype=float), signals_of(data))
    late = np.stack([np.interp(time - delay, time, column) for column in power.T], axis=1)
    return replace(data, power=np.float32(late + random.normal(0, noise, late.shape)))


def test_coefficients_and_delay_are_found_again():
    fitter = Fitter(prepare(moving(delay=0.0065)))
    terms = measurement_terms(CATALOGUE, shaft=True)
    fit = fitter.fit(structure().plus(*terms), iterations=5)
    assert fit.delay == pytest.approx(0.0065, abs=3e-4)
    for name, values in TRUE.items():
        for column, value in zip(fit.structure.columns_of(name), values, strict=True):
            assert fit.coefficients[:, column] == pytest.approx([value] * 2, rel=0.06), name


def test_the_linearised_design_meets_the_model_where_it_is_linearised():
    data = moving()
    builder = DesignBuilder(prepare(data))
    model = structure(*TRUE, 'line_resistance', 'spring', 'regeneration_efficiency')
    point = np.array([[0.02, 3.0, 2.0, 0.06, 8.0, 0.1, 0.005, 0.2]] * 2)
    design = builder.build(model, point)
    linear = design.constant + np.einsum('ndm,dm->nd', design.columns, point)
    exact = builder.prepared.reduced(builder.point(model, point).power)
    assert linear == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize('name', ['viscous_friction', 'spring', 'rotor_inertia', 'copper_loss'])
def test_a_column_is_the_derivative_of_the_power(name):
    builder = DesignBuilder(prepare(moving(20.0)))
    model = structure(*TRUE, 'spring')
    point = np.array([[0.02, 3.0, 2.0, 0.06, 8.0, 0.004]] * 2)
    design = builder.build(model, point)
    (column,) = model.columns_of(name)
    step = 1e-4 * point[0, column]
    moved = point.copy()
    moved[:, column] += step
    change = builder.point(model, moved).power - builder.point(model, point).power
    quotient = builder.prepared.reduced(change) / step
    size = np.abs(quotient).max()
    assert design.columns[..., column] == pytest.approx(quotient, abs=5e-3 * size)


def test_intervals_hold_the_truth_about_as_often_as_they_say():
    inside = []
    for seed in range(8):
        fitter = Fitter(prepare(moving(40.0, seed=seed)))
        fit = fitter.fit(structure(), iterations=5)
        bounds = fitter.intervals(fit, seed)
        for name in ('copper_loss', 'viscous_friction', 'rotor_inertia', 'idle'):
            (column,) = fit.structure.columns_of(name)
            low, high = bounds[:, column].T
            slack = 0.01 * TRUE[name][0]
            inside += ((low - slack <= TRUE[name][0]) & (TRUE[name][0] <= high + slack)).tolist()
    assert np.mean(inside) > 0.8


def test_power_between_the_samples_shows_at_half_the_sampling_rate():
    data = moving(40.0)
    calm = prepare(data).unseen(np.zeros(2))
    assert calm.max() < 0.05
    half = 1e-2 * np.where(np.arange(len(data.time)) % 2 == 0, 1.0, -1.0).astype(np.float32)
    torque = data.torque + np.stack([100.0 * half, 0.0 * half], axis=1)
    found = prepare(replace(data, torque=torque))
    expected = np.sqrt(np.mean(np.square(found.state()['velocity'][:, 0])))  # W, of 1 N·m
    assert found.unseen(np.zeros(2))[0] == pytest.approx(expected, rel=0.2)
    assert found.unseen(np.zeros(2))[1] == pytest.approx(calm[1])


def test_drives_of_a_group_share_their_coefficients():
    prepared = prepare(moving())
    shared = Fitter(prepared, groups=[[0, 1]]).fit(structure())
    apart = Fitter(prepared).fit(structure())
    assert shared.coefficients[0].tolist() == shared.coefficients[1].tolist()
    assert apart.coefficients[0].tolist() != apart.coefficients[1].tolist()


def test_a_stumble_weighs_little():
    data = moving()
    power = data.power.copy()
    power[8000:8400] += 400.0
    calm = Fitter(prepare(data)).fit(structure(), iterations=4)
    hit = Fitter(prepare(replace(data, power=power))).fit(structure(), iterations=4)
    assert hit.coefficients == pytest.approx(calm.coefficients, rel=0.1)


def test_weights_fall_with_the_error_and_are_one_at_its_median():
    error = np.array([[1.0], [1.0], [1.0], [99.0]])
    weights = robust_weights(error, np.ones_like(error, bool))
    assert weights[:, 0] == pytest.approx([1.0, 1.0, 1.0, 0.02])


def test_blocks_are_one_second_and_skip_what_was_not_measured():
    data = moving(20.0)
    power = data.power.copy()
    power[4000:4400, 1] = np.nan
    blocks = Blocks.of(prepare(replace(data, power=power)))
    assert blocks.length == 50
    assert blocks.valid[:, 0].all()
    assert 1 <= (~blocks.valid[:, 1]).sum() <= 4


def test_normal_equations_give_the_squared_error():
    random = np.random.default_rng(0)
    prepared = prepare(moving(20.0))
    blocks = Blocks.of(prepared)
    columns = random.normal(size=(len(prepared.time), 2, 3))
    target = random.normal(size=(len(prepared.time), 2))
    x = random.normal(size=(2, 3))
    found = Normal.of(columns, target, blocks).errors(x)
    residual = target - np.einsum('ndm,dm->nd', columns, x)
    expected = (np.square(residual[blocks.rows]) * blocks.use).sum(axis=1)
    assert found == pytest.approx(expected)


def test_rows_around_a_shock_that_400_hz_cannot_show_do_not_count():
    data = moving(40.0)
    torque = data.torque.copy()
    torque[8000:8004, 0] += 60.0
    prepared = prepare(replace(data, torque=torque))
    near = np.abs(prepared.time - data.time[8000]) < 0.02
    assert not prepared.resolved[near, 0].any()
    assert (~prepared.resolved).mean(axis=0).max() <= 1 / 7
    blocks = Blocks.of(prepared)
    assert blocks.counts.min() >= 25
    assert blocks.valid.all()


def test_folds_keep_an_embargo_between_training_and_test():
    blocks = Blocks.of(prepare(moving()))
    folds = Folds.of(blocks)
    assert set(folds.test.tolist()) == set(range(FitSettings.folds))
    for fold in range(FitSettings.folds):
        tested = np.flatnonzero(folds.test == fold)
        trained = np.flatnonzero(folds.training[fold])
        assert np.abs(tested[:, None] - trained).min() > FitSettings.embargo


def test_settings_of_a_fit_hold_in_all_that_follows_from_it():
    settings = FitSettings(block_seconds=(0.5,), folds=3, bootstraps=7)
    fitter = Fitter(prepare(moving()), settings=settings)
    assert fitter.blocks.length == 25  # rows of 50 Hz
    fit = fitter.fit(structure())
    folds = Folds.of(fitter.blocks, settings)
    assert set(folds.test.tolist()) == {0, 1, 2}
    bank = CandidateScreener(fitter, folds, fit, [])
    assert np.isfinite(bank.screen().mse).all()
    assert fitter.drawn(settings.bootstraps, 0).shape == (7, len(fitter.blocks.starts))


def test_the_bank_agrees_with_a_fit_about_what_a_candidate_is_worth():
    fitter = Fitter(prepare(moving()))
    base = fitter.fit(structure('shaft', 'copper_loss', 'viscous_friction', 'idle'), iterations=4)
    candidates = [Active.of(CATALOGUE[n]) for n in ('coulomb_friction', 'rotor_inertia', 'spring')]
    bank = CandidateScreener(fitter, Folds.of(fitter.blocks), base, candidates)
    errors = {c.name: bank.screen([c]).training_error for c in candidates}
    both = bank.screen(candidates[:2])
    none = bank.screen()
    assert errors['rotor_inertia'] < none.training_error - 1.0
    assert both.training_error < errors['rotor_inertia'] - 1.0
    assert both.mean_mse.max() < 0.5 * none.mean_mse.max()


def test_an_interval_of_tied_coefficients_lets_either_take_all():
    fitter = Fitter(prepare(moving()))
    fit = fitter.fit(structure(*TRUE, 'inverter_loss'), iterations=3)
    either = fit.structure.columns_of('inverter_loss')
    at_one_voltage = fitter.intervals(fit)[:, either]
    assert (at_one_voltage[:, :, 0] == 0.0).all()
    assert at_one_voltage[:, 0, 1] == pytest.approx(at_one_voltage[:, 1, 1], rel=0.05, abs=1e-6)


def test_a_recording_that_mostly_rests_keeps_the_rows_that_move():
    data = moving(60.0)
    still = 16000
    hold = {
        name: np.concatenate([np.repeat(getattr(data, name)[:1], still, 0), getattr(data, name)])
        for name in ('position', 'torque', 'command')
    }
    hold['velocity'] = np.concatenate([0.0 * hold['position'][:still], data.velocity])
    more = {
        name: np.concatenate([np.repeat(getattr(data, name)[:1], still, 0), getattr(data, name)])
        for name in ('power', 'voltage', 'current', 'temperature', 'supply')
    }
    count = still + len(data.time)
    place = {
        'time': np.arange(count) / RATE,
        'segment': np.zeros(count, np.int32),
        'recording': np.zeros(count, np.int32),
    }
    prepared = prepare(replace(data, **hold, **more, **place))
    moves = np.abs(prepared.state()['velocity'][:, 0]) > 0.2
    assert prepared.resolved[moves, 0].mean() > 0.8
