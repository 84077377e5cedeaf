"""True plants of the lab's benchmarks."""

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import truths
from truths import FAMILIES, MOTIONS, Case, hidden_watts, record
from truths.families import TruePlant
from truths.parameters import Drive, Sampling, Supply
from truths.recorded import draw, simulate
from truths.steps import PARTS

QUIET = Sampling(
    position_noise=0.0, velocity_noise=0.0, torque_noise=0.0, current_noise=0.0, voltage_noise=0.0
)
BARE = Drive(coulomb=0.0, viscous=0.0, inertia=0.0, iron=0.0, idle=0.0, copper_temperature=0.0)


def _run(drive, motion, sampling=QUIET, supply=None, seconds=30.0):
    plant = TruePlant((drive,), supply or Supply(electronics=0.0), sampling, frozenset())
    return simulate(Case('rigid', motion, seconds, 1, 3), plant)


def test_nothing_of_the_lab_is_imported():
    for file in Path(truths.__file__).parent.glob('*.py'):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [alias.name for alias in node.names] + [getattr(node, 'module', '') or '']
                assert not [n for n in names if n.startswith(('power_lab', 'power_estimator'))]


@pytest.mark.parametrize('family', FAMILIES)
def test_parts_of_the_power_sum_to_what_the_meter_truly_gets(family):
    for motion in FAMILIES[family].motions:
        found = record(Case(family, motion, 6.0, 2, seed=5))
        size = np.abs(found.parts).sum(axis=-1).max()
        assert np.abs(found.power - found.parts.sum(axis=-1)).max() < 1e-5 * size


@pytest.mark.parametrize('motion', MOTIONS)
def test_every_motion_stays_within_the_limits_of_every_scale(motion):
    for family in ('elastic', 'gimbal', 'harmonic', 'wheel'):
        found = record(Case(family, motion, 10.0, 12, seed=1))
        limit = np.array([[drive.torque_limit, drive.speed_limit] for drive in found.plant.drives])
        assert np.abs(found.data.torque).max() < 1.6 * limit[0, 0]
        assert np.abs(found.data.velocity).max() < 2.0 * limit[0, 1]
        assert len(found.data.names) == 12


def test_locked_winding_turns_current_into_heat():
    made = _run(replace(BARE, resistance=0.5, torque_constant=5.0), 'stall')
    copper = made.parts[:, 0, PARTS.index('copper_loss')]
    torque = np.interp(np.arange(len(copper)) / 50 + 0.01, made.joint_time, made.joints[2, 0])
    assert np.allclose(copper, 0.5 * (torque / 5.0) ** 2, atol=0.02 * copper.max())


def test_source_resistance_makes_the_bus_sag_by_its_current():
    supply = Supply(electronics=0.0, electronics_spread=0.0, resistance=0.2)
    made = _run(replace(BARE, idle=48.0), 'stall', supply=supply)
    volts, amps = made.meter[:, 0, 1000:]
    assert np.allclose(volts, 48.0 - 0.2 * amps, atol=0.01)


def test_blocked_braking_power_is_burned_in_the_drive_that_brakes():
    supply = Supply(electronics=0.0, electronics_spread=0.0, blocked=True)
    made = _run(BARE, 'wheel', supply=supply, seconds=60.0)
    shaft = made.parts[:, 0, PARTS.index('shaft')]
    assert shaft.min() < -20.0
    assert np.median(made.power[shaft < -10.0]) > -1.0
    assert made.parts[:, 0, PARTS.index('regeneration_limit')].max() > 20.0


def test_torque_from_the_current_knows_friction_and_a_sensor_does_not():
    rough = replace(BARE, coulomb=5.0)
    at_joint = _run(rough, 'ladder').joints[2, 0]
    at_motor = _run(replace(rough, torque_at_motor=1.0), 'ladder').joints[2, 0]
    assert np.quantile(np.abs(at_motor - at_joint), 0.9) == pytest.approx(5.0, rel=0.02)


def test_spring_lets_the_torque_follow_within_its_bandwidth():
    elastic = replace(BARE, inertia=0.07, stiffness=400.0, torque_loop=50.0)
    stiff, soft = _run(BARE, 'walk'), _run(elastic, 'walk')
    error = soft.joints[2, 0] - stiff.joints[2, 0]
    assert 0.001 < error.std() / stiff.joints[2, 0].std() < 0.3
    assert np.abs(soft.parts[:, 0, PARTS.index('spring')]).max() > 1.0


def test_hysteresis_and_scale_are_in_the_reading_of_torque_alone():
    true = _run(BARE, 'stall')
    off = _run(replace(BARE, torque_scale=1.1, torque_hysteresis=1.0), 'stall')
    assert np.array_equal(true.power, off.power)
    error = off.joints[2, 0] - 1.1 * true.joints[2, 0]
    assert error.max() == pytest.approx(1.0, abs=0.01)
    assert error.min() == pytest.approx(-1.0, abs=0.01)


def test_polled_drives_are_read_at_moments_of_their_own():
    found = record(Case('wheel', 'wheel', 20.0, 3, seed=2))
    assert found.plant.sampling.skew > 0.0
    made = simulate(found.case, found.plant)
    period = np.diff(made.joint_time)
    assert period.std() > 0.0
    assert period.mean() == pytest.approx(1 / found.plant.sampling.joint_rate, rel=0.01)


def test_hidden_effect_exists_and_is_not_known():
    null, hidden = Case('rigid', 'walk', 10.0), Case('rigid', 'walk', 10.0, hidden=('cogging',))
    assert not record(null).missing
    found = record(hidden)
    assert found.missing == {'cogging'}
    assert 'cogging' not in found.known
    assert found.parts[..., PARTS.index('cogging')].any()
    assert hidden_watts(hidden)['cogging'] > 0.0
    twice = hidden_watts(replace(hidden, strength=2.0))['cogging']
    assert twice == pytest.approx(2 * hidden_watts(hidden)['cogging'], rel=0.1)


def test_a_winding_that_heats_unmeasured_is_more_than_a_model_knows():
    """A model heats a winding by its temperature: without that it lacks the effect."""
    plants = [record(Case('gimbal', 'ladder', 5.0, seed=seed)) for seed in range(8)]
    heated = [one for one in plants if 'winding_heating' in one.plant.exists]
    measured = {one.plant.sampling.temperature for one in heated}
    assert measured == {False, True}
    for one in heated:
        assert ('winding_heating' in one.known) == one.plant.sampling.temperature
        assert ('winding_heating' in one.missing) != one.plant.sampling.temperature


def test_known_effects_leave_a_part_of_what_a_hidden_one_changes():
    """Heating is all but a factor of copper loss; cogging is like no other effect."""
    hidden = Case('elastic', 'walk', 10.0, hidden=('cogging', 'winding_heating'))
    changed, left = (hidden_watts(hidden, apart=apart) for apart in (False, True))
    assert left['winding_heating'] < 0.5 * changed['winding_heating']
    assert 0.8 * changed['cogging'] < left['cogging'] <= changed['cogging']


def test_another_run_of_a_plant_has_its_figures():
    one, other = Case('robot', 'walk', 5.0), Case('robot', 'walk', 5.0, seed=9, plant_seed=0)
    assert draw(one) == draw(other)
    assert not np.array_equal(record(one).power, record(other).power)


def test_a_case_is_the_same_in_every_process():
    case = Case('robot', 'hopper', 4.0, 1, seed=4)
    code = (
        'from truths import Case, record;'
        "print(repr(float(record(Case('robot', 'hopper', 4.0, 1, seed=4)).power.sum())))"
    )
    bench = Path(truths.__file__).parents[1]
    shown = subprocess.run(
        [sys.executable, '-c', code], cwd=bench, capture_output=True, text=True, check=True
    )
    assert float(shown.stdout) == float(record(case).power.sum())


@pytest.mark.parametrize('effect', ['copper_loss', 'cross_talk', 'fan', 'regeneration_limit'])
def test_every_hidden_effect_has_a_size(effect):
    assert hidden_watts(Case('elastic', 'hopper', 10.0, hidden=(effect,)))[effect] > 0.05


@pytest.mark.parametrize('family', FAMILIES)
def test_windings_stay_below_what_melts_them(family):
    case = Case(family, 'stall', 600.0, 1, seed=1, hidden=('winding_heating',))
    assert simulate(case, draw(case)).joints[3].max() < 150.0
