"""One scorer: what is held out, what stays with a recording, which samples count."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.model_file.model import FittedValue
from power_estimator.effects.model_file.yaml_file import write_model
from power_estimator.effects.training import fit_model
from power_estimator.judge.held_out import knows
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.loader import load_model, on_base
from power_estimator.proxies import Proxy
from power_recordings.alignment.align import merge
from wattwalk_core.errors import InputError

CATALOGUE = builtin_catalogue()
PLAIN = load_model('plain')


@pytest.fixture(scope='module')
def one(drives):
    return Loaded.of(drives(60.0, seed=1))


@pytest.fixture(scope='module')
def other(drives):
    return Loaded.of(drives(60.0, seed=2, start=5000.0, recording='other'))


@pytest.fixture(scope='module')
def both(one, other):
    return Loaded.of(merge([one.data, other.data]))


def fitted(recording):
    """The plain model fitted to a recording."""
    own, actives = Judge(recording).material(), PLAIN.structure.actives
    return fit_model('plain', own, actives, CATALOGUE, fitted_on=recording.identities)[0]


def errors(judged):
    return [score.rmse_w for score in judged.drives.values()]


def test_a_model_is_refitted_where_it_was_fitted_and_predicted_elsewhere(one, other):
    model = fitted(one)
    here, there = Judge(one).score(model), Judge(other).score(model)
    assert (here.held_out, there.held_out) == ('cross-validated', 'other recordings')
    changed = replace(model, groups=tuple(_doubled(group) for group in model.groups))
    assert errors(Judge(one).score(changed)) == errors(here)
    assert min(errors(Judge(other).score(changed))) > max(errors(there))


def _doubled(group):
    idle = (FittedValue(60.0, (60.0, 60.0)),)
    return replace(group, coefficients={**group.coefficients, 'idle': idle})


def test_signals_without_a_file_are_known_by_what_they_are(one, other, both):
    turned = merge([other.data, one.data.drives(one.data.names[::-1])])
    assert both.identities == (*one.identities, *other.identities)
    assert Loaded.of(turned).identities == both.identities[::-1]
    assert knows(fitted(one), both).tolist() == [True, False]
    louder = replace(one.data, power=one.data.power * np.float32(1.01))
    assert not knows(fitted(one), Loaded.of(louder)).any()


def test_a_structure_without_coefficients_is_judged_as_one_that_was_fitted_here(one):
    assert errors(Judge(one).score(PLAIN)) == pytest.approx(errors(Judge(one).score(fitted(one))))


def test_faults_of_one_meter_stay_with_its_recording(one, other):
    model = fitted(one)
    faults = {'power_gain': 0.02, 'offset_drift': 0.015, 'torque_bend': 0.02, 'torque_bias': 0.3}
    wrong = {name: FittedValue(value, (value, value)) for name, value in faults.items()}
    spoilt = replace(
        model,
        groups=tuple(
            replace(group, measurement={**group.measurement, **wrong}) for group in model.groups
        ),
    )
    assert errors(Judge(other).score(spoilt)) == errors(Judge(other).score(model))


def test_a_recordings_figure_does_not_change_with_one_that_the_model_does_not_know(
    one, other, both
):
    model = fitted(one)
    together = Judge(both).score(model)
    first = Judge(both).prepared.recording == 0
    assert together.how == ('cross-validated', 'other recordings')
    for rows, alone in ((first, one), (~first, other)):
        expected = Judge(alone).score(model).residual
        np.testing.assert_allclose(together.residual[rows], expected, rtol=0.05, atol=0.05)


def test_a_gain_error_of_one_of_two_recordings_costs_the_other_nothing(one, other):
    data = merge([one.data, other.data])
    wrong = data.power * np.where(data.recording == 0, 1.04, 1.0)[:, None].astype(np.float32)
    first = Judge(Loaded.of(data)).prepared.recording == 0
    clean, faulty = (
        Judge(Loaded.of(each)).score(PLAIN).residual for each in (data, replace(data, power=wrong))
    )
    before, after = (np.sqrt(np.nanmean(np.square(each[~first]))) for each in (clean, faulty))
    assert after == pytest.approx(before, rel=0.02)


def test_several_models_are_judged_on_what_all_of_them_know(one):
    proxy = Proxy('mechanical_power')

    class FirstHalf:
        name, needs = 'half', PLAIN.needs

        def predict(self, data):
            half = data.time < data.time.mean()
            power = np.full_like(data.power, 20.0)
            power[~half] = np.nan
            return power

    alone = Judge(one).score(proxy)
    together, half = Judge(one).compare([proxy, FirstHalf()])
    assert (together.rows == half.rows).all()
    assert together.drives['LF_HAA'].samples < 0.55 * alone.drives['LF_HAA'].samples
    assert Judge(one).compare([proxy, proxy])[0].drives == alone.drives


def test_only_the_best_delay_is_taken_out_of_a_recording_that_is_new(one):
    class AsMeasured:
        name, needs = 'late', PLAIN.needs

        def predict(self, data):
            return np.roll(one.data.power, -2, axis=0) + np.float32(5.0)

    judged = Judge(one).score(AsMeasured())
    assert judged.delay == pytest.approx(2 / 200, abs=2e-4)
    assert judged.drives['LF_HAA'].bias_w == pytest.approx(5.0, abs=0.02)
    assert judged.drives['LF_HAA'].rmse_w == pytest.approx(5.0, abs=0.05)


def test_the_first_samples_of_a_stretch_do_not_count(one):
    judged = Judge(one).score(PLAIN)
    assert not judged.rows[:10].any()
    assert judged.rows[10:20].all()


def test_the_supply_is_judged_with_the_electronics_of_the_other_folds(one):
    class Measured:
        name, needs = 'measured', PLAIN.needs

        def predict(self, data):
            return data.power

    (judged,) = Judge(one).compare([Measured()], supply=True)
    assert judged.supply.electronics == pytest.approx(100.0, abs=0.01)
    assert judged.supply.score.r2 == pytest.approx(1.0, abs=1e-6)
    assert judged.supply.lag == 0.0


def test_nothing_left_to_judge_on_is_said_by_name(one):
    class Nothing:
        name, needs = 'nothing', PLAIN.needs

        def predict(self, data):
            return np.full_like(data.power, np.nan)

    with pytest.raises(InputError, match='nothing says nothing about LF_HAA, LF_HFE'):
        Judge(one).score(Nothing())


def louder(recording):
    """The same recording with half as much power again."""
    return replace(recording, data=replace(recording.data, power=1.5 * recording.data.power))


def test_effects_on_a_proxy_estimate_another_recording_without_its_power(one, other, tmp_path):
    judge, idle = Judge(one), Active.of(CATALOGUE['idle'])
    base = judge.base('torque_squared')
    fresh, _ = fit_model(
        'own',
        judge.material(base),
        [idle],
        CATALOGUE,
        base='torque_squared',
        fitted_on=one.identities,
    )
    write_model(on_base(fresh, base), tmp_path / 'own.yaml')
    model = load_model(str(tmp_path / 'own.yaml'))
    assert 'power' not in model.needs.inputs
    quiet, loud = (Judge(known).score(model) for known in (other, louder(other)))
    assert (quiet.held_out, loud.held_out) == ('other recordings', 'other recordings')
    estimates = [judged.measured - judged.residual for judged in (quiet, loud)]
    both = np.isfinite(estimates[0]) & np.isfinite(estimates[1])
    assert both.any()
    assert np.allclose(estimates[0][both], estimates[1][both])


def test_effects_on_a_proxy_are_judged_where_they_were_fitted_with_factors_of_other_folds(one):
    judge, idle = Judge(one), Active.of(CATALOGUE['idle'])
    base = judge.base('torque_squared')
    model, _ = fit_model(
        'own',
        judge.material(base),
        [idle],
        CATALOGUE,
        base='torque_squared',
        fitted_on=one.identities,
    )
    quiet, loud = (Judge(known).score(on_base(model, base)) for known in (one, louder(one)))
    assert quiet.held_out == 'cross-validated'
    assert errors(loud) == pytest.approx([1.5 * error for error in errors(quiet)], rel=0.05)
