"""A seeded part of the blind benchmark: truths are circuits, never the lab's formulas."""

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter, measurement_terms
from power_estimator.effects.signals.prepared import prepare
from power_lab.diagnose.diagnosis import Diagnoser
from power_lab.diagnose.verdict import sentence
from power_lab.structure.floors import above_floor, shared
from truth_circuit import Faults, Truth, record

CATALOGUE = builtin_catalogue()
MID = ('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle')


def diagnose(hidden, motion='walk', *, base=MID, seed=1, seconds=70.0, faults=None):
    effects = dict.fromkeys(base, 1.0) | hidden
    data = record(Truth(effects, motion, seconds, seed, seed + 50, faults or Faults()))
    known = [name for name in base if name not in hidden]
    structure = Structure(tuple(Active.of(CATALOGUE[n]) for n in ('shaft', *known)))
    terms = measurement_terms(CATALOGUE, shaft=True)
    return Diagnoser(Fitter(prepare(data)), structure.plus(*terms), CATALOGUE).run()


def told(found):
    return sentence(found, *(np.sqrt(e.mean_mse.mean()) for e in (found.base, found.best)))


@pytest.mark.parametrize('motion', ['walk', 'ladder'])
def test_nothing_is_named_where_nothing_is_missing(motion):
    found = diagnose({}, motion)
    assert found.verdict == 'no_evidence'
    assert found.effects == ()
    assert 'No evidence' in told(found)


@pytest.mark.parametrize(
    ('hidden', 'motion'),
    [
        ('load_friction', 'walk'),
        ('rotor_inertia', 'walk'),
        ('spring', 'ladder'),
        ('regeneration_limit', 'ladder'),
        ('line_resistance', 'ladder'),
        ('idle', 'walk'),
        ('coulomb_friction', 'walk'),
    ],
)
def test_the_hidden_effect_is_named(hidden, motion):
    found = diagnose({hidden: 1.0}, motion)
    assert found.verdict == 'named', found.steps
    assert found.effects == (hidden,)
    assert found.best.mean_mse.sum() < 0.5 * found.base.mean_mse.sum()
    assert 'missing from the model' in told(found)


def test_two_hidden_effects_are_both_named():
    found = diagnose({'load_friction': 1.0, 'rotor_inertia': 1.0}, 'ladder')
    assert found.verdict == 'named'
    assert set(found.effects) == {'load_friction', 'rotor_inertia'}


@pytest.mark.parametrize(
    ('missing', 'kind', 'depends_on'),
    [
        ('position_rub', 'state', 'position'),
        ('fan', 'slow', 'time'),
        ('cross_talk', 'cross', 'other_drive'),
    ],
)
def test_an_unmodelled_effect_is_none_of_the_above_and_what_it_depends_on_is_said(
    missing, kind, depends_on
):
    found = diagnose({missing: 1.0})
    assert found.verdict == 'none_of_the_above'
    assert found.effects == ()
    assert getattr(found.unexplained, kind).max() > 0.05
    assert 'none of the known effects' in told(found)
    assert found.remainder.kind == depends_on
    assert f'most over {found.remainder.over[0]}: `discover` can describe it' in told(found)


@pytest.mark.parametrize(
    ('missing', 'over'),
    [
        ('position_rub', 'position of LF_KFE'),
        ('fan', 'time, with a period of 11 s'),
        ('cross_talk', 'power of LF_KFE (seen at LF_HAA)'),
    ],
)
def test_an_effect_beside_an_unmodelled_one_is_named_and_the_rest_is_described(missing, over):
    found = diagnose({missing: 1.0, 'load_friction': 1.0})
    assert found.verdict == 'named', found.steps
    assert found.effects == ('load_friction',)
    assert found.remainder.over[0] == over
    left = np.sqrt(found.remainder.gain.mean())
    assert left > 1.0  # W; each of the three hides more
    words = told(found)
    assert words.startswith('Friction that grows with load is missing from the model: it explains')
    assert f'{left:.2f} W of structure is left that no known effect explains' in words
    assert f'most of it over {over}: `discover` can describe it.' in words


def test_what_is_left_is_compared_with_the_noise_of_the_meter():
    found = diagnose({'idle': 1.0})
    noise = np.sqrt(np.mean(np.square(found.noise)))
    assert 0.05 < noise < found.best.rmse.max()  # W, below 12.5 Hz
    left = np.sqrt(found.best.mean_mse.mean())
    assert f"to {left:.2f} W, of which the meter's noise is {noise:.2f} W." in told(found)


def test_a_small_effect_beside_a_large_one_is_named_where_it_explains_all_but_the_noise():
    hidden = {'viscous_friction': 1.0, 'coulomb_friction': 0.7}
    found = diagnose(hidden, 'ladder', base=('copper_loss', 'idle'), seed=30, seconds=100.0)
    gain = found.steps[1].gain.sum() / found.steps[0].gain.sum()
    assert gain < 0.02**2  # of the large one's squared watts
    assert set(found.effects) == set(hidden), found.steps


@pytest.mark.parametrize(
    'faults',
    [
        Faults(delay=0.012),
        Faults(gain=0.02, current_offset=0.02),
        Faults(torque_bias=0.4, velocity_filter=20.0),
        Faults(offset_drift=0.006, torque_bend=0.015),
    ],
)
def test_a_fault_of_the_measurement_is_not_taken_for_physics(faults):
    found = diagnose({}, faults=faults)
    assert found.verdict == 'no_evidence', found.steps


def test_a_constant_torque_on_the_motor_is_given_no_name():
    found = diagnose({'offset_torque': 1.0})
    assert found.verdict == 'none_of_the_above'
    assert found.chosen == ('torque_bias',)
    column = found.best.fit.structure.columns_of('torque_bias')
    assert found.best.fit.coefficients[:, column] == pytest.approx(2.0, rel=0.1)  # N·m, as hidden
    assert 'constant torque' in told(found)


def test_friction_in_one_direction_is_not_told_from_a_constant_torque_beside_coulomb_friction():
    found = diagnose({'one_way_friction': 1.0}, base=('copper_loss', 'idle'))
    assert found.verdict == 'ambiguous'
    assert set(found.effects) == {'coulomb_friction', 'torque_bias'}
    assert ('torque_bias',) in found.possible
    column = found.best.fit.structure.columns_of('torque_bias')
    assert found.best.fit.coefficients[:, column] == pytest.approx(1.5, rel=0.1)  # half of 3 N·m
    assert 'Coulomb friction beside it or not' in told(found)


def test_iron_loss_is_not_called_friction_of_which_it_differs_by_hundredths_of_a_watt():
    base = ('copper_loss', 'viscous_friction', 'idle')
    found = diagnose({'iron_loss': 2.0}, base=base, seed=0, seconds=60.0)
    assert found.verdict == 'ambiguous'
    assert {('iron_loss',), ('coulomb_friction',)} == set(found.possible)
    assert 'one of' in told(found)


def test_the_same_recording_gives_the_same_diagnosis():
    first, second = (diagnose({'load_friction': 1.0}, seconds=40.0) for _ in range(2))
    assert first.best.mean_mse.tolist() == second.best.mean_mse.tolist()
    assert first.in_set == second.in_set


def test_the_floor_is_reached_by_all_drives_together_or_by_far_by_one():
    floor = np.array([0.1, 0.1])
    assert above_floor(np.array([0.012, 0.012]), floor)
    assert not above_floor(np.array([0.015, 0.0]), floor)
    assert above_floor(np.array([0.05, 0.0]), floor)


def test_a_further_effect_must_show_on_two_drives_or_by_far_on_one():
    floor = np.array([0.1, 0.1, 0.1])
    assert shared(np.array([0.0, 0.004, 0.06]), floor)
    assert not shared(np.array([0.0, 0.001, 0.06]), floor)
    assert shared(np.array([0.0, 0.0, 0.17]), floor)
    assert shared(np.array([0.06]), floor[:1])
