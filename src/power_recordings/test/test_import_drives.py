"""Guessed maps: columns of several drives, and units by the rate of a position."""

import numpy as np
import pytest
import yaml
from power_recordings.commands.arguments import import_logs as main
from power_recordings.reading.reader import Recording
from table_log import csv, run

T = np.arange(1200) / 100.0
RNG = np.random.default_rng(5)


ANGLE, SPEED = -np.cos(2.1 * T), 2.1 * np.sin(2.1 * T)
TORQUE = 20 * np.cos(0.9 * T)
WATTS = TORQUE * SPEED + 0.2 * TORQUE**2 + 6


def guess(folder, capsys, names, **columns):
    """Return a guessed map and its text; columns without values are noise, each its own."""
    return listed(
        folder, capsys, {n: columns.get(n, RNG.normal(size=len(T))) for n in names.split()}
    )


def listed(folder, capsys, values):
    """Return the guessed map of columns by name, and its text."""
    table = np.stack([T, *values.values()], axis=1)
    log = csv(folder / 'log.csv', table, ','.join(['time_s', *values]))
    capsys.readouterr()
    assert main([str(log), '--list']) == 0
    text = capsys.readouterr().out
    return yaml.safe_load(text), text


@pytest.mark.parametrize(
    'kinds',
    ['enc rate mNm', 'Grad Grad_s Ncm', 'deg deg_s Nm', 'ang rate torque'],
)
def test_columns_that_units_alone_tell_are_of_the_drives_that_their_names_tell(
    tmp_path, capsys, kinds
):
    angle, speed, _ = kinds.split()
    names = [f'{drive}_{kind}' for drive in ('roll', 'pitch') for kind in kinds.split()]
    columns = {}
    for drive in ('roll', 'pitch'):
        columns[f'{drive}_{speed}'] = RNG.normal(size=len(T))
        columns[f'{drive}_{angle}'] = np.cumsum(columns[f'{drive}_{speed}']) / 100
    found, text = guess(tmp_path, capsys, ' '.join([*names, 'pack_V', 'pack_mA']), **columns)
    for drive, own in found['drives'].items():
        assert own['position']['from'] == f'{drive.lower()}_{angle}'
        assert own['velocity']['from'] == f'{drive.lower()}_{speed}'
        assert 'torque' in own
    assert list(found['drives']) == ['ROLL', 'PITCH']
    assert found['supply']['current']['from'] == 'pack_mA'
    assert 'not used' not in text


def test_a_temperature_whose_name_tells_one_drive_is_that_drives_alone(tmp_path, capsys):
    columns = 'hip_q hip_dq hip_tau knee_q knee_dq knee_tau T_wdg_knee bat_V bat_A'
    found, _ = guess(tmp_path, capsys, columns)
    assert found['drives']['KNEE']['temperature']['from'] == 'T_wdg_knee'
    assert 'temperature' not in found['drives']['HIP']


def test_letters_behind_symbols_are_drives_where_motion_has_them_and_phases_where_not(
    tmp_path, capsys
):
    columns = 'posA_rad wA_rad_s MA_Nm VA IA posB_rad wB_rad_s MB_Nm VB IB'
    found, _ = guess(tmp_path, capsys, columns)
    assert found['drives']['B']['voltage']['from'] == 'VB'
    assert found['drives']['B']['current']['from'] == 'IB'
    found, _ = guess(tmp_path, capsys, 'angle_rad speed_rpm torque_Nm IA IB IC Vdc Idc')
    assert found['drives']['DRIVE']['current']['from'] == 'Idc'
    found, _ = guess(tmp_path, capsys, 'angle_rad speed_rpm torque_Nm VA VB VC IA IB IC')
    assert 'current' not in found['drives']['DRIVE']


def test_columns_of_motion_that_a_lone_drive_leaves_are_told(tmp_path, capsys):
    columns = 'speed_rpm torque_Nm rotation_speed_two_rpm torque_two_Nm Vdc Idc'
    found, text = guess(tmp_path, capsys, columns)
    assert list(found['drives']) == ['DRIVE']
    assert '# not used: rotation_speed_two_rpm, torque_two_Nm. Of another drive?' in text


@pytest.mark.parametrize('name', ['ntc', 'coil_C', 'winding_ntc', 'T_wind_C'])
def test_a_temperature_is_known_by_its_sensor_and_by_a_winding_in_degrees(tmp_path, capsys, name):
    columns = f'angle_rad speed_rpm torque_Nm Vdc Idc {name}'
    found, _ = guess(tmp_path, capsys, columns)
    assert found['drives']['DRIVE']['temperature']['from'] == name


def test_the_third_of_three_phases_is_no_temperature(tmp_path, capsys):
    columns = 'angle_rad speed_rpm torque_Nm Vdc Idc coil_A coil_B coil_C'
    found, _ = guess(tmp_path, capsys, columns)
    assert 'temperature' not in found['drives']['DRIVE']


@pytest.mark.parametrize(
    ('angle', 'speed'),
    [
        (('rad', 1.0), ('rad/s', 1.0)),
        (('deg', 57.3), ('deg/s', 57.3)),
        (('deg', 57.3), ('rpm', 9.55)),
    ],
)
def test_a_speed_without_unit_is_what_its_position_says(tmp_path, capsys, angle, speed):
    """In rad; in degrees by its range, which is negative."""
    radians = -0.6 + 0.55 * np.sin(2.1 * T)
    columns = {'angL': angle[1] * radians, 'velL': speed[1] * np.gradient(radians, T)}
    columns |= {'angR': columns['angL'][::-1], 'velR': -columns['velL'][::-1]}
    names = 'angL velL trqL angR velR trqR vbat ibat'
    found, text = guess(tmp_path, capsys, names, **columns)
    for own in found['drives'].values():
        assert (own['position']['unit'], own['velocity']['unit']) == (angle[0], speed[0])
    assert 'velocity is then the rate of the position' in text


def test_a_position_without_unit_is_what_its_speed_says(tmp_path, capsys):
    rpm = 300 + 50 * np.sin(0.7 * T)
    angle = np.cumsum(rpm) * 6.0 / 100
    found, _ = guess(tmp_path, capsys, 'Angle Speed_rpm Torque', Angle=angle, Speed_rpm=rpm)
    assert found['drives']['DRIVE']['position']['unit'] == 'deg'


@pytest.mark.parametrize('kinds', ['{}_deg {}_deg_s {}_Nm', '{}_Winkel/° {}_n/min-1 {}_M_Last/Nm'])
@pytest.mark.parametrize('letters', ['ABC', 'XZ'])
def test_drives_of_letters_have_each_its_own_columns(tmp_path, capsys, kinds, letters):
    own = {letter: kinds.replace('{}', letter).split() for letter in letters}
    names = [name for names in own.values() for name in names]
    found, _ = guess(tmp_path, capsys, ' '.join([*names, 'bus_V', 'bus_W']))
    for letter, names in own.items():
        drive = found['drives'][letter]
        assert [drive[q]['from'] for q in ('velocity', 'torque')] == names[1:]
    assert list(found['drives']) == list(letters)


def test_drives_of_angle_and_torque_alone_are_told_apart(tmp_path, capsys):
    found, _ = guess(tmp_path, capsys, 'yaw_mdeg yaw_mNm roll_mdeg roll_mNm v_mV i_mA')
    assert found['drives']['ROLL']['position']['from'] == 'roll_mdeg'
    assert found['drives']['ROLL']['torque']['from'] == 'roll_mNm'


def test_names_in_a_group_that_holds_all_tell_time_and_drives_and_other_meters(tmp_path, capsys):
    names = 'hoist_rpm hoist_Nm trolley_rpm trolley_Nm U1_V P1_W U2_V P2_W'
    columns = ['crane.t_s', *(f'crane.{name}' for name in names.split())]
    noise = np.random.default_rng(3).normal(size=(8, len(T)))
    table = np.stack([T, *noise[:4], *(noise[4:] + 5.0)], axis=1)  # what is drawn is above 0
    log = csv(tmp_path / 'log.csv', table, ','.join(columns))
    assert main([str(log), '--list']) == 0
    text = capsys.readouterr().out
    found = yaml.safe_load(text)
    assert found['time'] == {'column': 'crane.t_s', 'unit': 's'}
    assert list(found['drives']) == ['HOIST', 'TROLLEY']
    assert 'or crane.P2_W: a meter of each drive?' in text


@pytest.mark.parametrize(('rows', 'time'), [(1000, {'steady': True}), (3000, {'unit': 's'})])
def test_thousands_of_rows_that_follow_on_another_are_not_taken_for_operating_points(
    tmp_path, capsys, rows, time
):
    t = np.arange(rows) / 100.0
    table = np.stack([np.sin(t), np.cos(1.7 * t), 48 + 0 * t, 1 + np.sin(t) ** 2], axis=1)
    log = csv(tmp_path / 'log.csv', table, 'speed_rpm,torque_Nm,bus_V,bus_A')
    assert main([str(log), '--list']) == 0
    assert yaml.safe_load(capsys.readouterr().out)['time'].items() >= time.items()


@pytest.mark.parametrize(
    ('name', 'motion'), [('cycle', 'vel_rad_s'), ('sample', 'vel_rad_s'), ('n', 'q_rad')]
)
def test_a_count_of_rows_is_the_time_once_its_period_is_filled_in(tmp_path, capsys, name, motion):
    count = np.delete(np.arange(100, 3120), np.arange(600, 620))  # of which 20 were lost
    t = count * 2e-3
    table = np.stack([count, np.sin(t), np.cos(1.7 * t), 48 + 0 * t, 1 + np.sin(t) ** 2], axis=1)
    log = csv(tmp_path / 'log.csv', table, f'{name},{motion},torque_Nm,bus_V,bus_A')
    assert main([str(log), '--list']) == 0
    text = capsys.readouterr().out
    assert f"time: {{column: {name}, unit: 'PERIOD ms'}}" in text
    assert run(log, text, tmp_path / 'bag') == 2
    assert "unit 'PERIOD ms' of time is not known" in capsys.readouterr().err
    assert run(log, text.replace('PERIOD', '2'), tmp_path / 'bag') == 0
    assert Recording.open(tmp_path / 'bag').duration == pytest.approx(3019 * 2e-3)


@pytest.mark.parametrize(
    ('kinds', 'drives'),
    [
        ('{}_hip_{} {}_knee_{}', {'FL_HIP', 'FL_KNEE', 'RR_HIP', 'RR_KNEE'}),
        ('{}_leg_{}', {'FL', 'RR'}),  # the same second word in all
    ],
)
def test_drives_of_two_words_are_told_apart_where_the_first_alone_is_of_several(
    tmp_path, capsys, kinds, drives
):
    names = [
        kind.format(leg, what)
        for leg in ('FL', 'RR')
        for kind in kinds.split()
        for what in ('q', 'dq', 'tau', 'pwr')
    ]
    values = dict(zip(('q', 'dq', 'tau', 'pwr'), (ANGLE, SPEED, TORQUE, WATTS), strict=True))
    found, _ = listed(tmp_path, capsys, {n: values[n.split('_')[-1]] for n in names})
    assert set(found['drives']) == drives
    for own in found['drives'].values():
        assert {'position', 'velocity', 'torque', 'power'} <= set(own)


def test_a_second_word_tells_drives_whose_meters_have_another_first_word(tmp_path, capsys):
    quantities = {
        'hip_{} angle [rad]': ANGLE,
        'hip_{} rate [rad/s]': SPEED,
        'hip_{} torque [Nm]': TORQUE,
        'bus_{} U [V]': 48 + 0 * T,
        'bus_{} I [A]': WATTS / 48,
    }
    columns = {kind.format(side): own for side in 'LR' for kind, own in quantities.items()}
    found, _ = listed(tmp_path, capsys, columns)
    assert found['drives']['L']['current']['from'] == 'bus_L I [A]'
    assert found['drives']['R']['current']['from'] == 'bus_R I [A]'
    assert found['drives']['R']['position']['from'] == 'hip_R angle [rad]'


def test_effort_and_numbered_powers_are_known_beside_the_motion_of_their_drive(tmp_path, capsys):
    columns = {'knee.pos': ANGLE, 'knee.vel': SPEED, 'knee.eff': TORQUE, 'knee.pdc': WATTS}
    columns |= {name.replace('knee', 'hip'): own for name, own in columns.items()}
    found, _ = listed(tmp_path, capsys, columns)
    assert found['drives']['HIP']['torque']['from'] == 'hip.eff'
    columns = {}
    for n in '12':
        columns |= {f'q{n}': ANGLE, f'dq{n}': SPEED, f'M{n}': TORQUE, f'P{n}': WATTS}
    found, _ = listed(tmp_path, capsys, columns)
    assert found['drives']['DRIVE_*']['power']['from'] == 'P*'


def test_speeds_of_a_like_name_have_one_unit(tmp_path, capsys):
    """A drive that mostly holds: by itself its speed would be in turns a second."""
    held = 0.6 * 2 * np.pi * TORQUE * SPEED + 0.2 * TORQUE**2
    columns = {}
    for name, watts in (('abad', held), ('hip', WATTS), ('knee', WATTS)):
        columns |= {f'{name}_q': ANGLE, f'{name}_qd': SPEED, f'{name}_tau': TORQUE}
        columns[f'{name}_p_dc'] = watts
    found, _ = listed(tmp_path, capsys, columns)
    assert {own['velocity']['unit'] for own in found['drives'].values()} == {'rad/s'}


@pytest.mark.parametrize(('wheel', 'unit'), [(1.0, 'rad/s'), (60 / 2 / np.pi, 'rpm')])
def test_a_speed_that_its_own_power_tells_keeps_its_unit(tmp_path, capsys, wheel, unit):
    columns = {}
    for name, size in (('shoulder', 1.0), ('elbow', 1.0), ('wheel', wheel)):
        columns |= {f'{name}_vel': size * SPEED, f'{name}_torque': TORQUE, f'{name}_p_dc': WATTS}
    found, _ = listed(tmp_path, capsys, columns)
    units = {drive: own['velocity']['unit'] for drive, own in found['drives'].items()}
    assert units == {'SHOULDER': 'rad/s', 'ELBOW': 'rad/s', 'WHEEL': unit}


@pytest.mark.parametrize(
    'pair',
    ['knee_raw knee_filt', 'motor_actual motor_filtered', 'test_dut test_load'],
)
def test_two_kinds_of_one_drives_signals_are_no_drives(tmp_path, capsys, pair):
    values = {
        'pos': ANGLE,
        'vel': SPEED,
        'torque': TORQUE,
        'current': WATTS / 48,
        'voltage': 48 + 0 * T,
    }
    columns = {f'{kind}_{what}': own for kind in pair.split() for what, own in values.items()}
    found, _ = listed(tmp_path, capsys, columns)
    assert len(found['drives']) == 1


def test_a_drive_of_one_word_stands_beside_those_of_two(tmp_path, capsys):
    joints = ['left_hip', 'left_knee', 'right_hip', 'right_knee', 'waist']
    values = {'pos': ANGLE, 'vel': SPEED, 'torque': TORQUE, 'power': WATTS}
    for form in ('{0}_{1}', '{1}_{0}'):
        names = {form.format(joint, what): own for joint in joints for what, own in values.items()}
        found, _ = listed(tmp_path, capsys, names)
        assert set(found['drives']) == {joint.upper() for joint in joints}


def test_an_efficiency_called_eff_is_no_torque_and_a_shafts_pwr_no_meter(tmp_path, capsys):
    columns = {'rpm': 60 / 2 / np.pi * SPEED, 'motor_eff': 0.9 + 0 * T + 0.01 * ANGLE}
    found, _ = listed(tmp_path, capsys, columns | {'mech_pwr': TORQUE * SPEED, 'dc_pwr': WATTS})
    (own,) = found['drives'].values()
    assert 'torque' not in own
    assert own['power']['from'] == 'dc_pwr'
