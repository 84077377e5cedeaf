"""Guessed maps: names, units, and the power that columns make with each other."""

import numpy as np
import pytest
from power_recordings.commands.arguments import import_logs as main
from power_recordings.importing.origin import check_energy, recognise
from power_recordings.reading.reader import Recording
from real_logs import REAL
from table_log import csv, guessed

T = np.arange(1200) / 100.0
SPEED = 30 + 20 * np.sin(0.7 * T)  # rpm
TORQUE = 3 + 2 * np.cos(1.3 * T)
SHAFT = TORQUE * SPEED * 2 * np.pi / 60
NOISE = 0.02 * np.random.default_rng(0).normal(size=T.shape)


def test_several_logs_of_the_same_columns_have_one_map(tmp_path, capsys):
    table = np.stack([T, SPEED, TORQUE, SHAFT, 0 * T + 48], axis=1)
    head = 'time_s,speed_rpm,torque_nm,power_w,volts'
    logs = [str(csv(tmp_path / f'{name}.csv', table, head)) for name in ('a', 'b')]
    logs.append(str(csv(tmp_path / 'c.csv', table[:, :2], 'time_s,speed_rpm')))
    capsys.readouterr()
    assert main([*logs, '--list']) == 0
    text = capsys.readouterr().out
    assert f'# {logs[1]}: the same columns' in text
    assert f'# {logs[2]}: other columns: list it by itself' in text
    (tmp_path / 'map.yaml').write_text(text)
    output = str(tmp_path / 'bag')
    assert main([*logs[:2], '--map', str(tmp_path / 'map.yaml'), '-o', output]) == 0


def test_a_speed_without_unit_is_in_rpm_where_physics_says_so(tmp_path, capsys):
    amps = (1.2 * SHAFT + 0.1 * TORQUE**2 + 1 + NOISE) / 48
    columns = {'time_s': T, 'speed': SPEED, 'torque_nm': TORQUE, 'bus_voltage': 48 + NOISE}
    recording, lines = guessed(tmp_path, capsys, {**columns, 'bus_current': amps})
    assert 'unit: rpm' in lines['velocity']
    assert 'unit by physics' in lines['velocity']
    np.testing.assert_allclose(
        recording.joint_states().velocity[:, 0], SPEED * 2 * np.pi / 60, rtol=1e-4
    )


def test_a_current_of_the_motor_is_not_that_of_the_supply(tmp_path, capsys):
    amps = (1.2 * SHAFT + 1 + NOISE) / 48
    columns = {'ms_today': 6.2e7 + 1e3 * T, 'input_voltage': 48 + NOISE, 'current_motor': TORQUE}
    recording, lines = guessed(tmp_path, capsys, {**columns, 'current_in': amps, 'rpm': SPEED})
    assert 'column: ms_today, unit: ms' in lines['time']
    assert 'from: current_in' in lines['current']
    assert 'from: current_motor, unit: A, at: motor' in lines['torque']
    assert recording.duration == pytest.approx(11.99, abs=0.02)


def test_a_table_without_times_holds_operating_points_and_no_share_is_a_torque(tmp_path, capsys):
    rng = np.random.default_rng(3)
    speed, torque = rng.uniform(500, 6000, 200), rng.uniform(5, 100, 200)
    watts = torque * speed * 2 * np.pi / 60
    columns = {
        'Torque Accuracy (%)': rng.uniform(0, 4, 200),
        'N [1/min]': speed,
        'Torque [Nm]': torque,
        'U_DC [V]': 335 + rng.normal(size=200),
        'I_DC [A]': (1.1 * watts + 400) / 335,
    }
    recording, lines = guessed(tmp_path, capsys, columns)
    assert lines['time'].startswith('time: {steady: true}')
    assert "'Torque [Nm]'" in lines['torque']
    assert recording.card.steady


def test_the_meters_voltage_and_the_motors_temperature_are_preferred(tmp_path, capsys):
    columns = {'time [s]': T}
    for number in '12':
        columns |= {
            f'a{number} velocity [rad/s]': SPEED,
            f'a{number} torque [Nm]': 0.11 * TORQUE,
            f'a{number} q-axis [A]': TORQUE,
            f'c{number} voltage [V]': np.round(36 + NOISE * 20),
            f'c{number} temp [C]': np.round(30 + T / 3),
            f'ina{number} voltage [V]': 36 + NOISE,
            f'ina{number} current [A]': 1 + TORQUE,
        }
    columns |= {'trs605-5 torque [Nm]': TORQUE + NOISE, 'motor temp [C]': 30 + T / 3 + NOISE}
    recording, lines = guessed(tmp_path, capsys, columns)
    assert recording.joint_states().names == ('DRIVE_1', 'DRIVE_2')  # and no DRIVE_5
    assert "'ina" in lines['voltage']
    assert "'motor temp [C]'" in lines['temperature']
    assert 'at: motor' in lines['torque']
    assert 'it is 0.11 × a' in lines['torque']
    assert 'trs605-5 torque [Nm]' in lines['torque']
    assert "q-axis [A]'" in lines['motor_current']


def test_a_torque_that_is_held_is_a_command_where_a_sensor_is(tmp_path, capsys):
    held = np.round(TORQUE)
    volts = 48 + NOISE
    amps = (1.3 * SHAFT + 2 + NOISE) / 48
    columns = {'time_s': T}
    for name, sign in (('load', -1), ('test', 1)):
        columns |= {
            f'{name}_velocity': sign * SPEED,
            f'{name}_torque': held if sign > 0 else TORQUE,
        }
        columns |= {f'{name}_voltage': volts, f'{name}_current': sign * amps}
    recording, lines = guessed(tmp_path, capsys, {**columns, 'loadcell_torque_nm': TORQUE})
    assert recording.joint_states().names == ('LOAD', 'TEST')
    assert 'from: loadcell_torque_nm' in lines['torque']
    assert 'test_torque (changes in' in lines['torque']
    text = (tmp_path / 'map.yaml').read_text()
    assert '    # motor_current: {from: test_torque, unit: A}' in text
    both = tmp_path / 'both.yaml'
    both.write_text(text.replace('# motor_current', 'motor_current'))
    arguments = [str(tmp_path / 'log.csv'), '--map', str(both), '-o', str(tmp_path / 'sides')]
    assert main(arguments) == 0
    commanded = Recording.open(tmp_path / 'sides').motor_current()
    np.testing.assert_allclose(commanded.current[:, 0], held, atol=1e-5)


def test_a_product_of_other_columns_is_recognised_and_a_meter_is_not(tmp_path, capsys):
    vq, iq, vd, i_d = 5 + SPEED / 9, TORQUE, 0.3 * np.sin(T), 0.2 * np.cos(3 * T)
    made = 1.5 * (vq * iq + vd * i_d)
    columns = {'v_q': vq, 'i_q': iq, 'v_d': vd, 'i_d': i_d}
    found = recognise(made * (1 + 1e-4 * NOISE), columns)
    assert found == '1.5 × (v_q × i_q + v_d × i_d) (R² 0.9999)'
    assert recognise(1.06 * made + 3 + NOISE, columns) is None  # losses and a quiescent draw
    volts, amps = 36 + NOISE, made / 36
    meter = {**columns, 'voltage': volts, 'current': amps, 'other_voltage': 36 + NOISE[::-1]}
    assert recognise(volts * (amps + 0.1 + NOISE), meter, ('voltage', 'current')) is None
    table = {'t_s': T, 'speed_rpm': SPEED, 'bus_voltage': volts, 'bus_current': made / volts}
    recording, _ = guessed(tmp_path, capsys, {**table, **columns})
    assert recording.card.power == {'DRIVE': 'computed'}
    assert 'v_q × i_q' in recording.card.formula('DRIVE')


@pytest.mark.parametrize(('factor', 'says'), [(1.0, 'agree'), (1.5, 'do not agree')])
def test_a_counter_of_energy_is_held_against_the_integral_of_the_power(factor, says):
    joules = np.concatenate([[0], np.cumsum((SHAFT[1:] + SHAFT[:-1]) / 2 * np.diff(T))])
    counters = {'watt_hours_used': factor * joules / 3600 + 2, 'watt_hours_charged': 0 * T + 2}
    found = check_energy(T, SHAFT, counters)
    assert found.startswith('watt_hours_used − watt_hours_charged counts')
    assert f'the integral of the power is {joules[-1] / 3600:.4g} Wh' in found
    assert f'they {says}' in found


LOGS = {
    'compact_sspg/SSPG_MN8014_7_2__12.00_50.csv': ('torque', 'loadcell_torque_nm'),
    'compact_sspg/SSPG_MN8014_7_2__6.00_30.csv': ('velocity', 'rpm'),
    'ev_motor/Motor.csv': ('time', 'steady: true'),
    'moteus_dyno/futek_test_17_05_2021_17-01-51.csv': ('voltage', 'ina2 voltage'),
    'moteus_dyno/futek_test_17_05_2021_17-21-15.csv': ('temperature', 'motor temp'),
    'moteus_dyno/futek_test_18_05_2021_12-24-46.csv': ('motor_current', 'a2 q-axis'),
    'moteus_dyno/futek_test_24_05_2021_16-20-14.csv': ('current', 'ina2 current'),
    'odrive_d5065/odrive_D5065.csv': ('current', 'computed: true'),
    'vesc_bike/data.csv': ('current', 'current_in'),
    'thrust_t7056/Log_2019-11-07_174807.csv': ('torque', 'Torque (N·m)'),
    'hopper_500_hops.mat': ('velocity', 'rev/s'),
}


@pytest.mark.skipif(
    not REAL.is_dir(), reason='the public logs of real drives are not beside the checkout'
)
@pytest.mark.parametrize('log', LOGS)
def test_a_real_log_imports_from_its_guessed_map_as_it_is(tmp_path, capsys, log):
    assert main([str(REAL / log), '--list']) == 0
    text = capsys.readouterr().out
    (tmp_path / 'map.yaml').write_text(text)
    quantity, expected = LOGS[log]
    lines = [line for line in text.splitlines() if line.strip().startswith(f'{quantity}:')]
    assert expected in lines[-1]
    args = ['--map', str(tmp_path / 'map.yaml'), '-o', str(tmp_path / 'bag')]
    assert main([str(REAL / log), *args]) == 0
    out = capsys.readouterr().out
    assert 'mend the map' not in out
    if 'vesc' in log:
        assert '1.5 × (q_axis_voltage × q_axis_current + d_axis_voltage × d_axis_current)' in out
        assert 'they agree' in out
    else:
        assert 'power computed by the firmware,' not in out


@pytest.mark.parametrize(
    ('names', 'encoding'),
    [
        (('时间', '转速 [r/min]', '扭矩 [N·m]', '母线电压 [V]', '母线电流 [A]'), 'gb18030'),
        (('Zeit', 'Drehzahl [1/min]', 'Drehmoment [Nm]', 'U_DC [V]', 'Strom [A]'), 'latin-1'),
    ],
)
def test_columns_of_german_and_chinese_benches_are_known(tmp_path, capsys, names, encoding):
    rows = np.stack([T, SPEED, TORQUE, 48 + NOISE, (1.2 * SHAFT + 1 + NOISE) / 48], axis=1)
    text = '\n'.join([','.join(names), *(','.join(f'{x:.6g}' for x in row) for row in rows), ''])
    (tmp_path / 'log.csv').write_bytes(text.encode(encoding))
    assert main([str(tmp_path / 'log.csv'), '--list']) == 0
    listed = capsys.readouterr().out
    for name, quantity in zip(
        names[1:], ('velocity', 'torque', 'voltage', 'current'), strict=True
    ):
        line = next(x for x in listed.splitlines() if x.strip().startswith(f'{quantity}:'))
        assert name in line
    assert f'column: {names[0]}' in listed.replace("'", '')
    (tmp_path / 'map.yaml').write_text(listed)
    args = ['--map', str(tmp_path / 'map.yaml'), '-o', str(tmp_path / 'bag')]
    assert main([str(tmp_path / 'log.csv'), *args]) == 0


def test_operating_points_are_asked_for_nothing_that_needs_time(tmp_path, capsys):
    speed, torque = (x.ravel() for x in np.meshgrid(np.arange(1, 21) * 300.0, [2.0, 4.0, 9.0]))
    watts = 1.1 * torque * speed * 2 * np.pi / 60 + 20
    columns = {'N [1/min]': speed, 'Torque [Nm]': torque, 'U_DC [V]': 48 + 0 * speed}
    columns |= {'U [V]': 48 + speed / 1e4, 'I [A]': watts / 48}
    guessed(tmp_path, capsys, {**columns, 'position [deg]': np.cumsum(speed)})
    out = capsys.readouterr().out
    assert '60 operating points' in out
    assert 'times the rate of the position' not in out
    assert 'clipped' not in out
    assert 'jitter' not in out
    assert 'constant for' not in out


@pytest.mark.parametrize('meter', ['current', 'power'])
def test_a_power_is_said_to_be_of_a_constant_voltage_where_a_current_is_metered(
    tmp_path, capsys, meter
):
    columns = {'time_s': T, 'speed_rpm': SPEED, 'torque_nm': TORQUE, 'current': 1 + TORQUE}
    log = csv(tmp_path / 'log.csv', np.stack(list(columns.values()), axis=1), ','.join(columns))
    (tmp_path / 'map.yaml').write_text(
        'format: import/1\ntime: {column: time_s}\ndrives:\n  A:\n'
        '    velocity: {from: speed_rpm}\n    torque: {from: torque_nm}\n'
        '    voltage: {value: 24, unit: V}\n'
        f'    {meter}: {{from: current}}\n'
    )
    args = ['--map', str(tmp_path / 'map.yaml'), '-o', str(tmp_path / 'bag')]
    assert main([str(log), *args]) == 0
    said = 'its voltage is 24 V throughout: its power is a constant times its current'
    assert (said in capsys.readouterr().out) == (meter == 'current')


def swing(**columns):
    """Columns of a drive that drives and brakes, with what is given."""
    speed, torque = 30 * np.sin(0.7 * T), 3 * np.cos(1.3 * T)
    watts = 1.1 * torque * speed + 0.5 * torque**2 + 4 + NOISE
    table = {'time_s': T, 'speed [rad/s]': speed, 'torque_nm': torque, 'U_DC [V]': 48 + NOISE}
    return {**table, 'I_DC [A]': watts / 48, **columns}


def test_a_torque_that_counts_against_the_motion_is_turned_by_physics(tmp_path, capsys):
    columns = swing()
    columns['torque_nm'] = -columns['torque_nm']
    recording, lines = guessed(tmp_path, capsys, columns)
    assert 'scale: -1' in lines['torque']
    assert 'sign by physics' in lines['torque']
    np.testing.assert_allclose(recording.joint_states().effort[:, 0], swing()['torque_nm'], 1e-4)


def test_a_current_that_is_negative_while_drawing_is_fed(tmp_path, capsys):
    columns = swing()
    columns['I_DC [A]'] = -columns['I_DC [A]']
    _, lines = guessed(tmp_path, capsys, columns)
    assert 'positive: fed' in lines['current']
    assert 'scale' not in lines['torque']


def test_a_battery_is_the_meter_of_a_log_of_one_drive_and_counts_what_is_fed(tmp_path, capsys):
    columns = swing()
    columns['battery_current [A]'] = -columns.pop('I_DC [A]')
    columns['battery_voltage [V]'] = columns.pop('U_DC [V]')
    recording, lines = guessed(tmp_path, capsys, columns)
    assert 'supply' not in lines
    assert 'from: battery_voltage' in lines['voltage'].replace("'", '')
    assert 'positive: fed' in lines['current']
    assert recording.drive_supply().power.mean() > 0


def test_a_current_that_the_torque_was_computed_from_is_the_motors(tmp_path, capsys):
    columns = swing()
    log = csv(
        tmp_path / 'log.csv',
        np.stack([T, 30 * np.sin(0.7 * T), columns['torque_nm'], columns['torque_nm'] * 20], 1),
        'time_s,speed_rpm,torque_nm,current_ma',
    )
    assert main([str(log), '--list']) == 0
    text = capsys.readouterr().out
    assert 'motor_current: {from: current_ma' in text
    assert '# current: {from: COLUMN, unit: A}   # no column looks like that of a supply' in text


def test_the_only_current_is_the_supplys_where_its_power_follows_the_shaft(tmp_path, capsys):
    columns = swing()
    columns['motorCurrent'] = columns.pop('I_DC [A]')
    columns['voltage'] = columns.pop('U_DC [V]')
    _, lines = guessed(tmp_path, capsys, columns)
    assert 'from: motorCurrent' in lines['current']
    assert 'motor_current' not in lines


def test_letters_of_a_control_mode_and_a_speed_in_1_per_s_are_understood(tmp_path, capsys):
    columns = swing()
    renamed = {'t': T, 'p': 0 * T, 'v': columns['speed [rad/s]'], 'tau': columns['torque_nm']}
    volts, amps = columns['U_DC [V]'], columns['I_DC [A]']
    _, lines = guessed(tmp_path, capsys, {**renamed, 'V_bus': volts, 'I_bus': amps})
    assert 'from: v, unit: rad/s' in lines['velocity']
    assert 'from: V_bus' in lines['voltage']
    columns['n [1/s]'] = columns.pop('speed [rad/s]') / (2 * np.pi)
    (tmp_path / 'b').mkdir()
    _, lines = guessed(tmp_path / 'b', capsys, columns)
    assert "from: 'n [1/s]', unit: rev/s" in lines['velocity']


def test_a_voltage_may_stand_still_and_one_that_lacks_is_to_be_filled_in(tmp_path, capsys):
    recording, lines = guessed(tmp_path, capsys, swing(**{'U_DC [V]': 48 + 0 * T}))
    assert "from: 'U_DC [V]'" in lines['voltage']
    assert recording.drive_supply().voltage.max() == 48
    columns = swing()
    del columns['U_DC [V]']
    (tmp_path / 'b').mkdir()
    _, lines = guessed(tmp_path / 'b', capsys, columns)
    assert lines['# voltage'].startswith('# voltage: {value: VOLTS, unit: V}')
    assert 'fill in' in lines['# voltage']


def test_a_first_column_that_goes_on_evenly_is_the_time(tmp_path, capsys):
    columns = {'Name': 1e3 * T, **swing()}
    del columns['time_s']
    recording, lines = guessed(tmp_path, capsys, columns)
    assert 'column: Name, unit: ms' in lines['time']
    assert recording.duration == pytest.approx(11.99, abs=0.02)


def test_an_efficiency_is_taken_where_no_power_is_there(tmp_path, capsys):
    speed, torque = (x.ravel() for x in np.meshgrid(np.arange(1, 9) * 300.0, [2.0, 4.0, 9.0]))
    columns = {'Speed [rpm]': speed, 'Torque [Nm]': torque, 'Efficiency [%]': 70 + torque}
    recording, lines = guessed(tmp_path, capsys, columns)
    assert "from: 'Efficiency [%]', unit: '%'" in lines['efficiency']
    power = recording.drive_supply().power[:, 0]
    np.testing.assert_allclose(power, torque * speed * np.pi / 30 / (0.7 + torque / 100), 1e-5)


def test_a_map_over_two_quantities_is_recognised_by_its_head(tmp_path, capsys):
    rows = np.c_[np.arange(1, 9), 80 + np.arange(32).reshape(8, 4)]
    log = csv(tmp_path / 'map.csv', rows, 'Torque,1000,2000,3000,4000')
    assert main([str(log), '--list']) == 0
    assert 'its head holds numbers' in capsys.readouterr().out
