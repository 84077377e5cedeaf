"""Sentences of a verdict, on findings whose figures are made up."""

from types import SimpleNamespace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.posterior.judged import OneOfSeveral
from power_estimator.posterior.sensors import LOOPS, SENSORS
from power_lab.diagnose.findings import Diagnosis, Residual, certainty, rounded_down
from power_lab.diagnose.measurement import MeasurementTerm
from power_lab.diagnose.verdict import (
    MOST_WORDS,
    candidates_to_show,
    remainder,
    sentence,
    to_add,
    to_do,
    to_learn,
    undecided,
)

CATALOGUE = builtin_catalogue()


def left_of(left, missed, *, counts=True, power=20.0, noise=0.1):
    """Residual of one meter, W."""
    squares = (np.array([watts**2]) for watts in (left, missed, noise, power))
    return Residual(*squares, np.array([noise]), (), ('KNEE',), counts)


def diagnosis(left, chances, *, any_missing, named=(), falls=None, error=1.0, drives=1):
    """Findings of effects with their probabilities, and W by which each lowers the error."""
    candidates = [
        SimpleNamespace(
            name=name,
            active=Active.of(CATALOGUE[name]),
            probability=chance,
            delta_rmse_w=(falls or {}).get(name, 0.0),
            explains=(0.1, 0.2, 0.3),
        )
        for name, chance in chances.items()
    ]
    sure = tuple(one.active for one in candidates if one.name in named)
    names = ('KNEE', 'HIP')[:drives]
    return Diagnosis(
        found=SimpleNamespace(named=sure, any_missing=any_missing),
        prepared=SimpleNamespace(
            whole=drives > 1, steady=False, signals=SimpleNamespace(names=names)
        ),
        apart={},
        base=SimpleNamespace(mean_mse=np.array([error**2])),
        best=SimpleNamespace(mean_mse=np.array([error**2])),
        candidates=tuple(candidates),
        left=left,
    )


def said(found, before=1.0, after=1.0):
    told = sentence(found, before, after)
    assert len(told.split()) <= MOST_WORDS, told
    return told


def test_where_something_is_missing_for_sure_the_likeliest_are_ambiguous_and_said():
    chances = {'inverter_loss': 0.33, 'line_resistance': 0.13, 'regeneration_efficiency': 0.09}
    found = diagnosis(left_of(0.9, 0.9, counts=False), chances, any_missing=0.9799)
    assert (found.verdict, found.effects) == ('ambiguous', tuple(chances))
    assert said(found) == (
        'Something is missing (97%), but these recordings do not tell what: inverter loss, line '
        'resistance or regeneration loss; 0.90 W (4.5% of power) stays unexplained.'
    )


@pytest.mark.parametrize(
    ('any_missing', 'words'),
    [
        (0.74, 'Something may be missing (74%), but these recordings do not tell what: field '),
        (0.3, 'No evidence in these recordings that an effect is missing (probability 0.30): '),
    ],
)
def test_no_evidence_says_how_probable_a_missing_effect_is_and_what_stays(any_missing, words):
    chances = {'field_weakening': 0.34, 'iron_loss': 0.08}
    found = diagnosis(left_of(1.0, 1.0, counts=False), chances, any_missing=any_missing)
    assert found.verdict == 'no_evidence'
    assert said(found).startswith(words)
    assert '1.00 W (5% of power) stays' in said(found)
    assert to_learn(found)
    assert 'discover' in to_do(found, 1.0, 1.0)


def test_within_the_meters_noise_there_is_nothing_to_learn():
    found = diagnosis(left_of(0.4, 0.4, counts=False), {}, any_missing=0.1)
    assert not to_learn(found)
    assert remainder(found, 1.0) == ''
    assert to_do(found, 1.0, 1.0).startswith('To see more: record')


def test_a_name_that_leaves_more_than_half_says_so_in_its_sentence():
    found = diagnosis(
        left_of(7.1, 7.5, power=100.0),
        {'load_friction': 0.9506},
        any_missing=0.98,
        named=('load_friction',),
    )
    assert found.verdict == 'named'
    assert said(found, 7.57, 7.2) == (
        'Friction that grows with load is missing: with it the held-out error falls from 7.57 to '
        '7.20 W; 7.10 W (7.1% of power) stays.'
    )


def test_names_come_before_what_stays_where_that_is_less_than_half():
    both = ('load_friction', 'rotor_inertia')
    chances = dict.fromkeys(both, 0.99)
    found = diagnosis(left_of(0.3, 9.0), chances, any_missing=0.99, named=both)
    assert said(found, 9.0, 0.4) == (
        'Friction that grows with load and rotor inertia are missing: with them the error on '
        'held-out data falls from 9.00 to 0.40 W.'
    )
    assert 'Of 0.40 W of held-out error 0.30 W rms stays unexplained' in remainder(found, 0.4)
    assert remainder(found, 0.301) == 'All 0.30 W of held-out error stay unexplained.'


def test_effects_of_which_one_is_missing_are_told_beside_a_name():
    found = diagnosis(left_of(0.3, 9.0), {'spring': 0.98}, any_missing=0.99, named=('spring',))
    found.found.undecided = [OneOfSeveral(('viscous_friction', 'iron_loss'), 0.987)]
    assert undecided(found) == [
        'Viscous friction or iron loss is missing, too (probability 0.98); '
        'these recordings do not tell which.'
    ]
    alone = diagnosis(left_of(0.3, 9.0), {'spring': 0.6}, any_missing=0.99)
    alone.found.undecided = found.found.undecided
    assert undecided(alone) == []  # its sentence names what may be missing


@pytest.mark.parametrize('after', [0.79, 0.85])
def test_a_name_that_held_out_data_does_not_bear_out_says_what_stays(after):
    name = 'load_friction'
    found = diagnosis(left_of(0.78, 0.78), {name: 0.9698}, any_missing=0.99, named=(name,))
    told = said(found, 0.79, after)
    assert 'Friction that grows with load is missing (0.96), but with it the held-out' in told
    assert told.endswith(f'{after:.2f} W; 0.78 W (3.9% of power) stays.')
    assert to_add(found, 0.79, after) == ()


def test_an_effect_that_is_told_from_nothing_has_no_probability_beside_it():
    found = diagnosis(
        left_of(0.76, 0.76),
        {'winding_heating': 0.2485, 'load_friction': 0.005},
        any_missing=0.5,
        falls={'load_friction': 0.36},
        error=0.81,
    )
    assert said(found, 0.81, 0.81) == (
        'No known effect explains 0.76 W (3.8% of power); one may be missing (50%): '
        'friction that grows with load or heating of the winding.'
    )
    told = to_do(found, 0.81, 0.81)
    assert 'whether it is friction that grows with load: alone it takes 0.36 of 0.81 W' in told
    assert 'not told apart from what no formula explains' in told
    assert '0.00' not in told


def test_none_of_the_above_says_how_improbable_a_known_effect_is():
    found = diagnosis(left_of(0.34, 0.34), {'iron_loss': 0.3}, any_missing=0.3, drives=2)
    assert said(found) == (
        'No known effect explains what the model misses: 0.34 W (1.7% of power); that '
        'a known one is missing besides has probability 0.30.'
    )
    assert 'meter each drive' in to_do(found, 1.0, 1.0)


def test_one_candidate_is_told_from_nothing_but_its_absence():
    found = diagnosis(
        left_of(0.46, 0.5),
        {'load_friction': 0.9499},
        any_missing=0.96,
        falls={'load_friction': 0.07},
    )
    assert (found.verdict, found.effects) == ('ambiguous', ('load_friction',))
    assert said(found) == (
        'Friction that grows with load is missing (0.94): it takes 0.07 of 1.00 W of error away; '
        'without it 0.46 W (2.3% of power) stays.'
    )
    assert 'which tells whether it is missing' in to_do(found, 1.0, 1.0)


@pytest.mark.parametrize(
    ('falls', 'step'),
    [
        ((0.50, 0.49), 'power_lab add viscous_friction'),
        ((0.50, 0.30), 'which tells them apart'),
    ],
)
def test_of_effects_that_lower_the_error_alike_the_likeliest_is_added(falls, step):
    names = ('viscous_friction', 'iron_loss')
    found = diagnosis(
        left_of(1.0, 1.0),
        dict(zip(names, (0.6, 0.4), strict=True)),
        any_missing=0.99,
        falls=dict(zip(names, falls, strict=True)),
    )
    assert found.effects == names
    assert step in to_do(found, 1.0, 1.0)
    assert to_add(found, 1.0, 1.0) == (names[:1] if falls[1] > 0.4 else ())


def test_what_stays_is_never_more_than_the_error_that_it_is_a_part_of():
    own = left_of(1.39, 1.39, noise=0.3).within({'KNEE': 1.3}, {'KNEE': 0.5})
    assert own.rms_w == pytest.approx(0.4)  # 0.5² = 0.4² + 0.3²
    assert own.json()['share'] == pytest.approx(0.16 / 1.6, rel=1e-4)
    assert left_of(0.2, 0.3).within({}, {}).rms_w == pytest.approx(0.2)


@pytest.mark.parametrize(
    'name', [name for name in SENSORS if name not in (*LOOPS[1:], 'unmetered_load')]
)
def test_each_error_of_the_measurement_is_said_with_what_would_check_it(name):
    term = MeasurementTerm(name, -0.2, (-0.3, -0.1), 1.0, True, False, 'KNEE', False, {})
    checks = ('weigh', 'read ', 'load it', 'compare', 'calibrate', 'turn ')
    assert 'KNEE' in term.sentence
    assert any(check in term.sentence for check in checks)


def test_the_filter_of_a_meter_is_said_by_its_time_constant():
    term = MeasurementTerm('meter_filter', 3.2e-5, (1e-5, 5e-5), 1.0, True, False, 'J2', False, {})
    assert term.sentence.startswith('Allowed for in J2: meter filter of 0.008 s;')  # ½·0.008²


def test_the_table_has_each_effect_that_the_sentence_names_and_says_how_many_are_left_out():
    names = [one.name for one in CATALOGUE.physics()][:12]
    found = diagnosis(
        left_of(0.8, 0.8),
        {name: 0.06 if name == names[-1] else 0.0 for name in names},
        any_missing=0.6,
    )
    shown = candidates_to_show(found)
    assert [one.name for one in shown] == [*names[:8], names[-1]]


def test_no_probability_is_rounded_up_to_a_limit():
    assert certainty(0.94999) == '0.94'
    assert certainty(0.29) == '0.29'
    assert certainty(0.95) == '0.95'
    assert certainty(0.004) == '< 0.01'
    assert rounded_down(0.949996, 4) == 0.9499


def test_all_names_are_said_where_most_of_the_error_stays():
    chances = {'load_friction': 0.96, 'spring': 0.99}
    found = diagnosis(left_of(0.8, 0.9), chances, any_missing=0.99, named=tuple(chances))
    assert said(found, 1.0, 0.9) == (
        'Friction that grows with load and the series spring are missing: held-out error 1.00 to '
        '0.90 W; 0.80 W (4% of power) stays.'
    )
