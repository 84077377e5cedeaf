"""Coefficients in the terms of a drive's owner."""

import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_lab.structure.owners_terms import DriveAtWork, in_owners_terms

EFFECTS = builtin_catalogue()
DRIVE = DriveAtWork(load=2.0, speed=10.0, copper=0.5, torque_constant=0.1)


def said(name, symbol, value, interval, drive=DRIVE, **shape):
    return in_owners_terms(Active.of(EFFECTS[name], shape), symbol, value, interval, drive)


def test_a_winding_whose_loss_grows_as_coppers_is_said_beside_copper():
    found = said('winding_heating', 'c', 0.5, (0.25, 1.0), time_constant=0.0)
    assert found == 'the winding gains 0.39 (0.195 … 0.78) %/K; copper: 0.39'


def test_the_coefficient_of_a_winding_as_warm_as_copper_is_that_of_its_copper_loss():
    heating, copper = (EFFECTS[name].terms[0] for name in ('winding_heating', 'copper_loss'))
    assert heating.unit == copper.unit == 'W/(N·m)²'
    assert heating.formerly == 'W/((N·m)²·K)'


def test_growth_with_a_temperature_that_nobody_measured_has_no_such_term():
    assert said('winding_heating', 'c', 0.5, (0.25, 1.0), time_constant=20.0) == ''


def test_copper_loss_is_watts_per_square_of_the_motors_current_where_that_is_known():
    assert said('copper_loss', 'k', 20.0, (10.0, 30.0)) == '0.2 (0.1 … 0.3) W/A² in the winding'
    unknown = DriveAtWork(load=2.0, speed=10.0, copper=0.5, torque_constant=float('nan'))
    assert said('copper_loss', 'k', 20.0, (10.0, 30.0), unknown) == '80 (40 … 120) W at 2 N·m'


def test_a_spring_that_may_not_give_at_all_has_no_upper_stiffness():
    assert said('spring', '1/ks', 0.05, (0.0, 0.1)) == '20 (10 … inf) N·m/rad'


@pytest.mark.parametrize(
    ('name', 'symbol', 'words'),
    [
        ('load_friction', 'c', 'the gear takes 5 (4 … 6) % of the load'),
        ('line_resistance', 'Rl', '50 (40 … 60) mΩ in the supply line'),
        ('iron_loss', 'h', '0.5 (0.4 … 0.6) W at 10 rad/s'),
        ('iron_loss', 'e', '5 (4 … 6) W at 10 rad/s'),
        ('spring', '1/ks', '20 (16.7 … 25) N·m/rad'),
        ('viscous_friction', 'B', ''),
    ],
)
def test_each_effect_is_said_as_a_data_sheet_has_it(name, symbol, words):
    assert said(name, symbol, 0.05, (0.04, 0.06)) == words
