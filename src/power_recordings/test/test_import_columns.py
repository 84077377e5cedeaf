"""Guessed maps of foreign logs whose columns, units or signs users met."""

import numpy as np
import pytest
from power_recordings.commands.arguments import import_logs as main
from power_recordings.quality.physics import velocity_slope
from table_log import guessed

T = np.arange(1200) / 100.0
SPEED = 30 + 20 * np.sin(0.7 * T)  # rpm
TORQUE = 3 + 2 * np.cos(1.3 * T)
SHAFT = TORQUE * SPEED * 2 * np.pi / 60
NOISE = 0.02 * np.random.default_rng(0).normal(size=T.shape)


def test_a_rate_without_unit_is_in_the_arc_seconds_of_its_position(tmp_path, capsys):
    rate = 4000.0 * np.sin(0.7 * T)
    columns = {'unix_time': T, 'az_arcsec': np.cumsum(rate) / 100.0 + 1e5, 'az_rate': rate}
    columns |= {'az_torque': TORQUE, 'U_supply': 24 + NOISE, 'I_az': 1 + NOISE}
    recording, lines = guessed(tmp_path, capsys, columns)
    assert 'unit: arcsec/s' in lines['velocity']
    moved = recording.joint_states().velocity[:, 0]
    np.testing.assert_allclose(moved, np.deg2rad(rate / 3600.0), rtol=1e-4, atol=1e-7)


def test_both_signs_of_a_brake_are_turned_where_its_losses_would_give_power(tmp_path, capsys):
    speed = 20.0 + 4.0 * np.sin(0.7 * T)
    power = -TORQUE * speed + 0.5 * TORQUE**2 + 6.0 + NOISE
    columns = {'Time (s)': T, 'Spool speed (rad/s)': speed, 'Resisting torque (Nm)': TORQUE}
    _, lines = guessed(tmp_path, capsys, {**columns, 'DC power returned (W)': -power})
    assert 'scale: -1' in lines['torque']
    assert 'positive: fed' in lines['power']
    assert lines['power'].endswith('sign by physics: else losses give power')


def test_a_turned_sign_is_explained_by_the_one_thing_that_was_seen(tmp_path, capsys):
    power = SHAFT + 0.5 * TORQUE**2 + 9.0 + NOISE
    columns = {'t_s': T, 'speed_rpm': SPEED, 'torque_Nm': -TORQUE, 'power_W': power}
    _, lines = guessed(tmp_path, capsys, columns)
    assert 'else power falls as torque × speed rises;' in lines['torque'] + ';'


def test_a_time_of_day_alone_is_the_time(tmp_path, capsys):
    text = [
        f'05:47:{12 + t:05.2f},{n:.3f},{m:.3f}' for t, n, m in zip(T, SPEED, TORQUE, strict=True)
    ]
    log = tmp_path / 'log.csv'
    log.write_text('\n'.join(['clock,FL_rpm,FL_Nm', *text]))
    assert main([str(log), '--list']) == 0
    assert 'time: {column: clock}' in capsys.readouterr().out


def test_units_of_a_comment_that_repeats_the_names_and_before_a_note_are_read(tmp_path, capsys):
    rows = [
        f'{10 * i},{n:.3f},{m:.3f}' for i, (n, m) in enumerate(zip(SPEED, TORQUE, strict=True))
    ]
    log = tmp_path / 'log.csv'
    log.write_text('\n'.join(['% run 18', '% t[ms]  n[rpm]  Q[Nm]', 't,n,Q', *rows]))
    assert main([str(log), '--list']) == 0
    text = capsys.readouterr().out
    assert 'torque: {from: Q, unit: Nm' in text
    log.write_text(
        '\n'.join(['t;q;w', 's;deg (0..360);deg/s', *(r.replace(',', ';') for r in rows)])
    )
    assert main([str(log), '--list']) == 0
    assert '{from: q, unit: deg}' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('head', 'line'),
    [
        ('t,drum_rpm,I_motor,U_source,I_source', 'torque: {from: I_motor, unit: A'),
        ('t,drum_rpm,I_motor,U_source,I_source', 'current: {from: I_source'),
        ('sec,car_rpm,motor_A,drive_W,x', 'torque: {from: motor_A, unit: A'),
        ('ms,finger_rpm,tau_mNm,p_mW,x', 'power: {from: p_mW, unit: mW'),
        ('ms,finger_rpm,tau_mNm,p_mW,x', 'time: {column: ms, unit: ms}'),
        ('t,dq_L,tau_L,pow_L,x', 'power: {from: pow_L'),
        ('t,n_rpm,revs,T_mNm,Pdc', 'position: {from: revs'),
        ('# a valve, on a stand, at 100 Hz, without time, 2 kg\n#pos,speed_rpm,stem_Nm,P_mW,x',
         'torque: {from: stem_Nm, unit: Nm'),
    ],
)  # fmt: skip
def test_columns_of_a_motors_current_of_power_time_and_turns_are_known(
    tmp_path, capsys, head, line
):
    turns = np.cumsum(SPEED) / 6000.0
    columns = np.stack([np.arange(len(T)) + 200.0, SPEED, turns, 48 + NOISE, SHAFT + 9], axis=1)
    log = tmp_path / 'log.csv'
    log.write_text('\n'.join([head, *(','.join(f'{x:.5f}' for x in row) for row in columns)]))
    assert main([str(log), '--list']) == 0
    assert line in capsys.readouterr().out


def test_a_wrapped_angle_and_its_rate_agree():
    angle = np.cumsum(SPEED) * 2 * np.pi / 60 / 100
    found = velocity_slope(T, np.mod(3.0 * angle, 2 * np.pi), 3.0 * SPEED * 2 * np.pi / 60)
    assert found.slope == pytest.approx(1.0, abs=0.01)


def test_prose_above_a_head_is_neither_names_nor_units(tmp_path, capsys):
    rows = [f'{t:.2f},{m:.3f},{n:.3f}' for t, m, n in zip(T, TORQUE, SPEED, strict=True)]
    log = tmp_path / 'log.csv'

    def listed(*head):
        log.write_text('\n'.join([*head, *rows]))
        assert main([str(log), '--list']) == 0
        return capsys.readouterr().out

    named = listed('# measured by hans', '# time, torque [Nm], speed [rpm]')
    assert 'time: {column: time, unit: s}' in named
    assert 'hans' not in listed('# measured by hans')
    assert listed('# t s A', 't,q,w') == listed('# a, b', 't,q,w')


def test_a_propeller_whose_meter_reads_a_little_low_keeps_its_signs(tmp_path, capsys):
    """Torque that goes with the speed makes slopes above 1, which leave losses below 0."""
    speed = 20.0 + 140.0 * np.abs(np.sin(0.3 * T))
    torque = 1.6e-4 * speed**1.7
    drawn = np.roll(torque * speed + 4.0 * torque**2 + 0.02 * speed + 1.0, 2)
    power = drawn - 0.05 * drawn.mean()
    columns = {'time_s': T, 'speed_rad_s': speed, 'torque (Nm)': torque, 'power (W)': power}
    _, lines = guessed(tmp_path, capsys, columns)
    assert 'scale: -1' not in lines['torque']
    assert 'positive: fed' not in lines['power']


def test_a_start_time_that_never_changes_is_no_time(tmp_path, capsys):
    rows = [f'12:00:05,{n:.3f},{m:.3f}' for n, m in zip(SPEED, TORQUE, strict=True)]
    log = tmp_path / 'log.csv'
    log.write_text('\n'.join(['started,FL_rpm,FL_Nm', *rows]))
    assert main([str(log), '--list']) == 0
    assert 'column: started' not in capsys.readouterr().out


@pytest.mark.parametrize(
    ('head', 'taken'), [('t_s,finger_rpm,i_mA,p_mW', 'power'), ('t_s,finger_rpm,i,p,U', 'current')]
)
def test_a_metered_power_goes_before_a_current_that_may_be_the_motors(
    tmp_path, capsys, head, taken
):
    """Unless a voltage shows that the current is of the same meter."""
    amps = 0.2 + 0.1 * np.sin(T)
    values = [T, SPEED, amps, 48 * amps, 48 + 1e-3 * NOISE]
    columns = dict(zip(head.split(','), values, strict=False))
    _, lines = guessed(tmp_path, capsys, columns)
    assert {'power', 'current'} & set(lines) == {taken}
