"""Steady operating points: rows of their own, without time."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.signals.prepared import prepare
from power_estimator.effects.training import fit_model, material
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.proxies import Proxy
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

KNOWN = builtin_catalogue()
COPPER, IDLE = 0.05, 20.0  # W/(N·m)², W


def points(torques, speeds, order=None):
    """A table of every torque at every speed, W = τω + 0.05 τ² + 20."""
    tau, w = (grid.ravel() for grid in np.meshgrid(torques, speeds))
    rows = np.arange(len(tau)) if order is None else order
    tau, w = tau[rows, None], w[rows, None]
    blank = AlignedDataset.blank(
        400.0, ('MOTOR',), np.arange(len(tau)) / 400.0, 'table',
        torque=tau, velocity=w, power=tau * w + COPPER * tau**2 + IDLE, voltage=48.0,
    )  # fmt: skip
    return replace(blank, steady=True, segment=np.arange(len(tau), dtype=np.int32))


TABLE = (np.linspace(2, 40, 12), np.linspace(1, 10, 10))


def actives(names):
    return [Active.of(KNOWN[name]) for name in names.split()]


def fitted(data, names='shaft copper_loss idle', per='type'):
    return fit_model('table', material(data, per=per), actives(names), KNOWN)[0]


def test_a_fit_to_points_is_that_of_the_formula_in_any_order():
    shuffled = np.random.default_rng(3).permutation(120)
    for order in (None, shuffled):
        (group,) = fitted(points(*TABLE, order=order)).groups
        assert group.coefficients['copper_loss'][0].value == pytest.approx(COPPER, rel=0.01)
        assert group.coefficients['idle'][0].value == pytest.approx(IDLE, rel=0.01)


def test_no_error_of_the_measurement_that_needs_time_is_fitted():
    (group,) = fitted(points(*TABLE)).groups
    assert {*group.measurement} == {'power_gain', 'torque_bend', 'current_offset', 'torque_bias'}


@pytest.mark.parametrize('effect', ['rotor_inertia', 'spring', 'cogging', 'winding_heating'])
def test_an_effect_that_needs_time_is_refused_with_the_reason(effect):
    with pytest.raises(InputError, match=f'{effect}: it shows while something changes.* table'):
        fitted(points(*TABLE), f'shaft copper_loss {effect}')


def test_every_point_counts_without_delay_and_energy_means_nothing():
    judge = Judge(Loaded.of(points(*TABLE)))
    judged = judge.score(fitted(points(*TABLE)))
    assert judged.drives['MOTOR'].samples == 120
    assert judged.delays == (0.0,)
    assert judged.drives['MOTOR'].r2 > 0.9999
    assert np.isnan(judged.drives['MOTOR'].energy_j)
    assert judge.prepared.seconds == 0.0
    assert judge.prepared.extent == '120 operating points'


def test_a_proxy_is_scaled_on_the_other_points():
    judged = Judge(Loaded.of(points(*TABLE))).score(Proxy('mechanical_power'))
    assert judged.drives['MOTOR'].r2 > 0.5
    assert judged.drives['MOTOR'].samples == 120


def test_folds_of_a_sorted_table_reach_all_of_it_and_train_on_all_others():
    folds = Folds.of(Blocks.of(prepare(points(*TABLE))))
    assert folds.count == 5
    np.testing.assert_array_equal(folds.training.sum(axis=1), 96)
    for fold in range(5):
        tested = np.flatnonzero(folds.test == fold)
        assert len(tested) == 24
        assert tested.min() < 30
        assert tested.max() > 90


def test_fewer_than_twenty_points_are_refused_with_their_number():
    with pytest.raises(InputError, match='19 operating points decide nothing; 20 or more do'):
        material(points(np.arange(1.0, 20.0), [3.0]))
    assert material(points(np.arange(1.0, 21.0), [3.0])).prepared.steady


def test_inertia_of_a_model_fitted_in_motion_adds_nothing_to_a_point():
    data = points(*TABLE)
    model = fitted(data)
    (group,) = model.groups
    inertia = Active.of(KNOWN['rotor_inertia'])
    known = {**group.coefficients, 'rotor_inertia': (group.coefficients['idle'][0],)}
    more = replace(
        model,
        structure=model.structure.plus(inertia),
        groups=(replace(group, coefficients=known),),
    )
    np.testing.assert_array_equal(more.predict(data), model.predict(data))
