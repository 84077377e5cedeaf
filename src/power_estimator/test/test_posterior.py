"""Figures of the posterior that can be checked by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.posterior.effect_columns import EffectColumns, explained
from power_estimator.posterior.fitted_set import Cell
from power_estimator.posterior.gaussian import (
    NormalEquations,
    Standing,
    by_delay,
    draws,
    marginalised,
    solved,
)
from power_estimator.posterior.judged import JudgedEffect, JudgedEffects, OneOfSeveral
from power_estimator.posterior.meter import representatives
from power_estimator.posterior.odds import (
    has_wholes,
    loses_twice,
    over_by_share,
    prior_of,
    tempered,
)
from power_estimator.posterior.priors import DOUBTED, MIMICS, NAMED, TOLD_APART, USUAL
from power_estimator.posterior.stand_ins import InSet, LogOdds, StandIn
from power_estimator.posterior.summary import by_cause
from scipy.special import expit, log_ndtr, logit

COLUMN = np.array([1.0, 2.0, 2.0])
EFFECTS = builtin_catalogue()
TARGET = np.array([1.0, 1.0, 3.0])


def of_columns(columns, targets, smooth=None, spread=(1.0, 1.0)):
    """Normal equations of unit noise: columns [N, n], targets [N, S], features [N, 3].

    The last two features are columns of the spreads spread[1] and 1.
    """
    smooth = np.empty((len(columns), 0)) if smooth is None else smooth
    groups = (1, 1) if smooth.size else (0, 0)
    parts = weighed(columns, targets, smooth)
    return marginalised(parts, groups, (np.array(spread[:1]), np.array(spread[1:2]))).at(0)


def weighed(columns, targets, smooth):
    """Products of columns [N, n], and of all features [N, 3] but the first, beside that."""
    beside = np.concatenate([columns, smooth[:, 1:]], axis=1)
    return Standing.of(smooth[:, :1], targets).beside(beside, np.zeros(len(targets)))


def log_density(target, covariance):
    """Log of a Gaussian's density at a target [N], less its factor of 2π."""
    return (
        -0.5 * target @ np.linalg.solve(covariance, target)
        - 0.5 * np.linalg.slogdet(covariance)[1]
    )


def test_the_evidence_of_one_column_is_its_closed_form():
    normal = of_columns(COLUMN[:, None], TARGET[:, None])
    found = solved(normal, 0, np.array([2.0]), np.array([False]))
    # y ~ N(0, I + 4 x xᵀ), x·x = 9, x·y = 9, y·y = 11: −½(11 − 81·4/37) − ½ ln 37.
    assert found.evidence == pytest.approx(-0.5 * (11 - 324 / 37) - 0.5 * np.log(37.0))
    assert found.mean[0] == pytest.approx(9 / 9.25)
    assert found.covariance[0, 0] == pytest.approx(1 / 9.25)
    assert by_delay(normal, np.array([2.0]))[0] == pytest.approx(found.evidence)


def test_each_delay_has_its_own_evidence():
    targets = np.stack([TARGET, COLUMN], axis=1)
    found = by_delay(of_columns(COLUMN[:, None], targets), np.array([2.0]))
    covariance = np.eye(3) + 4 * np.outer(COLUMN, COLUMN)
    expected = [log_density(target, covariance) for target in targets.T]
    assert found == pytest.approx(expected)


def test_a_smooth_part_that_is_marginalised_is_one_that_is_solved_jointly():
    random = np.random.default_rng(1)
    columns, smooth = random.normal(size=(30, 2)), random.normal(size=(30, 3))
    target, spread = random.normal(size=(30, 1)), np.array([0.5, 2.0, 1.0])
    sizes, free = np.array([3.0, 3.0]), np.zeros(2, dtype=bool)
    apart = of_columns(columns, target, smooth, spread)
    found = solved(apart, 0, sizes, free)
    both = np.concatenate([columns, smooth], axis=1)
    joint = of_columns(both, target)
    together = solved(joint, 0, np.concatenate([sizes, spread]), np.zeros(5, dtype=bool))
    assert found.mean == pytest.approx(together.mean[:2])
    assert found.covariance == pytest.approx(together.covariance[:2, :2])
    assert found.evidence == pytest.approx(together.evidence)
    *others, turned = weighed(columns, target, smooth).smooth(apart, found.mean, 0)
    feature = turned * Standing.of(smooth[:, :1], target).turn[0, 0]
    assert [feature, *others] == pytest.approx(together.mean[2:])


def test_what_is_known_of_the_power_is_taken_out_of_it():
    random = np.random.default_rng(4)
    columns, features = random.normal(size=(20, 2)), random.normal(size=(20, 3))
    constant = 1e6 * random.normal(size=20)  # close to the power: squares would cancel
    power = constant[:, None] + random.normal(size=(20, 4))
    found = Standing.of(features, power).beside(columns, constant)
    alone = Standing.of(features, power - constant[:, None]).beside(columns, np.zeros(20))
    assert found.moments == pytest.approx(alone.moments)
    assert found.turned == pytest.approx(alone.turned, abs=1e-7)
    assert found.squares == pytest.approx(alone.squares)


def test_columns_that_are_taken_are_those_of_a_smaller_problem():
    random = np.random.default_rng(2)
    columns, smooth = random.normal(size=(20, 3)), random.normal(size=(20, 3))
    target = random.normal(size=(20, 1))
    taken = of_columns(columns, target, smooth).taken(np.array([0, 2]), 0)
    own = of_columns(columns[:, [0, 2]], target, smooth)
    sizes = np.ones(2)
    assert by_delay(taken, sizes) == pytest.approx(by_delay(own, sizes))


def test_a_signed_coefficient_that_would_be_negative_is_held_at_zero():
    columns = np.array([[1.0, 0.0], [0.0, 1.0]])
    normal = of_columns(columns, np.array([[3.0], [-3.0]]))
    found = solved(normal, 0, np.array([10.0, 10.0]), np.array([True, True]))
    assert found.mean == pytest.approx([3.0 / 1.01, 0.0], abs=1e-6)
    free = solved(normal, 0, np.array([10.0, 10.0]), np.array([True, False]))
    assert free.mean[1] == pytest.approx(-3.0 / 1.01)


def test_half_of_a_coefficients_evidence_lies_on_either_side_of_zero():
    normal = of_columns(COLUMN[:, None], np.zeros((3, 1)))
    free, signed = (
        solved(normal, 0, np.ones(1), np.array([own])).evidence for own in (False, True)
    )
    assert signed == pytest.approx(free)  # twice the prior's density on half of the posterior


def test_a_prior_mean_is_taken_out_of_the_power_before_it_is_explained():
    normal = of_columns(COLUMN[:, None], TARGET[:, None])
    mean, spread = np.array([2.0]), np.array([0.2])  # so far from 0 that the sign is known
    moved = normal.centred(np.array([0]), mean, spread)
    found = solved(moved, 0, spread, np.array([True]))
    covariance = np.eye(3) + 0.04 * np.outer(COLUMN, COLUMN)
    assert found.evidence == pytest.approx(log_density(TARGET - 2.0 * COLUMN, covariance))
    assert found.mean[0] == pytest.approx((9.0 + 2.0 / 0.04) / (9.0 + 1 / 0.04))
    # A mean of half a spread: of the prior ndtr(0.5) is positive, of the posterior all the same.
    near = normal.centred(np.array([0]), np.array([0.5]), np.ones(1))
    covariance = np.eye(3) + np.outer(COLUMN, COLUMN)
    after = solved(near, 0, np.ones(1), np.array([True]))
    shown = after.mean[0] / np.sqrt(after.covariance[0, 0])
    free = log_density(TARGET - 0.5 * COLUMN, covariance)
    assert after.evidence == pytest.approx(free + log_ndtr(shown) - log_ndtr(0.5))


def cell_of(columns, target, sizes, signed):
    """A cell of columns [N, n + z] and a target [N], of which the first n are effects."""
    normal = of_columns(columns, target[:, None])
    return Cell(normal, sizes, solved(normal, 0, sizes, signed), 0)


def test_the_evidence_of_a_point_falls_with_its_distance_from_the_solution():
    cell = cell_of(COLUMN[:, None], TARGET, np.array([2.0]), np.array([False]))
    assert cell.at(cell.solution.mean) == pytest.approx(cell.solution.evidence)
    # The precision is x·x + 1/4 = 9.25, the solution 9/9.25: ½·9.25·(1 − 9/9.25)² is lost at 1.
    lost = 0.5 * 9.25 * (1 - 9 / 9.25) ** 2
    assert cell.at(np.array([1.0])) == pytest.approx(cell.solution.evidence - lost)


def test_nuisances_go_along_with_a_point():
    random = np.random.default_rng(3)
    columns, target = random.normal(size=(12, 3)), random.normal(size=12)
    cell = cell_of(columns, target, np.ones(3), np.zeros(1, dtype=bool))
    beside = np.eye(12) + columns[:, 1:] @ columns[:, 1:].T  # covariance, nuisances in it

    def log(value):
        return log_density(target - columns[:, 0] * value, beside) - 0.5 * value**2

    assert cell.at(np.array([0.7])) - cell.at(np.array([-0.2])) == pytest.approx(
        log(0.7) - log(-0.2)
    )


def test_a_problem_about_a_point_has_its_solution_there_and_keeps_its_spread():
    random = np.random.default_rng(5)
    columns, target = random.normal(size=(12, 3)), random.normal(size=12)
    signed = np.array([True, False])
    cell = cell_of(columns, target, np.ones(3), signed)
    for values in (np.array([0.8, -0.4]), np.array([0.0, 0.3])):
        moved = cell.about(values, signed)
        assert moved.solution.mean[:2] == pytest.approx(values, abs=1e-4)
    moved = cell.about(np.array([0.8, -0.4]), signed)
    assert moved.solution.covariance == pytest.approx(
        cell_of(columns, target + 9 * columns[:, 0], np.ones(3), signed).solution.covariance
    )


@pytest.mark.parametrize('target', [-3.0, 0.0, 3.0])
def test_signed_coefficients_are_never_negative_in_draws(target):
    normal = of_columns(np.eye(2), np.array([[target], [target]]))
    sizes, signed = np.array([10.0, 10.0]), np.array([True, False])
    random = np.random.default_rng(0)
    drawn = draws(normal, 0, sizes, np.array([target, target]), signed, random)
    assert drawn.shape[1] == 2
    assert (drawn[:, 0] >= 0.0).all()
    assert drawn[:, 1].mean() == pytest.approx(target / 1.01, abs=0.3)
    assert drawn[:, 1].std() == pytest.approx(1.0, rel=0.2)


def test_draws_of_a_half_normal_have_its_mean():
    normal = of_columns(np.eye(1), np.zeros((1, 1)))
    drawn = draws(
        normal, 0, np.array([1e3]), np.zeros(1), np.array([True]), np.random.default_rng(3)
    )
    assert drawn.mean() == pytest.approx(np.sqrt(2 / np.pi), abs=0.15)  # of unit spread


def test_draws_between_near_ends_far_out_are_no_further_out_than_likely():
    # a + b = 1.00 ± 0.01 and a − b = 161 ± 20, neither below 0: a − b is between −1 and 1, where
    # its density is as exp(161 x / 20²); that has the mean coth(0.4025) − 1 / 0.4025.
    columns = np.array([[100.0, 100.0], [0.05, -0.05]])
    normal = of_columns(columns, np.array([[100.0], [161.0 / 20.0]]))
    sizes, signed = np.full(2, 1e5), np.array([True, True])
    drawn = draws(normal, 0, sizes, np.full(2, 0.5), signed, np.random.default_rng(5))
    apart = drawn[:, 0] - drawn[:, 1]
    assert apart.mean() == pytest.approx(1.0 / np.tanh(0.4025) - 1.0 / 0.4025, abs=0.12)
    assert apart.std() == pytest.approx(np.sqrt(1 / 3), rel=0.1)


def test_nuisances_are_drawn_with_the_effects_that_they_stand_beside():
    columns = np.array([[1.0, 1.0], [0.0, 0.1]])
    normal = of_columns(columns, np.array([[2.0], [0.0]]))
    drawn = draws(
        normal, 0, np.array([10.0, 10.0]), np.ones(2), np.array([False]), np.random.default_rng(4)
    )
    precision = normal.gram + 0.01 * np.eye(2)
    expected = np.linalg.inv(precision)
    correlation = expected[0, 1] / np.sqrt(expected[0, 0] * expected[1, 1])
    assert correlation < -0.9  # their sum alone is known
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(correlation, abs=0.05)


def test_normals_without_smooth_features_are_the_plain_problem():
    normal = of_columns(COLUMN[:, None], TARGET[:, None])
    assert isinstance(normal, NormalEquations)
    assert normal.gram == pytest.approx(np.array([[9.0]]))
    assert normal.constants == pytest.approx([-5.5])  # −½·y·y


def test_evidence_counts_half_where_an_effect_is_as_large_as_the_discrepancy():
    most = np.log(0.95 / 0.05) - np.log(1 / 3) + 2 * np.log(MIMICS / TOLD_APART)
    assert tempered(-1.0, 9.0, MIMICS) == pytest.approx(-1.0 - np.logaddexp(-5.0, -most))
    assert tempered(-1.0, 9.0, 100.0) == pytest.approx(9.0, abs=0.05)
    assert expit(tempered(logit(USUAL), 1e4, TOLD_APART)) == pytest.approx(0.95)
    assert tempered(3.0, 9.0, 1e-3) == pytest.approx(3.0, abs=1e-3)  # what was known stays
    assert tempered(-1.0, -9.0, 0.0) == -9.0  # evidence against counts whole


def test_blocked_and_lossy_regeneration_are_told_apart_by_the_share_that_is_lost():
    blocked, lossy = 'regeneration_limit', 'regeneration_efficiency'
    # N(1; 1, 0.1) over twice N(1; 0, 0.3): ln(0.3 / 0.1) − ln 2 + ½ / 0.09.
    expected = np.log(1.5) + 0.5 / 0.09
    assert over_by_share(blocked, lossy, 1.0, 0.0) == pytest.approx(expected)
    assert over_by_share(lossy, blocked, 1.0, 0.0) == pytest.approx(-expected)
    assert over_by_share(lossy, blocked, 0.5, 0.05) > 5.0
    assert abs(over_by_share(lossy, blocked, 0.75, 0.2)) < 2.0  # not known well enough
    assert over_by_share(lossy, blocked, 0.5, 1e4) == pytest.approx(0.0, abs=1e-3)  # nothing seen


def test_a_robots_sets_are_searched_on_the_strongest_drives_of_each_type():
    types, legs = ('HAA', 'HFE', 'KFE'), ('LF', 'RF', 'LH', 'RH')
    meters = [
        SimpleNamespace(signals=SimpleNamespace(names=(f'{leg}_{type_}',)), rms=watts)
        for watts, leg in enumerate(legs)
        for type_ in types
    ]
    assert representatives(meters) == (6, 9, 10, 11)  # the right hind leg, and the next strongest
    assert representatives(meters[:6]) == (0, 1, 2, 3, 4, 5)


def test_the_discrepancy_by_cause_adds_up_the_features_of_each():
    parts = np.array([[1.0, 2.0, 0.5], [-1.0, -2.0, 0.5]])
    found = by_cause(parts, ('time', 'torque', 'torque'))
    assert found == {'torque': pytest.approx(np.sqrt((2.5**2 + 1.5**2) / 2)), 'time': 1.0}
    assert next(iter(found)) == 'torque'  # largest first


def test_a_gain_takes_over_the_shafts_power_and_no_effect_at_standstill():
    copper, heating = (Active.of(EFFECTS[name]) for name in ('copper_loss', 'winding_heating'))
    effects = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0]])
    shaft = np.array([0.0, 2.0, 0.0, -2.0])

    def watts(fixed):
        columns = EffectColumns(
            (copper, heating), effects, np.ones(3), np.empty((4, 0)), np.empty((4, 0)),
            np.empty(0, np.intp), fixed, np.empty(0), (),
        )  # fmt: skip
        used = np.ones(4, dtype=bool)
        return explained(columns, used, heating, np.array([[3.0, 0.0]]), ('copper_loss',))[0]

    assert watts(np.zeros(4)) == pytest.approx(3.0)  # a gain would change copper and heating alike
    assert watts(shaft) == pytest.approx(3.0)  # as the shaft's power is another
    assert watts(effects[:, 1]) == pytest.approx(0.0)


def test_an_effect_in_doubt_is_named_no_more_and_comes_behind_others_that_are():
    spring, idle = (Active.of(EFFECTS[name]) for name in ('spring', 'idle'))
    candidates = [
        JudgedEffect(spring, 0.99, np.ones(3), 0.5),
        JudgedEffect(idle, NAMED, np.ones(3), 0.5),
    ]
    found = JudgedEffects(tuple(candidates), 0.99, {}, (), (spring, idle), (), 1.0)
    assert found.named == (spring, idle)
    doubted = found.doubting('spring')
    assert doubted.named == (idle,)
    assert list(doubted.probability.items()) == [('idle', NAMED), ('spring', DOUBTED)]
    assert doubted.any_missing == 0.99  # as one is named
    assert doubted.doubting('idle').any_missing == DOUBTED
    beside = OneOfSeveral(('viscous_friction', 'iron_loss'), 0.98)
    both = replace(doubted, undecided=(beside,)).doubting('idle')
    assert both.any_missing == 0.98  # as one of these is


def test_effects_that_stand_for_each_other_share_the_probability_of_both():
    shows = LogOdds(before=-1.0, after=200.0, ratio=10.0)
    alike = StandIn(1, (1,), LogOdds(before=0.0, after=-50.0, ratio=0.01), shows)
    found = InSet(0, shows, (alike,))
    assert expit(found.log_odds) == pytest.approx(0.5, abs=0.02)
    assert found.probability(alike) == pytest.approx(0.5, abs=0.02)
    apart = StandIn(1, (1,), LogOdds(before=0.0, after=50.0, ratio=5.0), shows)
    assert expit(InSet(0, shows, (apart,)).log_odds) > 0.99


def test_an_effect_in_the_place_of_another_counts_no_more_than_its_own_evidence():
    shows = LogOdds(before=-1.0, after=200.0, ratio=10.0)  # nobody doubts that something is there
    nothing = LogOdds(before=-1.0, after=-3.0, ratio=0.1)  # and the other explains none of it
    alike = StandIn(1, (1,), LogOdds(before=0.0, after=203.0, ratio=0.01), nothing)
    assert expit(InSet(0, shows, (alike,)).log_odds) > 0.99


def test_a_winding_that_was_seen_to_warm_has_a_loss_that_warms():
    assert prior_of('winding_heating', expected=True) == 0.9 > 3 * prior_of('winding_heating')


@pytest.mark.parametrize(
    ('warmed', 'tried'), [(25.0, 8), (26.0, 1)]
)  # K; 0.0039 of 26 K is a tenth of the resistance
def test_a_winding_that_was_seen_to_warm_is_tried_with_its_temperature_alone(warmed, tried):
    temperature = np.array([40.0, 40.0 + warmed])[:, None]
    signals = SimpleNamespace(
        temperature=temperature, steady=False, at_motor=np.array([True]), scale=None
    )
    shapes = EFFECTS['winding_heating'].tried_on(signals)
    assert len(shapes) == tried
    assert shapes[0] == {'time_constant': 0.0}


def test_heating_is_there_with_copper_loss_only_also_where_each_drive_has_its_own():
    heating, copper = (Active.of(EFFECTS[name]) for name in ('winding_heating', 'copper_loss'))
    own = replace(copper, effect=replace(copper.effect, name='copper_loss@LF_KFE'))
    assert not has_wholes([heating], {heating.name})
    assert has_wholes([heating], {heating.name, copper.name})
    assert has_wholes([heating, own], {heating.name, own.name})


def test_blocked_power_is_not_lost_again_but_by_converters_of_several_drives():
    blocked, lossy = EFFECTS['regeneration_limit'], EFFECTS['regeneration_efficiency']
    own, _, supply = lossy.shapes
    both = [Active.of(blocked), Active.of(lossy, own)]
    assert loses_twice(both, alone=True)
    assert not loses_twice(both, alone=False)
    assert loses_twice([Active.of(blocked), Active.of(lossy, supply)], alone=False)
    diodes = Active.of(blocked, {'supply': 0.0})  # in front of each drive
    assert loses_twice([diodes, Active.of(lossy, own)], alone=False)
    assert not loses_twice(both[:1], alone=True)


def test_a_model_of_a_part_is_expected_to_lack_the_whole():
    assert prior_of('coulomb_friction', expected=True) == pytest.approx(0.9)
    assert prior_of('copper_loss', expected=True) == pytest.approx(0.995)  # as it is anyway
