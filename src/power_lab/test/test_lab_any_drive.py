"""The lab on recordings that others made: slow meters, whole robots, real drives."""

import json
from dataclasses import replace

import numpy as np
import pytest
from power_estimator.commands.arguments import benchmark
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.model_file.model import FittedValue
from power_estimator.effects.model_file.yaml_file import read_model
from power_lab.commands.arguments import compare, diagnose, fit
from power_lab.commands.options import console
from power_lab.compare.notes import notes
from power_lab.report.tables import print_model
from power_recordings.commands.arguments import import_logs
from real_logs import HOPPER, REAL

from power_lab import Session

MAP = """
format: import/1
time: {column: t, unit: s}
drives:
  'J*':
    position: {from: q*, unit: rad}
    velocity: {from: w*, unit: rad/s}
    torque: {from: tau*, unit: N*m, at: motor}
%s
card: {robot: made}
"""
DRIVE = '    voltage: {value: 48, unit: V}\n    power: {from: p*, unit: W, positive: drawn}\n'
SUPPLY = (
    'supply:\n  voltage: {value: 48, unit: V}\n  current: {from: amps, unit: A, positive: drawn}'
)
COPPER = (0.02, 0.5)  # W/(N·m)²
IDLE = 12.0  # W, of the robot


def recording(
    tmp_path, electric, *, seconds=90.0, rate=100.0, hold=0.0, units='', turning=0.0, wrapped=False
):
    """Two joints of 40 and 4 N·m; the power is the mean of `hold` s where that is given."""
    random = np.random.default_rng(5)
    time = np.arange(round(seconds * rate)) / rate
    waves = 2 * np.pi * random.uniform(0.1, 1.2, (2, 2, 4)) * time[:, None, None, None]
    swings = np.sin(waves + random.uniform(0, 6, (2, 2, 4))).sum(axis=-1)
    torque = swings[:, 0] * np.array([10.0, 1.0]) + np.array([8.0, 0.5])
    velocity = swings[:, 1] * np.array([1.0, 2.0]) + turning
    position = np.cumsum(velocity, axis=0) / rate
    if wrapped:
        position = np.mod(position, 2 * np.pi)
    power = torque * velocity + np.array(COPPER) * torque**2 + IDLE / 2
    power = power + random.normal(0.0, 0.05, power.shape)
    if hold:
        count = round(hold * rate)
        power = power.reshape(-1, count, 2).mean(axis=1).repeat(count, axis=0)
    table = np.column_stack([time, position, velocity, torque, power, power.sum(axis=1) / 48])
    names = ('t', *(f'{name}{j}' for name in ('q', 'w', 'tau', 'p') for j in (0, 1)), 'amps')
    log, chart = tmp_path / 'log.csv', tmp_path / 'map.yaml'
    np.savetxt(log, table, delimiter=',', header=','.join(names), comments='', fmt='%.9g')
    lines = [
        f'    {units}' if units and line.strip().startswith(units.split(':')[0]) else line
        for line in (MAP % electric).splitlines()
    ]
    chart.write_text('\n'.join(lines))
    bag = tmp_path / 'bag'
    assert import_logs([str(log), '--map', str(chart), '-o', str(bag)]) == 0
    return bag


def fitted(bag, tmp_path, *options):
    model, found = tmp_path / 'm.yaml', tmp_path / 'fit.json'
    arguments = [str(bag), '--effects', 'shaft,copper_loss,idle', *options]
    assert fit([*arguments, '-o', str(model), '--json', str(found)]) == 0
    scores = tmp_path / 'compare.json'
    assert compare([str(bag), '--models', str(model), *options, '--json', str(scores)]) == 0
    return model, json.loads(scores.read_text())['models'][0]


def copper(model):
    from power_estimator.effects import builtin_catalogue
    from power_estimator.effects.model_file.yaml_file import read_model

    groups = read_model(model, builtin_catalogue()).groups
    return [group.coefficients['copper_loss'][0].value for group in groups]


def test_the_drives_of_a_robot_that_is_metered_as_a_whole_are_told_apart(tmp_path, capsys):
    bag = recording(tmp_path, SUPPLY)
    model, scores = fitted(bag, tmp_path)
    assert copper(model) == pytest.approx(COPPER, rel=0.1)
    assert scores['drives']['robot']['r2'] > 0.99
    assert 'only the power of the whole robot was measured' in capsys.readouterr().out
    found = tmp_path / 'd.json'
    assert diagnose([str(bag), '--model', str(model), '--json', str(found)]) == 0
    assert json.loads(found.read_text())['verdict'] == 'no_evidence'


def test_of_a_single_drive_behind_the_robots_meter_nothing_is_shared(tmp_path):
    bag = recording(tmp_path, SUPPLY)
    prepared = Session.open(bag).judge.prepared
    one = replace(
        prepared,
        signals=prepared.signals.drive(0),
        torque_constant=prepared.torque_constant[:1],
    )
    assert any('the drives share it' in line for line in notes(prepared))
    assert not any('the drives share it' in line for line in notes(one))
    assert any('idle has its electronics in it' in line for line in notes(one))


def test_an_effect_that_a_whole_robots_model_lacks_is_named(tmp_path):
    bag = recording(tmp_path, SUPPLY)
    model, found = tmp_path / 'm.yaml', tmp_path / 'd.json'
    assert fit([str(bag), '--effects', 'shaft,idle', '-o', str(model)]) == 0
    assert diagnose([str(bag), '--model', str(model), '--json', str(found)]) == 0
    outcome = json.loads(found.read_text())
    assert (outcome['verdict'], outcome['effects']) == ('named', ['copper_loss'])
    (of_copper,) = [one for one in outcome['candidates'] if one['name'] == 'copper_loss']
    assert of_copper['drive'] == 'J0'  # most of the heat is there
    assert of_copper['coefficient'] == pytest.approx(COPPER[0], rel=0.1)
    assert of_copper['coefficients']['J0'] == [pytest.approx(of_copper['coefficient'], rel=1e-3)]
    low, high = of_copper['interval']
    assert low < COPPER[0] < high


def test_a_slow_meter_is_refused_and_with_slow_judged_by_its_energy(tmp_path, capsys):
    bag = recording(tmp_path, DRIVE, hold=0.5, seconds=300.0)
    arguments = [str(bag), '--effects', 'shaft,copper_loss,idle', '-o', str(tmp_path / 'no.yaml')]
    assert fit(arguments) == 2
    error = capsys.readouterr().err
    assert 'changes 2 times a second' in error
    assert '--slow-meter' in error
    assert not (tmp_path / 'no.yaml').exists()
    model, scores = fitted(bag, tmp_path, '--slow-meter')
    assert copper(model) == pytest.approx(COPPER, rel=0.15)
    assert scores['total']['r2'] > 0.9


def test_a_meter_that_changes_too_seldom_for_the_recordings_length_decides_nothing(
    tmp_path, capsys
):
    bag = recording(tmp_path, DRIVE, hold=10.0, seconds=90.0)
    output = tmp_path / 'no.yaml'
    arguments = [str(bag), '--effects', 'shaft,copper_loss,idle', '-o', str(output)]
    assert fit(arguments) == 2
    assert 'changes 0.1 times a second' in capsys.readouterr().err
    assert fit([*arguments, '--slow']) == 2
    error = capsys.readouterr().err.strip()
    assert 'windows of 30 s; ' in error
    assert 'record 360 s or more' in error
    assert '\n' not in error
    assert not output.exists()


def test_a_drive_with_a_dead_meter_hinders_no_other(tmp_path, capsys):
    dead = "  'Z0':\n    velocity: {from: w0, unit: rad/s}\n    torque: {from: tau0, unit: N*m}\n"
    dead += '    voltage: {value: 48, unit: V}\n    power: {value: 3, unit: W}'
    bag = recording(tmp_path, DRIVE + dead)
    arguments = [str(bag), '--effects', 'shaft,copper_loss,idle', '-o', str(tmp_path / 'm.yaml')]
    assert fit(arguments) == 2
    assert 'Z0 changes 0 times a second' in capsys.readouterr().err
    assert fit([*arguments, '--drives', 'J0', 'J1']) == 0


def test_updates_are_counted_in_the_time_of_rows_and_below_one_in_two_seconds():
    from power_recordings.quality.streams import updates

    seconds = np.arange(100)[None] / 100 + 2 * np.arange(4)[:, None]  # 1 s of rows, 1 s without
    stamps = (seconds.ravel() * 1e9).astype(np.int64)
    rows = np.arange(400, dtype=np.float32)[:, None]
    assert updates(stamps, rows) == pytest.approx(100, rel=0.01)
    stamps = np.arange(9000, dtype=np.int64) * 10_000_000
    assert updates(stamps, np.floor_divide(np.arange(9000)[:, None], 1000)) == pytest.approx(0.1)


def test_a_model_of_some_drives_says_which_of_a_whole_robot_it_lacks(tmp_path, capsys):
    (tmp_path / 'one').mkdir()
    model = tmp_path / 'm.yaml'
    one = recording(tmp_path / 'one', DRIVE)
    effects = ['--effects', 'shaft,copper_loss,idle']
    assert fit([str(one), '--drives', 'J0', *effects, '-o', str(model)]) == 0
    whole = recording(tmp_path, SUPPLY)
    assert compare([str(whole), '--models', str(model)]) == 2
    assert capsys.readouterr().err.strip().endswith('m lacks the power of J1')


def test_a_whole_robots_power_is_no_choice_of_its_drives_and_takes_a_base(tmp_path, capsys):
    bag = recording(tmp_path, SUPPLY)
    arguments = [str(bag), '--effects', 'shaft,copper_loss,idle', '-o', str(tmp_path / 'm.yaml')]
    assert fit([*arguments, '--drives', 'J0']) == 2
    assert 'only the whole robot was metered' in capsys.readouterr().err
    from power_estimator.effects import builtin_catalogue
    from power_estimator.effects.training import Active, fit_model, material
    from power_estimator.judge.recordings import load

    data, catalogue = load([bag]).data, builtin_catalogue()
    own = material(data, base=np.zeros_like(data.torque), catalogue=catalogue)
    effects = [Active.of(catalogue['inverter_loss'])]
    model, _ = fit_model('m', own, effects, catalogue, base='ppn:any')
    assert len(model.groups) == 2


def test_a_recording_in_wrong_units_is_refused_with_the_line_of_the_map_that_mends_it(
    tmp_path, capsys
):
    bag = recording(tmp_path, DRIVE, units='torque: {from: tau*, unit: mN*m, at: motor}')
    arguments = [str(bag), '--effects', 'shaft,idle', '-o', str(tmp_path / 'no.yaml')]
    assert fit(arguments) == 2
    error = capsys.readouterr().err.strip()
    assert '\n' not in error
    assert 'power grows by 1e+03 W with each W of torque × speed' in error
    assert 'power is in mW?; in the map: power: {unit: mW}' in error  # of the map's own signals
    assert fit([*arguments, '--ignore-unit-conflicts']) == 0
    scored = [str(bag), '--models', 'plain']
    assert benchmark(scored) == 2
    assert '--ignore-unit-conflicts judges it as it is' in capsys.readouterr().err
    assert benchmark([*scored, '--anyway']) == 0


def test_fit_tells_the_power_balance_before_any_physics_and_errors_of_the_measurement(
    tmp_path, capsys
):
    bag = recording(tmp_path, DRIVE.replace('unit: W', 'unit: W, scale: 1.15'))
    model, found = tmp_path / 'm.yaml', tmp_path / 'f.json'
    effects = ['--effects', 'shaft,copper_loss,idle']
    assert fit([str(bag), *effects, '-o', str(model), '--json', str(found)]) == 0
    out = capsys.readouterr().out
    content = json.loads(found.read_text())
    balance = content['power_balance']['J0']
    assert balance['slope'] == pytest.approx(1.15, rel=0.02)
    assert 0.5 < balance['share'] < 1.0
    assert 0 < out.index('power balance of J0: 1.1') < out.index('active effects')
    assert f'{balance["share"]:.0%} of the variance' in out
    gain = content['measurement']['J0']['power_gain']
    assert gain['value'] == pytest.approx(0.15, abs=0.01)
    errors = out.split('errors of the measurement')[1].splitlines()
    assert f'{gain["value"]:.3g}' in next(line for line in errors if 'power_gain' in line)

    fitted_model = read_model(model, builtin_catalogue())
    (group, *others), bound = fitted_model.groups, FittedValue(0.04, (0.03, 0.04), 'upper')
    group = replace(group, measurement={**group.measurement, 'power_gain': bound})
    print_model(console(), replace(fitted_model, groups=(group, *others)))
    out = capsys.readouterr().out
    assert '0.04*' in next(line for line in out.splitlines() if 'power_gain' in line)
    assert 'J0 power_gain (upper)' in out
    end = (FittedValue(0.04, (0.04, 0.09)),)
    group = replace(group, coefficients={**group.coefficients, 'copper_loss': end})
    print_model(console(), replace(fitted_model, groups=(group, *others)))
    out = capsys.readouterr().out
    assert '0.04~' in next(line for line in out.splitlines() if 'copper_loss k' in line)
    assert '~ at the end of its interval: the fit and the posterior' in out


def test_a_robot_that_generates_is_no_robot_of_wrong_sign(tmp_path):
    from power_recordings.quality.check import check_recording
    from power_recordings.reading.reader import Recording

    def codes(bag):
        return {finding.code for finding in check_recording(Recording.open(bag)).findings}

    for name in ('driven', 'turned'):
        (tmp_path / name).mkdir()
    driven = recording(tmp_path / 'driven', SUPPLY, turning=-6.0)
    assert 'supply_sign' not in codes(driven)
    wrong = SUPPLY.replace('positive: drawn', 'positive: fed')
    assert 'supply_sign' in codes(recording(tmp_path / 'turned', wrong, turning=6.0))


@pytest.mark.parametrize('wrapped', [False, True], ids=['on', 'anew each turn'])
def test_drives_that_turn_on_are_judged(tmp_path, wrapped):
    bag = recording(tmp_path, DRIVE, turning=6.0, wrapped=wrapped)
    model, scores = fitted(bag, tmp_path)
    assert copper(model) == pytest.approx(COPPER, rel=0.1)
    assert scores['total']['r2'] > 0.99


@pytest.mark.parametrize('rate', [30.0, 2000.0])
def test_recordings_of_any_rate_give_the_same_copper_loss(tmp_path, rate):
    bag = recording(tmp_path, DRIVE, rate=rate, seconds=40.0)
    model, scores = fitted(bag, tmp_path)
    assert copper(model) == pytest.approx(COPPER, rel=0.1)
    assert scores['total']['r2'] > 0.99


def test_a_drive_without_position_gets_a_verdict(tmp_path):
    bag = recording(tmp_path, DRIVE, units='position: {from: none, unit: rad, optional: true}')
    model, found = tmp_path / 'm.yaml', tmp_path / 'd.json'
    assert fit([str(bag), '--effects', 'shaft,idle', '-o', str(model)]) == 0
    assert diagnose([str(bag), '--model', str(model), '--json', str(found)]) == 0
    assert json.loads(found.read_text())['effects'] == ['copper_loss']


@pytest.mark.skipif(not REAL.exists(), reason=f'no public logs of real drives in {REAL.name}')
class TestRealDrives:
    def test_the_hopper_goes_from_its_file_to_a_verdict_in_three_commands(self, tmp_path):
        from scipy.io import loadmat

        chart, bag = tmp_path / 'hopper.yaml', tmp_path / 'hop'
        chart.write_text(HOPPER)
        log = REAL / 'hopper_500_hops.mat'
        assert import_logs([str(log), '--map', str(chart), '-o', str(bag)]) == 0
        model, scores = fitted(bag, tmp_path)
        assert scores['total']['r2'] > 0.98
        assert {value.split()[1] for value in scores['at_bound']} <= {'velocity_lag'}
        data = loadmat(log, simplify_cells=True)['motor_data']
        for drive, found in enumerate(copper(model)):
            torque = 0.02506 * data['motor_qcurrent'][:, drive]
            speed = 2 * np.pi * data['motor_vel'][:, drive]
            watts = data['bus_voltage'][:, drive] * data['bus_current'][:, drive]
            columns = [torque * speed, torque**2, np.abs(speed), np.ones_like(speed)]
            by_hand = np.linalg.lstsq(np.column_stack(columns), watts, rcond=None)[0][1]
            assert found == pytest.approx(by_hand, rel=0.25)

    def test_a_robot_arm_is_judged_by_the_power_of_its_supply(self, tmp_path):
        bag = tmp_path / 'ur'
        arguments = [str(REAL / 'ur3e_move.xlsx'), '--map', 'ur_rtde', '-o', str(bag)]
        assert import_logs(arguments) == 0
        _, scores = fitted(bag, tmp_path)
        assert scores['total']['r2'] > 0.9

    def test_the_axes_of_a_cobot_are_told_from_two_seconds(self, tmp_path, capsys):
        bag = tmp_path / 'cobot'
        arguments = [str(REAL / 'yu_cobot.parquet'), '--map', 'voraus', '-o', str(bag)]
        assert import_logs(arguments) == 0
        _, scores = fitted(bag, tmp_path)
        loaded = [scores['drives'][f'AXIS_{axis}']['r2'] for axis in (1, 2, 3, 4, 6)]
        assert min(loaded) > 0.9
        assert 's are little' in capsys.readouterr().out
