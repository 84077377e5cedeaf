"""Names and units of columns as people write them, and what a guessed map asks for."""

import re

import numpy as np
import pytest
from power_recordings.commands.arguments import import_logs as main
from power_recordings.importing.map_file import parse_map
from power_recordings.importing.plan import make_plan
from power_recordings.importing.sources.heads import unit_of
from power_recordings.importing.sources.source import LogColumn
from power_recordings.importing.units import conversion
from table_log import csv

T = np.arange(600) / 100.0
SPEED = 3 * np.sin(2.1 * T)
ANGLE = -3 / 2.1 * np.cos(2.1 * T)
TORQUE = 20 * np.cos(0.9 * T)
WATTS = TORQUE * SPEED + 0.2 * TORQUE**2 + 6
VOLTS = 48 - 0.001 * WATTS


def guess(folder, capsys, **columns):
    """The guessed map of a log, as text and its lines by quantity."""
    columns = {'time_s': T, **columns}
    log = csv(folder / 'log.csv', np.stack(list(columns.values()), axis=1), ','.join(columns))
    capsys.readouterr()
    assert main([str(log), '--list']) == 0
    text = capsys.readouterr().out.partition('guessed map')[2]
    return text, {x.strip().partition(':')[0]: x for x in text.splitlines() if '   #' in x}


@pytest.mark.parametrize(
    ('name', 'unit'),
    [
        ('joint_vel_rad_s', 'rad/s'),
        ('dq_1_rad_s', 'rad/s'),
        ('omega_rad_per_s', 'rad/s'),
        ('qd_deg_s', 'deg/s'),
        ('n_1_min', '1/min'),
        ('speed_rev_min', 'rev/min'),
        ('load_N_m', 'N*m'),
        ('tau_lb_ft', 'lb*ft'),
        ('torque_1_min', ''),  # the least of the first joint
        ('body_vel_m_s', ''),
        ('used_wh_per_km', ''),
        ('n_m', ''),
        ('time_s', 's'),
        ('T_deg_C', 'C'),
        ('X_n/min-1', 'min-1'),
        ('t/s', 's'),
        ('Winkel / °', '°'),
        ('samples/s', ''),
        ('kt Nm/A', ''),
        ('km/h', ''),
        ('motor/1', ''),
        ('m1.dps', 'dps'),
        ('axis0.pos', ''),
        ('log.qd', ''),
        ('abad_qd', ''),  # a speed, no quectoday
        ('drive.tau.F', ''),
        ('volts.1', ''),
    ],
)
def test_a_unit_of_two_words_is_read_as_one(name, unit):
    assert unit_of(name) == unit


def test_a_map_may_write_a_rate_with_a_low_line():
    assert conversion('deg_s', 'velocity').factor == pytest.approx(np.pi / 180)
    assert conversion('rad_per_s', 'velocity').factor == 1.0
    assert conversion('1_min', 'velocity').factor == pytest.approx(2 * np.pi / 60)


def test_a_torque_is_multiplied_by_scale_beside_its_unit_and_not_by_the_gear_ratio():
    torque = {'from': 'm', 'unit': 'mN*m', 'at': 'motor'}
    speed = {'from': 'n', 'unit': 'rad/s', 'at': 'motor'}
    columns = [LogColumn(name, '') for name in ('t', 'm', 'n', 'i')]
    for scale, expected in (({}, 0.1), ({'scale': 60}, 6.0)):
        drive = {'gear_ratio': 60, 'velocity': speed, 'torque': {**torque, **scale}}
        drive |= {'voltage': {'value': 24}, 'current': {'from': 'i'}}
        content = {'format': 'import/1', 'time': {'column': 't'}, 'drives': {'A': drive}}
        plan = make_plan(parse_map(content, 'map'), columns, 'map', is_bag=False).drives['A']
        assert plan['torque'].convert({'m': np.array([100.0])})[0] == pytest.approx(expected)
        assert plan['velocity'].convert({'n': np.array([120.0])})[0] == pytest.approx(2.0)


def test_what_no_column_looks_like_is_said_of_each_quantity(tmp_path, capsys):
    text, lines = guess(tmp_path, capsys, q_rad=SPEED, tau_Nm=TORQUE, u_bus=VOLTS, i_bus=WATTS)
    assert '    # velocity: {from: COLUMN, unit: rad/s}   # no column looks like one\n' in text
    assert '    # temperature: {from: COLUMN, unit: degC}   # no column looks like one\n' in text
    assert '# position' not in lines


def test_a_bus_current_is_a_meters_unless_the_log_is_an_odrives(tmp_path, capsys):
    motion = {'pos': SPEED, 'vel': SPEED, 'tau_Nm': TORQUE, 'vbus_V': VOLTS}
    _, lines = guess(tmp_path, capsys, **motion, ibus_A=WATTS / VOLTS)
    assert 'computed: true}' not in lines['current']
    assert 'of a meter? If a firmware computes it' in lines['current']
    _, lines = guess(tmp_path, capsys, **motion, ibus_A=WATTS / VOLTS, fet_temp=30 + T)
    assert 'computed: true}' in lines['current']


@pytest.mark.parametrize(
    ('name', 'at'),
    [
        ('motorTorqueAtJoint', 'motor'),
        ('torque_est_Nm', 'motor'),
        ('tau_hat_Nmm', 'motor'),
        ('motor_torque_est_mNm', 'motor'),
        ('torque est. output [Nm]', 'motor'),
        ('tau_motor_Nm', 'motor'),
        ('torque_from_current', 'motor'),
        ('joint_torque_Nm', 'joint'),
        ('motor_torque_sensor_Nm', 'joint'),
        ('Output Torque [Nm]', 'joint'),
    ],
)
def test_a_torque_that_is_named_of_the_motor_or_estimated_is_at_the_motor(
    tmp_path, capsys, name, at
):
    text, lines = guess(tmp_path, capsys, **{name: TORQUE, 'speed_rpm': SPEED})
    assert f'at: {at}' in lines['torque']
    assert text.count('# at: motor is a torque computed from the current, at: joint') == 1
    assert ('# gear_ratio: 1   # fill in' in text) == (at == 'motor')


def test_a_wheel_in_the_name_of_a_torque_does_not_say_where_it_is_and_each_drive_is_asked(
    tmp_path, capsys
):
    columns = {}
    for side, speed in (('left', SPEED), ('right', np.cos(SPEED))):
        columns |= {f'{side}_wheel_torque [Nm]': speed + T, f'{side}_wheel_speed [rpm]': speed}
    text, _ = guess(tmp_path, capsys, **columns, battery_V=VOLTS, battery_A=WATTS / VOLTS)
    assert text.count('at: joint}   # by its name; at: joint is a guess\n') == 2
    assert text.count('    # at: motor is a torque computed from the current, at: joint') == 2


def test_a_speed_of_the_motor_asks_for_the_gear_ratio(tmp_path, capsys):
    text, _ = guess(tmp_path, capsys, tau_Nm=TORQUE, motor_speed_rpm=SPEED)
    assert '# gear_ratio: 1   # fill in' in text


def test_the_only_column_in_units_of_an_angle_is_the_position_if_it_moves_as_the_speed_says(
    tmp_path, capsys
):
    own = {'tilt_rate [deg/s]': SPEED, 'tilt_torque [Nm]': TORQUE, 'U': VOLTS, 'I': WATTS / VOLTS}
    _, lines = guess(tmp_path, capsys, **own, **{'tilt [deg]': ANGLE})
    assert "position: {from: 'tilt [deg]', unit: deg}   # by its unit" in lines['position']
    others = ({'tilt [deg]': TORQUE}, {'tilt [deg]': ANGLE, 'slope [deg]': ANGLE})
    for angles in (*others, {'tilt [deg]': ANGLE, 'tilt_angle': ANGLE}):
        text, _ = guess(tmp_path, capsys, **own, **angles)
        assert "from: 'tilt [deg]'" not in text


def test_symbols_of_din_are_known(tmp_path, capsys):
    names = {'U': VOLTS, 'I': WATTS / VOLTS, 'M': TORQUE, 'n': SPEED, 'T_wdg': 30 + T}
    _, lines = guess(tmp_path, capsys, **names)
    for quantity, name in zip(
        ('voltage', 'current', 'torque', 'velocity', 'temperature'), names, strict=True
    ):
        assert f'from: {name},' in lines[quantity]
    _, lines = guess(tmp_path, capsys, phi=ANGLE, omega=SPEED, M=TORQUE, P=WATTS, Usup=VOLTS)
    assert 'from: phi,' in lines['position']
    assert 'from: P,' in lines['power']
    assert 'from: Usup,' in lines['voltage']


@pytest.mark.parametrize('name', ['t_stator_degC', 'T_housing_1_degC', 'sensor3_degC'])
def test_a_column_in_degrees_celsius_is_a_temperature(tmp_path, capsys, name):
    power = {'u_dc_V': VOLTS, 'i_dc_A': WATTS / VOLTS}
    _, lines = guess(tmp_path, capsys, vel=SPEED, tau=TORQUE, **power, **{name: 30 + T})
    assert f'from: {name}, unit: degC' in lines['temperature']


@pytest.mark.parametrize('form', ['{}.{}', '{1}_{0}', '{1}{2}'])
def test_joints_before_or_behind_a_quantity_are_drives_with_one_meter(tmp_path, capsys, form):
    columns = {'u_bus': VOLTS, 'i_bus': WATTS / VOLTS}
    for k, joint in enumerate(('haa', 'hfe', 'kfe')):
        for name, values in (('M', TORQUE), ('w', SPEED), ('phi', SPEED)):
            address = form.format(joint, name, joint.title())
            columns[address if form != '{}.{}' else address.replace('M', 'tau')] = np.sin(
                (k + 1) * values
            )
    text, _ = guess(tmp_path, capsys, **columns)
    for joint in ('HAA', 'HFE', 'KFE'):
        assert f'\n  {joint}:\n' in text
    assert text.count('velocity: {from') == 3
    assert text.count('torque: {from') == 3
    assert 'supply: {voltage: {from: u_bus, unit: V}, current: {from: i_bus, unit: A}}' in text


def test_two_ends_of_a_shaft_and_two_sides_of_a_gear_are_no_drives(tmp_path, capsys):
    ends = {'n_a': SPEED, 'm_a': TORQUE, 'n_bb': -SPEED, 'm_bb': -TORQUE}
    text, _ = guess(tmp_path, capsys, **ends, U=VOLTS, I=WATTS)
    assert '\n  DRIVE:\n' in text
    sides = {'motor_pos': T, 'motor_vel': SPEED, 'link_pos': T + 0.1 * SPEED, 'link_vel': TORQUE}
    text, _ = guess(tmp_path, capsys, **sides, U=VOLTS, I=WATTS)
    assert '\n  DRIVE:\n' in text


def test_figures_of_one_signal_are_no_drives_and_what_changes_sign_no_supply(tmp_path, capsys):
    figures = {'tau_mean': TORQUE, 'tau_std': T, 'vel_mean': SPEED, 'vel_std': T % 1, 'u': SPEED}
    text, lines = guess(tmp_path, capsys, **figures, amps=WATTS)
    assert '\n  DRIVE:\n' in text
    assert 'value: VOLTS' in lines['# voltage']


def test_drives_of_which_one_has_no_number_are_all_named(tmp_path, capsys):
    columns = {}
    for name, share in (('J1', 1.0), ('J2', 0.5), ('Z', -0.3)):
        own = {'pos [deg]': ANGLE, 'speed [rpm]': SPEED, 'torque [Nm]': TORQUE, 'power [W]': WATTS}
        columns |= {f'{name} {q}': share * values + T % (1 + share) for q, values in own.items()}
    text, _ = guess(tmp_path, capsys, **columns)
    assert re.findall(r'\n  (\S+):\n', text) == ['DRIVE_1', 'DRIVE_2', 'Z']
    assert "power: {from: 'Z power [W]'" in text


def test_a_constant_voltage_is_asked_for_only_where_no_column_is_in_volts(tmp_path, capsys):
    own = {'pos_1': SPEED, 'vel_1': SPEED, 'amps_1': WATTS, 'pos_2': TORQUE, 'vel_2': TORQUE}
    _, lines = guess(tmp_path, capsys, **own, amps_2=WATTS, battery_voltage=VOLTS)
    assert 'voltage: {from: battery_voltage, unit: V}' in lines['voltage']
    _, lines = guess(tmp_path, capsys, **own, amps_2=WATTS)
    assert '{value: VOLTS, unit: V}   # no column is in volts: fill in' in lines['# voltage']


@pytest.mark.parametrize(
    ('mark', 'says'),
    [
        (
            '',
            'power without voltage; add voltage: {from: …} or {value: VOLTS, unit: V}, the',
        ),
        ('# ', "is 'VOLTS'"),
    ],
)
def test_a_voltage_that_was_not_filled_in_is_refused_in_one_line(tmp_path, capsys, mark, says):
    text, _ = guess(tmp_path, capsys, vel=SPEED, tau=TORQUE, power_W=WATTS)
    (tmp_path / 'map.yaml').write_text('#' + text.replace(f'{mark}voltage:', 'voltage:'))
    args = ['--map', str(tmp_path / 'map.yaml'), '-o', str(tmp_path / 'bag')]
    assert main([str(tmp_path / 'log.csv'), *args]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'drives.DRIVE' in line
    assert says in line


def test_a_lone_power_of_several_drives_is_that_of_the_supply_which_needs_no_voltage(
    tmp_path, capsys
):
    wheels = {'tau_l': TORQUE, 'tau_r': -SPEED, 'w_l': SPEED, 'w_r': np.cos(SPEED)}
    text, _ = guess(tmp_path, capsys, **wheels, **{'Battery power (W)': WATTS})
    assert "\nsupply: {power: {from: 'Battery power (W)', unit: W}}\n" in text
    assert 'no column looks like that of a supply' not in text
    (tmp_path / 'map.yaml').write_text('#' + text)
    args = ['--map', str(tmp_path / 'map.yaml'), '-o', str(tmp_path / 'bag')]
    assert main([str(tmp_path / 'log.csv'), *args]) == 0
    assert '1 V' not in capsys.readouterr().out
    current = {'batt_A': WATTS / VOLTS}  # of no known voltage
    text, _ = guess(tmp_path, capsys, **wheels, **current, batt_power_W=WATTS)
    assert '\nsupply: {power: {from: batt_power_W, unit: W}}\n' in text
    text, _ = guess(tmp_path, capsys, **wheels, batt_V=VOLTS)
    assert 'supply:' not in text


@pytest.mark.parametrize(
    ('symbols', 'found'),
    [(('q', 'dq', 'tau', 'P'), 2), (('q', 'dq', 'tau', 'p'), 0), (('th', 'dq', 'tau', 'P'), 0)],
)
def test_a_p_is_a_power_beside_q_dq_and_tau_alone(tmp_path, capsys, symbols, found):
    values = (ANGLE, SPEED, TORQUE, WATTS)
    columns = {
        f'{joint}_{symbol}': signal + k * np.cos(3 * T)
        for k, joint in enumerate(('hip', 'knee'))
        for symbol, signal in zip(symbols, values, strict=True)
    }
    text, _ = guess(tmp_path, capsys, **columns)
    assert text.count('power: {from: hip_P,') + text.count('power: {from: knee_P,') == found
    assert text.count(', positive: drawn}') == found


def test_a_list_says_of_which_rows_its_ranges_are(tmp_path, capsys):
    pyarrow, parquet = pytest.importorskip('pyarrow'), pytest.importorskip('pyarrow.parquet')
    columns = {'t_s': np.arange(99_894) / 500, 'vel_rad_s': np.sin(np.arange(99_894.0))}
    parquet.write_table(pyarrow.table(columns), tmp_path / 'log.parquet')
    assert main([str(tmp_path / 'log.parquet'), '--list']) == 0
    out = capsys.readouterr().out
    assert '# rows, min, max, changes: of the first 65,536 rows of 99,894\n' in out
    for rows in (600, 60_000):
        times = 1_727_000_000 + np.arange(rows) / 1000
        log = csv(tmp_path / 'log.csv', np.stack([times, np.sin(times)], axis=1), 't_s,vel_rad_s')
        assert main([str(log), '--list']) == 0
        assert 'of the first' not in capsys.readouterr().out


def test_a_list_shows_ends_that_differ_late_in_more_digits_and_no_negative_zero(tmp_path, capsys):
    text = '\n'.join(f'{1_727_000_000 + k},{-0.0 if k < 30 else 1}' for k in range(61))
    (tmp_path / 'log.csv').write_text(f't_s,vel_rad_s\n{text}\n')
    assert main([str(tmp_path / 'log.csv'), '--list']) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ['1727000000', '1727000060'] in [line[4:6] for line in lines]
    assert ['0', '1'] in [line[4:6] for line in lines]


def test_times_since_1970_in_nanoseconds_are_times(tmp_path, capsys):
    text, _ = guess(tmp_path, capsys, time_ns=1.718e18 + 1e9 * T, vel=SPEED, tau=TORQUE)
    assert 'time: {column: time_s, unit: s}   # or time_ns\n' in text
    back = 1.718e18 + 1e9 * T
    back[7] = np.nan  # a row that was lost
    text, _ = guess(tmp_path, capsys, time_ns=back, vel=SPEED, tau=TORQUE)
    assert '# or time_ns\n' in text


def test_a_value_that_means_none_is_no_signal(tmp_path, capsys):
    power = {'u_dc_V': VOLTS, 'i_dc_A': WATTS / VOLTS, 'temp': np.full(len(T), 9.91e37)}
    text, _ = guess(tmp_path, capsys, vel=SPEED, tau=TORQUE, **power)
    assert '# temperature: {from: COLUMN' in text


def test_left_and_right_wheels_are_drives_and_r_is_no_unit(tmp_path, capsys):
    wheels = {'tau_l': TORQUE, 'tau_r': -SPEED, 'w_l': SPEED, 'w_r': np.cos(SPEED)}
    text, _ = guess(tmp_path, capsys, batt_mV=1e3 * VOLTS, batt_mA=WATTS, **wheels)
    for side in ('L', 'R'):
        assert f'\n  {side}:\n' in text
    assert 'supply: {voltage: {from: batt_mV, unit: mV}' in text


def test_a_speed_along_the_ground_asks_for_the_radius_of_the_wheel(tmp_path, capsys):
    own = {'speed[km/h]': SPEED, 'tau_Nm': TORQUE, 'U': VOLTS, 'I': WATTS / VOLTS}
    text, _ = guess(tmp_path, capsys, **own)
    assert "# velocity: {from: 'speed[km/h]', scale: 0.2778, unit: rad/s}   # along the" in text
    own['vel_m_s'] = own.pop('speed[km/h]')
    text, _ = guess(tmp_path, capsys, **own, **{'cmd_vel[m/s]': SPEED})
    assert '# velocity: {from: vel_m_s, scale: 1, unit: rad/s}   # along the' in text
    own['X Torque [kgf cm]'] = own.pop('tau_Nm')
    own['speed_km_h'] = own.pop('vel_m_s')
    text, lines = guess(tmp_path, capsys, **own)
    assert '# velocity: {from: speed_km_h, scale: 0.2778, unit: rad/s}   # along the' in text
    assert "from: 'X Torque [kgf cm]'" in lines['torque']
    assert "# position: {from: 'X" not in text


@pytest.mark.parametrize(
    ('way', 'speed', 'scale'),
    [
        ('dist_m', 'speed_kmh', '1'),
        ('car_mm', 'car_mm_s', '0.001'),
        ('pos [mm]', 'v [mm/min]', '0.001'),
    ],
)
def test_a_way_along_the_ground_asks_for_the_radius_and_is_no_angle(
    tmp_path, capsys, way, speed, scale
):
    own = {way: 20 * ANGLE, speed: SPEED, 'tau_Nm': TORQUE, 'U': VOLTS, 'I': WATTS / VOLTS}
    text, lines = guess(tmp_path, capsys, **own)
    name = f"'{way}'" if ' ' in way else way
    assert f'# position: {{from: {name}, scale: {scale}, unit: rad}}' in text
    assert 'the radius of wheel or pulley in m' in lines['# position']
    assert not {'position', 'velocity'} & set(lines)


def test_fields_of_a_structure_are_known_by_their_own_names(tmp_path, capsys):
    own = {'log.n': 10 * SPEED, 'log.Tq': TORQUE, 'log.Udc': VOLTS, 'log.Idc': WATTS / VOLTS}
    _, lines = guess(tmp_path, capsys, **own)
    assert 'from: log.n,' in lines['velocity']
    assert 'from: log.Tq,' in lines['torque']


@pytest.mark.parametrize('name', ['esc_temp', 'temp_fet_degC', 'motor_driver_temp', 'mcu_temp[C]'])
def test_the_temperature_of_electronics_is_not_the_motors(tmp_path, capsys, name):
    power = {'u_dc_V': VOLTS, 'i_dc_A': WATTS / VOLTS, name: 30 + T}
    text, _ = guess(tmp_path, capsys, vel=SPEED, tau=TORQUE, **power)
    assert '# temperature: {from: COLUMN' in text
