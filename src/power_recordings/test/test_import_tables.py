"""Tables as benches and loggers write them: heads, encodings, times and rows of other shapes."""

import numpy as np
import pytest
from power_recordings.alignment.align import load_aligned
from power_recordings.commands.arguments import import_logs as main
from power_recordings.importing.sources.delimited import DelimitedFile
from power_recordings.reading.reader import Recording
from table_log import csv, run

BENCH = """
format: import/1
time: {column: t, unit: s}
drives:
  KNEE:
    velocity: {from: w, unit: rad/s}
    torque: {from: trq, unit: N*m, at: joint}
    voltage: {value: 24, unit: V}
    current: {from: i, unit: A}
"""
HEAD = 't,w,trq,i'


def bench(rows=600, rate=100.0):
    t = np.arange(rows) / rate
    return np.stack([t, 5 + np.sin(t), 2 + np.cos(t), 1 + 0.1 * np.sin(3 * t)], axis=1)


def lines(rows, head=HEAD, end=''):
    text = [','.join('' if np.isnan(x) else f'{x:.9g}' for x in row) + end for row in rows]
    return '\n'.join([head, *text, ''])


def imported(folder, text, mapping=BENCH, encoding='utf8'):
    (folder / 'log.csv').write_bytes(text.encode(encoding))
    assert run(folder / 'log.csv', mapping, folder / 'bag') == 0
    return Recording.open(folder / 'bag')


@pytest.mark.parametrize(('head', 'end'), [(f'{HEAD},', ''), (HEAD, ','), (f'{HEAD},', ',')])
def test_a_delimiter_at_the_end_of_the_head_or_of_the_rows_moves_no_name(tmp_path, head, end):
    recording = imported(tmp_path, lines(bench(), head, end))
    np.testing.assert_allclose(recording.joint_states().effort[:, 0], bench()[:, 2], rtol=1e-5)


def test_a_head_of_fewer_names_than_values_is_refused(tmp_path, capsys):
    (tmp_path / 'log.csv').write_text(lines(bench(), 't,w,trq'))
    assert run(tmp_path / 'log.csv', BENCH, tmp_path / 'bag') == 2
    assert 'its head names 3 columns, its rows have 4 values' in capsys.readouterr().err
    assert not (tmp_path / 'bag').exists()


def test_rows_of_units_and_dates_about_the_names_are_no_rows_of_values(tmp_path):
    head = '2019-05-11 15:22:21.215\nt, w, trq, i\ns, rad.s, N.mm, mA\n2019-05-11,,,'
    mapping = (
        BENCH.replace(', unit: rad/s', '').replace(', unit: N*m', '').replace(', unit: A', '')
    )
    recording = imported(tmp_path, lines(bench(), head), mapping)
    assert len(recording.joint_states()) == 600
    effort = recording.joint_states().effort[:, 0]
    np.testing.assert_allclose(effort, bench()[:, 2] / 1e3, rtol=1e-5)
    np.testing.assert_allclose(recording.drive_supply().current[0, 0], 1e-3, rtol=1e-5)


@pytest.mark.parametrize(
    ('encoding', 'name'),
    [
        ('utf-8-sig', 'Drehmoment [N·m]'),
        ('latin-1', 'Drehmoment [N·m]'),
        ('gb18030', '扭矩 [N·m]'),
        ('utf-16', '扭矩 [N·m]'),
    ],
)
def test_heads_in_other_encodings_keep_their_letters(tmp_path, encoding, name):
    head = f'Zeit [s],w,{name},T (°C)' if encoding != 'gb18030' else f'时间 [s],w,{name},T (℃)'
    (tmp_path / 'log.csv').write_bytes(lines(bench(), head).encode(encoding))
    columns = DelimitedFile(tmp_path / 'log.csv').columns()
    assert columns[2].address == name
    assert (columns[2].unit, columns[3].unit) == ('N·m', head[-3:-1].strip('('))


def test_readings_that_an_instrument_has_not_count_as_missing(tmp_path):
    rows = bench()
    rows[100:104, 2] = 9.91e37
    effort = imported(tmp_path, lines(rows)).joint_states().effort[:, 0]
    assert np.isnan(effort[100:104]).all()
    assert np.isfinite(np.delete(effort, range(100, 104))).all()


def test_torque_in_few_rows_is_taken_there_and_power_in_all(tmp_path, capsys):
    rows = bench(1000)
    rows[np.arange(1000) % 20 != 0, 2] = np.nan  # 5 Hz
    recording = imported(tmp_path, lines(rows))
    joints, drives = recording.joint_states(), recording.drive_supply()
    np.testing.assert_array_equal(np.diff(joints.stamp_ns), 200_000_000)
    assert np.isfinite(joints.effort).all()
    np.testing.assert_allclose(joints.velocity[:, 0], rows[::20, 1], rtol=1e-5)
    assert len(drives) == 1000
    assert "'trq' has a value in 5.0% of the rows" in capsys.readouterr().out


def test_topics_that_take_turns_in_the_rows_of_a_table_are_put_together(tmp_path):
    rows = bench(900)
    turn = np.arange(900) % 3
    for column, own in ((1, 0), (2, 1), (3, 2)):
        rows[turn != own, column] = np.nan
    joints = imported(tmp_path, lines(rows)).joint_states()
    inner = slice(2, -2)
    assert np.isfinite(joints.velocity[inner]).all()
    assert np.isfinite(joints.effort[inner]).all()
    t = (joints.stamp_ns[inner] - joints.stamp_ns[0]) / 1e9 + (0.01 if turn[0] else 0.0)
    np.testing.assert_allclose(joints.effort[inner, 0], 2 + np.cos(t), atol=0.02)


def test_rows_of_one_time_become_their_mean(tmp_path, capsys):
    rows = bench(600)
    rows[:, 0] = np.arange(600) // 2 * 0.02  # a clock of half the rate
    recording = imported(tmp_path, lines(rows))
    np.testing.assert_array_equal(np.diff(recording.joint_states().stamp_ns), 20_000_000)
    mean = rows[:, 2].reshape(-1, 2).mean(axis=1)
    np.testing.assert_allclose(recording.joint_states().effort[:, 0], mean, rtol=1e-5)
    assert (
        '300 rows with the time of the row before merged with it (mean)' in capsys.readouterr().out
    )


def test_a_clock_of_seconds_is_refused_with_the_rate_to_give(tmp_path, capsys):
    rows = bench(1001)
    rows[:, 0] = np.floor(rows[:, 0])
    (tmp_path / 'log.csv').write_text(lines(rows))
    assert run(tmp_path / 'log.csv', BENCH, tmp_path / 'bag') == 2
    assert (
        'repeat the time of the row before; give the rate of the rows' in capsys.readouterr().err
    )
    mapping = BENCH.replace('{column: t, unit: s}', '{rate: 100}')
    assert run(tmp_path / 'log.csv', mapping, tmp_path / 'bag') == 0


def test_rows_out_of_order_are_left_out_and_a_restart_goes_on(tmp_path, capsys):
    rows = bench(600)
    rows[200, 0] -= 0.015
    rows[400:, 0] -= 4.0
    recording = imported(tmp_path, lines(rows))
    out = capsys.readouterr().out
    assert '1 rows older than the row before left out' in out
    assert '2 parts: time goes back in 1 places' in out
    assert (np.diff(recording.joint_states().stamp_ns) > 0).all()


def test_seconds_and_nanoseconds_in_two_columns_are_added_without_loss(tmp_path):
    stamps = 1_700_000_000_123_456_789 + 10_000_000 * np.arange(600)
    text = '\n'.join(
        ['sec,nsec,w,trq,i']
        + [
            f'{s // 10**9},{s % 10**9},{w:.9g},{m:.9g},{i:.9g}'
            for s, (_, w, m, i) in zip(stamps.tolist(), bench().tolist(), strict=True)
        ]
    )
    columns = '{columns: [{from: sec, unit: s}, {from: nsec, unit: ns}]}'
    recording = imported(tmp_path, text, BENCH.replace('{column: t, unit: s}', columns))
    np.testing.assert_array_equal(recording.joint_states().stamp_ns, stamps)


def test_steps_of_a_loop_without_a_fixed_rate_are_no_gaps(tmp_path):
    rng = np.random.default_rng(1)
    rows = bench(2000)
    rows[:, 0] = np.cumsum(rng.choice([0.009, 0.011, 0.02, 0.029], 2000, p=[0.3, 0.4, 0.2, 0.1]))
    rows[1500:, 0] += 0.3  # a gap that is one
    imported(tmp_path, lines(rows))
    data = load_aligned([tmp_path / 'bag'], rate=50.0)
    assert len(list(data.segments())) == 2
    assert len(data.time) / 50.0 > 0.95 * (rows[-1, 0] - 0.3)


def test_both_sides_of_a_gear_are_kept(tmp_path):
    rows = np.c_[bench(), 3 * bench()[:, 2]]
    mapping = BENCH.replace(
        '    velocity: {from: w, unit: rad/s}',
        '    gear_ratio: 7.2\n    velocity: {from: w, unit: rad/s, at: motor}\n'
        '    motor_current: {from: iq, unit: A}',
    )
    recording = imported(tmp_path, lines(rows, 't,w,trq,i,iq'), mapping)
    np.testing.assert_allclose(
        recording.joint_states().velocity[:, 0], rows[:, 1] / 7.2, rtol=1e-5
    )
    np.testing.assert_allclose(recording.motor_current().current[:, 0], rows[:, 4], rtol=1e-5)
    assert recording.card.gear_ratio == {'KNEE': 7.2}
    data = load_aligned([recording], rate=50.0)
    np.testing.assert_allclose(data.motor_current, 3 * data.torque, rtol=1e-4)
    assert data.drives(['KNEE']).motor_current.shape == data.power.shape
    both = load_aligned([recording, recording], rate=50.0)
    assert both.motor_current.shape == both.power.shape
    assert data.rows(slice(5)).motor_current.shape == (5, 1)


@pytest.mark.parametrize('comment', ['# units: ms, rpm, N*mm, mA', '% [ms], [rpm], [N*mm], [mA]'])
def test_units_in_a_comment_above_the_head_are_those_of_its_columns(tmp_path, comment):
    (tmp_path / 'log.csv').write_text(f'# bench, 2, b, 1\n{comment}\n{lines(bench())}')
    head = DelimitedFile(tmp_path / 'log.csv').dialect.head
    assert head.names == tuple(HEAD.split(','))
    assert head.units == ('ms', 'rpm', 'N*mm', 'mA')


COMMON = """
format: import/1
time: {column: t, unit: s}
drives:
  KNEE: {velocity: {from: w, unit: rad/s}, torque: {from: trq, unit: N*m}}
  HIP:
    velocity: {from: w, unit: rad/s}
    torque: {from: trq, unit: N*m}
    temperature: {from: warm, unit: degC}
supply: {voltage: {value: 24, unit: V}, current: {from: i, unit: A}}
"""


def test_a_winding_temperature_of_a_drive_on_a_common_meter_is_kept(tmp_path):
    rows = np.c_[bench(), 30 + bench()[:, 0]]
    recording = imported(tmp_path, lines(rows, f'{HEAD},warm'), COMMON)
    assert not recording.has('drive_supply')
    assert recording.motor_temperature().names == ('HIP',)
    data = load_aligned([recording], rate=50.0, need_power=False)
    assert np.isnan(data.temperature[:, 0]).all()
    np.testing.assert_allclose(
        data.temperature[:, 1], 30 + data.time - recording.start_ns / 1e9, atol=0.01
    )


def test_a_winding_temperature_beside_drives_with_meters_of_their_own_is_kept(tmp_path):
    metered = """
  KNEE:
    velocity: {from: w, unit: rad/s}
    torque: {from: trq, unit: N*m}
    temperature: {from: cool, unit: degC}
    voltage: {value: 24, unit: V}
    current: {from: i, unit: A}
"""
    rows = np.c_[bench(), 30 + bench()[:, 0], 20 + bench()[:, 0]]
    mapping = COMMON.replace(COMMON.splitlines(keepends=True)[4], metered.lstrip('\n'))
    recording = imported(tmp_path, lines(rows, f'{HEAD},warm,cool'), mapping)
    data = load_aligned([recording], rate=50.0)
    since = data.time - recording.start_ns / 1e9
    expected = np.stack([20 + since, 30 + since], axis=1)
    np.testing.assert_allclose(data.temperature, expected, atol=0.15)  # a value each 0.1 s


def test_a_power_of_products_is_marked_as_computed(tmp_path):
    rows = np.c_[bench(), 10 + bench()[:, 1], bench()[:, 2]]
    mapping = BENCH.replace(
        'current: {from: i, unit: A}',
        'power: {sum: [[vq, iq], [w, trq]], scale: 1.5, unit: W, computed: true}',
    )
    recording = imported(tmp_path, lines(rows, 't,w,trq,i,vq,iq'), mapping)
    expected = 1.5 * (rows[:, 4] * rows[:, 5] + rows[:, 1] * rows[:, 2])
    np.testing.assert_allclose(recording.drive_supply().power[:, 0], expected, rtol=1e-5)
    assert recording.card.power == {'KNEE': 'computed'}
    assert load_aligned([recording]).computed_power == {'KNEE'}


def test_operating_points_are_aligned_as_they_are_in_any_order(tmp_path):
    rng = np.random.default_rng(2)
    rows = bench(120)
    rows[:, 1:] = rng.uniform(1, 50, (120, 3))
    rows[7, 2] = np.nan
    mapping = BENCH.replace('{column: t, unit: s}', '{steady: true}')
    recording = imported(tmp_path, lines(rows), mapping)
    assert recording.card.steady
    data = load_aligned([recording], rate=50.0)
    kept = np.delete(rows, 7, axis=0)
    assert data.steady
    np.testing.assert_allclose(data.torque[:, 0], kept[:, 2], rtol=1e-6)
    np.testing.assert_allclose(data.power[:, 0], 24 * kept[:, 3], rtol=1e-6)
    np.testing.assert_allclose(np.diff(data.time), 0.02, rtol=1e-4)


@pytest.mark.parametrize(
    ('entry', 'column', 'drawn'),
    [
        ("efficiency: {from: eta, unit: '%'}", [80, 50, 80, 0], [250, 200, -80]),
        ('efficiency: {from: eta}', [0.8, 0.5, 0.8, 1.1], [250, 200, -80]),
        ('loss: {from: eta, unit: W}', [50, 100, 20, 0], [250, 200, -80]),
    ],
)
def test_an_efficiency_or_a_loss_stands_for_the_power(tmp_path, entry, column, drawn):
    torque, speed = np.array([2, 1, -1, 1.0]), np.array([100, 100, 100, 100.0])
    rows = np.stack([speed, torque, column], axis=1)
    log = csv(tmp_path / 'map.csv', np.vstack([rows] * 3), 'w,m,eta')
    mapping = tmp_path / 'map.yaml'
    mapping.write_text(
        'format: import/1\ntime: {steady: true}\ndrives:\n  A:\n'
        '    velocity: {from: w, unit: rad/s}\n    torque: {from: m, unit: N*m}\n'
        f'    voltage: {{value: 50, unit: V}}\n    {entry}\n'
    )
    assert main([str(log), '--map', str(mapping), '-o', str(tmp_path / 'bag')]) == 0
    recording = Recording.open(tmp_path / 'bag')
    np.testing.assert_allclose(recording.drive_supply().power[:3, 0], drawn, rtol=1e-5)
    assert len(recording.drive_supply()) == (12 if 'loss' in entry else 9)  # no share is 0 or 1.1
    assert 'm × w' in recording.card.imported['columns']['A']['power']


def test_an_efficiency_needs_torque_and_velocity_and_no_power_beside(tmp_path, capsys):
    log = csv(tmp_path / 'map.csv', np.ones((9, 3)), 'w,m,eta')
    begin = 'format: import/1\ntime: {steady: true}\ndrives:\n  A:\n    velocity: {from: w}\n'
    mapping = tmp_path / 'map.yaml'
    for rest, told in (
        ('    efficiency: {from: eta}\n', 'efficiency without torque and velocity'),
        (
            '    torque: {from: m}\n    efficiency: {from: eta}\n    power: {from: eta}\n',
            'give one of efficiency, power',
        ),
    ):
        mapping.write_text(begin + rest)
        assert main([str(log), '--map', str(mapping), '-o', str(tmp_path / 'bag')]) == 2
        assert told in capsys.readouterr().err
