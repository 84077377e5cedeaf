import math

import pytest
from power_estimator.drive_types import DriveType
from power_estimator.effects import Effect, Excitation, Term, builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import EffectModel, needs_of
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy


def of(name, **shape):
    return needs_of(builtin_catalogue()[name], shape, ('a', 'b'))


def test_a_network_needs_its_features_at_its_rate_and_the_history_of_an_estimate(checkpoint):
    needs = PowerPredictionNetwork(checkpoint).needs
    assert set(needs.inputs) == {'position_error', 'torque', 'velocity'}
    assert (needs.rate, needs.smooth, needs.memory) == (200.0, True, 0.3)


def test_a_proxy_without_a_factor_needs_measured_power_unless_it_is_in_watts():
    assert 'power' in Proxy('torque_squared').needs.inputs
    assert 'power' not in Proxy('mechanical_power').needs.inputs
    fitted = Proxy('torque_squared', (DriveType('a', ('a',)),), {'a': 2.0})
    assert set(fitted.needs.inputs) == {'torque', 'velocity'}


def test_the_winding_needs_its_temperature_or_else_all_before():
    assert of('winding_heating', time_constant=0.0).inputs == {'temperature': 'winding_heating'}
    heated = of('winding_heating', time_constant=50.0)
    assert (heated.inputs, heated.memory, heated.remembers) == ({}, math.inf, 'winding_heating')


@pytest.mark.parametrize('drives', range(1, 13))
def test_the_winding_remembers_all_in_any_number_of_drives(drives):
    heating, names = builtin_catalogue()['winding_heating'], [f'd{n}' for n in range(drives)]
    for shape in heating.shapes:
        needs = needs_of(heating, shape, names)
        assert needs.memory == (math.inf if shape['time_constant'] else 0.01)


def test_only_the_limit_of_the_bus_looks_at_all_drives():
    catalogue = builtin_catalogue()
    together = [one.name for one in catalogue.physics() if of(one.name, **one.shapes[0]).together]
    assert together == ['regeneration_limit']
    assert not of('regeneration_limit', supply=0.0).together  # diodes in front of each drive


def test_a_spring_forgets_within_a_tenth_of_a_second():
    assert 0.02 < of('spring', relaxation=0.012).memory < 0.1


def test_a_model_needs_what_its_effects_and_its_base_need(checkpoint):
    catalogue = builtin_catalogue()
    actives = [Active.of(catalogue[name]) for name in ('shaft', 'line_resistance', 'cogging')]
    model = EffectModel('own', Structure(tuple(actives)))
    assert set(model.needs.inputs) == {'torque', 'velocity', 'position'}
    assert model.needs.inputs['position'] == 'cogging'
    assert set(model.needs.improved_by) == {'voltage'}
    assert (model.needs.rate, model.needs.smooth) == (400.0, False)
    ppn = PowerPredictionNetwork(checkpoint)
    added = EffectModel('own', model.structure, base='ppn:x', base_model=ppn)
    assert 'position_error' in added.needs.inputs
    assert added.needs.memory == pytest.approx(0.3)


def test_a_user_effect_that_looks_far_back_without_saying_so_remembers_all():
    class Wear(Effect):
        name = physics = formula = 'wear'
        terms = (Term('c', 'W/rad'),)
        excitation = Excitation('none')

        def regressors(self, signals, **shape):
            return abs(signals.velocity).cumsum(axis=0)[..., None]

    assert needs_of(Wear(), {}, ('a',)).memory == math.inf


def test_what_is_lacking_is_said_with_the_effect_that_needs_it():
    needs = of('cogging', order=6.0)
    assert needs.lacking(('torque', 'velocity')) == 'cogging needs position'
    assert needs.lacking(('position',)) == ''
