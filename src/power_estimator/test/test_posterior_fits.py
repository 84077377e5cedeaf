"""Fits of sets of effects to a drive of the bench, of whose truth the models know nothing."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.signals.prepared import prepare
from power_estimator.posterior import fitted_set
from power_estimator.posterior.fitted_set import fit_set, settle
from power_estimator.posterior.judged import judged_effects
from power_estimator.posterior.meter import MeterProblem
from power_estimator.posterior.priors import NAMED
from power_estimator.posterior.rates import with_quiet_rates
from power_estimator.posterior.summary import summarised
from truth_circuit import Truth, record
from truths import Case
from truths import record as true_plant

EFFECTS = builtin_catalogue()
KNOWN = ('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle')


@pytest.fixture(scope='module')
def meter():
    truth = Truth(dict.fromkeys(KNOWN, 1.0), 'walk', 20.0, 1)
    prepared = prepare(record(truth).drives(['LF_KFE']))
    own = replace(prepared, signals=with_quiet_rates(prepared.signals))
    return MeterProblem(own, [Active.of(EFFECTS['shaft'])], None)


def test_a_set_without_effects_has_evidence_and_draws(meter):
    assert settle(meter, [], [], []) == {}
    found = fit_set(meter, [], [], {})
    assert np.isfinite(found.evidence)
    assert summarised(meter, [], [], {}).coefficients == {}


@pytest.mark.parametrize('factor', [0.2, 1.0, 5.0])
def test_a_fit_ends_at_no_worse_a_point_than_it_began(meter, monkeypatch, factor):
    actives = [Active.of(EFFECTS[name]) for name in KNOWN]
    point = settle(meter, actives, actives, KNOWN)
    start = {name: (active, factor * values) for name, (active, values) in point.items()}
    found = fit_set(meter, actives, KNOWN, start)
    monkeypatch.setattr(fitted_set, '_ITERATIONS', 1)
    assert found.evidence >= fit_set(meter, actives, KNOWN, start).evidence


def test_a_fit_that_begins_where_it_ended_takes_no_further_step(meter):
    actives = [Active.of(EFFECTS[name]) for name in KNOWN]
    first = fit_set(meter, actives, KNOWN, settle(meter, actives, actives, KNOWN))
    again = fit_set(meter, actives, KNOWN, first.point)
    assert again.evidence == pytest.approx(first.evidence, abs=1.0)
    assert 0.0 <= again.promises < 5.0  # nats


def test_columns_of_some_effects_are_those_that_a_point_gives_them(meter):
    copper, viscous, _, idle = actives = [Active.of(EFFECTS[name]) for name in KNOWN]
    point = settle(meter, actives, actives, KNOWN)
    taken = meter.columns(actives, point).taken([idle, copper])
    made = meter.columns([idle, copper], point)
    for part in ('effects', 'watts', 'nuisance', 'bent'):
        np.testing.assert_allclose(getattr(taken, part), getattr(made, part), rtol=1e-9)
    assert taken.places(copper) == slice(1, 2)
    with pytest.raises(KeyError, match='viscous_friction'):
        taken.places(viscous)


def test_a_model_of_the_shaft_alone_lacks_copper_loss():
    truth = Truth(dict.fromkeys(KNOWN, 1.0), 'walk', 20.0, 1)
    prepared = prepare(record(truth).drives(['LF_KFE']))
    found = judged_effects(prepared, [Active.of(EFFECTS['shaft'])], EFFECTS)
    assert found.probability['copper_loss'] > NAMED


def test_an_arm_that_rests_under_load_lacks_no_stribeck_friction_for_its_noise_of_speed():
    truth = true_plant(Case('rigid', 'arm', 60.0, 1, 67100001, strength=2.0))
    known = [Active.of(EFFECTS[name]) for name in truth.known]
    found = judged_effects(prepare(truth.data), known, EFFECTS)
    assert found.probability['stribeck_friction'] < 0.5


def test_a_scale_that_stands_in_for_an_effect_that_is_not_named_is_not_certain():
    case = Case('rigid', 'arm', 60.0, 1, 97100003, ('load_friction', 'viscous_friction'), 2.0)
    truth = true_plant(case)
    known = [Active.of(EFFECTS[name]) for name in truth.known]
    found = judged_effects(prepare(truth.data), known, EFFECTS)
    assert found.probability['load_friction'] > NAMED
    assert 0.1 < found.probability['viscous_friction'] < NAMED  # there, too
    assert max(found.scales.values()) < NAMED  # all sensors are right


def test_computers_that_take_what_a_hopper_returns_are_no_idle_draw_of_its_drive():
    # They draw 170 W beside its one meter, and the supply takes nothing back.
    truth = true_plant(Case('robot', 'hopper', 60.0, 1, 97100001, strength=0.5))
    known = [Active.of(EFFECTS[name]) for name in truth.known]
    (meter,) = judged_effects(prepare(truth.data), known, EFFECTS).meters
    low, high = np.quantile(meter.coefficients['idle'], [0.025, 0.975])
    assert low < truth.coefficients['LF_KFE']['idle'] < high
    assert high < 40.0  # W: without them 47 to 70
