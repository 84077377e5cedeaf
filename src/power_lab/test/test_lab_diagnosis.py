"""A seeded part of the blind benchmark: truths are circuits, never the lab's formulas."""

from types import SimpleNamespace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.training import material
from power_estimator.posterior.judged import JudgedEffect, JudgedEffects, judged_effects
from power_lab.diagnose.diagnosis import _borne_out, _outdone, _possible, diagnosed
from power_lab.diagnose.findings import certainty
from power_lab.diagnose.measurement import measurement_terms
from power_lab.diagnose.verdict import MOST_WORDS, remainder, sentence, to_do
from power_lab.structure.floors import above_floor
from truth_circuit import Faults, Truth, record
from truths import Case
from truths import record as record_plant

CATALOGUE = builtin_catalogue()
KNEE, LEG = ['LF_KFE'], ['LF_HAA', 'LF_HFE', 'LF_KFE']
MID = ('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle')


def diagnose(hidden, motion='walk', *, base=MID, seed=1, seconds=70.0, faults=None, drives=KNEE):
    effects = dict.fromkeys(base, 1.0) | hidden
    data = record(Truth(effects, motion, seconds, seed, seed + 50, faults or Faults()))
    data = data.drives(drives)
    known = [Active.of(CATALOGUE[name]) for name in ('shaft', *base) if name not in hidden]
    return diagnosed(material(data, per='drive'), known, CATALOGUE)


def errors(found):
    return [float(np.sqrt(e.mean_mse.mean())) for e in (found.base, found.best)]


def words(found):
    said = sentence(found, *errors(found))
    assert len(said.split()) <= MOST_WORDS
    return said


def measured(found):
    return measurement_terms(found.found, found.prepared, errors(found)[0], found.apart)


@pytest.mark.parametrize('motion', ['walk', 'ladder'])
def test_nothing_is_named_where_nothing_is_missing(motion):
    found = diagnose({}, motion)
    assert (found.verdict, found.effects, found.residual) == ('no_evidence', (), None)
    assert 'No evidence' in words(found)
    assert remainder(found, 1.0) == ''
    assert f'(probability {certainty(found.found.any_missing)})' in words(found)


@pytest.mark.parametrize(
    ('hidden', 'motion', 'strength', 'drives'),
    [
        ('load_friction', 'walk', 2.0, KNEE),
        ('rotor_inertia', 'walk', 1.0, KNEE),
        ('spring', 'ladder', 1.0, KNEE),
        ('regeneration_limit', 'ladder', 1.0, LEG),  # of the bus that they share
        ('idle', 'walk', 1.0, KNEE),
        ('coulomb_friction', 'walk', 3.0, KNEE),
    ],
)
def test_the_hidden_effect_is_named_with_its_probability_and_watts(
    hidden, motion, strength, drives
):
    found = diagnose({hidden: strength}, motion, drives=drives)
    assert (found.verdict, found.effects) == ('named', (hidden,))
    before, after = errors(found)
    assert after < 0.7 * before
    told = words(found)
    assert 'missing: with it the ' in told
    assert f' falls from {before:.2f} to {after:.2f} W' in told
    best = found.candidates[0]
    assert best.name == hidden
    assert best.probability >= 0.95
    assert best.explains[0] < best.explains[1] < best.explains[2]
    assert 0.0 < best.share <= 1.0
    assert best.interval[0] < best.coefficient < best.interval[1]
    assert f'power_lab add {hidden}' in to_do(found, before, after)


@pytest.mark.parametrize('hidden', ['regeneration_limit', 'regeneration_efficiency'])
def test_blocked_and_lossy_regeneration_of_one_drive_are_told_apart(hidden):
    plant = record_plant(Case('rigid', 'ladder', 60.0, 1, seed=3, hidden=(hidden,)))
    known = [Active.of(CATALOGUE[name]) for name in plant.known]
    found = diagnosed(material(plant.data, per='drive'), known, CATALOGUE)
    assert (found.verdict, found.effects) == ('named', (hidden,))


def test_a_known_effect_of_another_shape_is_not_taken_for_a_missing_one():
    plant = record_plant(Case('rigid', 'arm', 60.0, 1, seed=3100004))
    known = [Active.of(CATALOGUE[name]) for name in plant.known]
    (lossy,) = (one for one in known if one.name == 'regeneration_efficiency')
    assert lossy.parameters['bridge'] == 0.0  # while the plant's electronics do not regenerate
    given = material(plant.data, per='drive')
    found = judged_effects(given.prepared, given.structure(known).actives, CATALOGUE)
    assert max(found.probability.values()) < 0.5
    assert {one.name: one.parameters for one in found.known}[lossy.name]['bridge'] == 1.0
    low, high = np.quantile(found.meters[0].coefficients[lossy.name], [0.025, 0.975])
    assert low < 0.2 < high


def test_hysteresis_of_the_torque_sensor_is_not_taken_for_heating():
    plant = record_plant(Case('sensors', 'stall', 60.0, 1, seed=4100003))
    assert plant.plant.drives[0].torque_hysteresis > 0.4  # N·m
    known = [Active.of(CATALOGUE[name]) for name in plant.known]
    found = diagnosed(material(plant.data, per='drive'), known, CATALOGUE)
    assert found.found.probability['winding_heating'] < 0.5
    assert found.effects == ()


def borne_out(errors):
    """Names that are left of three certain ones; errors: held-out, W, by the names in a model."""
    names = ('spring', 'idle', 'iron_loss')
    actives = tuple(Active.of(CATALOGUE[name]) for name in names)
    judged = tuple(JudgedEffect(active, 0.99, np.ones(3), 0.3) for active in actives)

    def added(some, _iterations):
        own = frozenset(active.name for active in some)
        return SimpleNamespace(mean_mse=np.square(np.atleast_1d(errors[own])))

    prepared = SimpleNamespace(noise=np.zeros(1), steady=True)
    base = added((), 0)
    fits = SimpleNamespace(added=added, base=base, fitter=SimpleNamespace(prepared=prepared))
    found, best = _borne_out(JudgedEffects(judged, 0.99, {}, (), actives, (), 1.0), fits)
    named = tuple(active.name for active in found.named)
    return named, float(np.sqrt(best.mean_mse.sum()))


def of_sets(**errors):
    return {frozenset(name.split('_and_')) - {'none'}: watts for name, watts in errors.items()}


def test_names_that_lower_no_held_out_error_go_one_by_one_and_of_two_alike_one_stays():
    alike = of_sets(
        none=9.0, spring=1.0, idle=1.0, iron_loss=9.0, spring_and_idle=1.0,
        spring_and_iron_loss=1.0, idle_and_iron_loss=1.0, spring_and_idle_and_iron_loss=1.0,
    )  # fmt: skip
    named, error = borne_out(alike)
    assert len(named) == 1
    assert named[0] in ('spring', 'idle')
    assert error == 1.0
    least = {names: 9.0 - 0.08 * len(names) for names in alike}  # W, each less than 1 % of 9 W
    assert borne_out(least) == ((), 9.0)
    enough = {names: 9.0 - 1.0 * len(names) for names in alike}
    assert borne_out(enough) == (('spring', 'idle', 'iron_loss'), 6.0)


@pytest.mark.parametrize(('share', 'named'), [(0.3, 1), (1.1, 1), (1.5, 0)])
def test_a_gear_that_would_take_half_as_much_again_as_its_load_is_not_named(share, named):
    active = Active.of(CATALOGUE['load_friction'])
    judged = (JudgedEffect(active, 0.99, np.ones(3), 0.3),)
    meters = (SimpleNamespace(coefficients={'load_friction': np.full((9, 1), share)}),)
    found = JudgedEffects(judged, 0.99, {}, (), (active,), meters, 1.0)
    assert len(_possible(found).named) == named


def test_an_improbable_effect_that_lowers_the_held_out_error_more_casts_doubt_on_the_only_name():
    def candidate(name, probability, watts):
        return SimpleNamespace(name=name, probability=probability, delta_rmse_w=watts)

    iron = candidate('iron_loss', 0.99, 0.7)
    assert _outdone([iron, candidate('viscous_friction', 0.01, 2.0)], 4.3) == 'iron_loss'
    assert _outdone([iron, candidate('viscous_friction', 0.4, 2.0)], 4.3) is None  # it is open
    assert _outdone([iron, candidate('viscous_friction', 0.01, 0.71)], 4.3) is None  # alike
    both = [iron, candidate('spring', 0.99, 0.1), candidate('viscous_friction', 0.01, 2.0)]
    assert _outdone(both, 4.3) is None


def test_two_hidden_effects_are_both_named():
    found = diagnose({'load_friction': 1.0, 'rotor_inertia': 1.0}, 'ladder')
    assert found.verdict == 'named'
    assert set(found.effects) == {'load_friction', 'rotor_inertia'}
    assert 'are missing: with them' in words(found)
    for one in found.candidates:
        assert one.interval[0] <= one.coefficient <= one.interval[1], one.name


@pytest.mark.parametrize('missing', ['position_rub', 'fan', 'cross_talk'])
def test_an_unmodelled_effect_is_none_of_the_above_and_its_size_is_said(missing):
    drives = LEG[::2] if missing == 'cross_talk' else KNEE  # of a neighbour that is metered
    found = diagnose({missing: 1.0}, drives=drives)
    assert found.verdict == 'none_of_the_above'
    assert found.effects == ()
    assert found.residual.rms_w == pytest.approx(errors(found)[0], rel=0.05)
    assert found.residual.rms_w > 1.0  # W; each of the three hides more
    assert 'No known effect explains' in words(found)
    assert 'discover' in to_do(found, 1.0, 1.0)


def test_a_name_stands_beside_what_no_effect_explains():
    found = diagnose({'fan': 1.0, 'load_friction': 2.0})
    assert found.verdict == 'named'
    assert found.effects == ('load_friction',)
    told = remainder(found, 9.99)
    assert f'Of 9.99 W of held-out error {found.residual.rms_w:.2f} W rms stays' in told
    assert found.residual.noise_w == pytest.approx(0.1, abs=0.03)
    assert f"the meter's noise ({found.residual.noise_w:.2f} W) and what passes" in told


def test_a_small_effect_and_a_large_one_are_both_in_the_set_that_may_be_missing():
    hidden = {'viscous_friction': 1.0, 'coulomb_friction': 0.7}
    found = diagnose(hidden, 'ladder', base=('copper_loss', 'idle'), seed=30)
    assert found.verdict in ('named', 'ambiguous')
    assert set(hidden) <= set(found.effects)


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
    assert found.effects == ()
    assert found.verdict == 'no_evidence'


def test_a_constant_torque_on_the_motor_is_an_error_of_the_torque_and_no_name():
    found = diagnose({'offset_torque': 1.0})
    assert found.effects == ()
    bias = measured(found)['torque_bias']
    assert bias.value == pytest.approx(2.0, abs=1.0)  # N·m, as hidden
    assert bias.far_out
    assert 'friction in one direction' in bias.sentence


def test_friction_in_one_direction_is_coulomb_friction_first():
    found = diagnose({'one_way_friction': 1.0}, base=('copper_loss', 'idle'))
    assert found.effects[0] == 'coulomb_friction'


def test_the_same_recording_gives_the_same_diagnosis():
    first, second = (diagnose({'load_friction': 1.0}, seconds=40.0) for _ in range(2))
    assert first.best.mean_mse.tolist() == second.best.mean_mse.tolist()
    assert first.found.probability == second.found.probability


def test_the_floor_is_reached_by_all_drives_together_or_by_far_by_one():
    floor = np.array([0.1, 0.1])
    assert above_floor(np.array([0.012, 0.012]), floor)
    assert not above_floor(np.array([0.015, 0.0]), floor)
    assert above_floor(np.array([0.05, 0.0]), floor)
