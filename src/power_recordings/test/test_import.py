import importlib.util
import json

import numpy as np
import pytest
from power_recordings.commands import import_logs
from power_recordings.commands.arguments import import_logs as main
from power_recordings.importing import sources
from power_recordings.reading.reader import Recording
from table_log import MAP, csv, run, table


def test_a_table_becomes_a_recording_in_si_units(tmp_path):
    assert run(csv(tmp_path / 'log.csv', table()), MAP, tmp_path / 'bag') == 0
    recording = Recording.open(tmp_path / 'bag')
    joints, drives = recording.joint_states(), recording.drive_supply()
    assert joints.names == drives.names == ('KNEE',)
    np.testing.assert_allclose(joints.position[25], 0.25 * 2 * np.pi, rtol=1e-5)  # a quarter turn
    np.testing.assert_allclose(joints.velocity[0], 0.25 * (2 * np.pi) ** 2, rtol=1e-5)
    np.testing.assert_allclose(joints.effort, 1.0)  # 2 A · 0.5 N·m/A
    np.testing.assert_allclose(drives.power, 24.0)
    np.testing.assert_array_equal(np.diff(joints.stamp_ns), 10_000_000)
    assert recording.card.robot == 'bench'
    assert recording.card.torque == {'KNEE': 'motor'}


def test_several_logs_follow_on_each_other(tmp_path):
    first, second = (csv(tmp_path / f'{n}.csv', table(100)) for n in 'ab')
    mapping = tmp_path / 'map.yaml'
    mapping.write_text(MAP)
    args = [str(first), str(second), '--map', str(mapping), '-o', str(tmp_path / 'bag')]
    assert main(args) == 0
    stamps = Recording.open(tmp_path / 'bag').joint_states().stamp_ns
    assert len(stamps) == 200
    assert (np.diff(stamps) > 0).all()
    assert np.diff(stamps).max() == 1_000_000_000


@pytest.mark.parametrize(('rows', 'part'), [(300, False), (3000, True)])
def test_only_a_part_is_checked_of_a_recording_of_over_twice_the_messages_that_are(
    tmp_path, capsys, monkeypatch, rows, part
):
    """300 joint states and 3 messages of their meter are checked whole, where 200 would do."""
    monkeypatch.setattr(import_logs, '_CHECKED', 200)
    csv(tmp_path / 'log.csv', table(rows))
    assert run(tmp_path / 'log.csv', MAP, tmp_path / 'bag') == 0
    assert ('checked: the first' in capsys.readouterr().out) == part


@pytest.mark.parametrize('ending', ['\n', '\r\n', '\r'])
@pytest.mark.parametrize('delimiter', [',', ';', '\t', ' '])
def test_delimited_text_is_read_in_any_dialect(tmp_path, ending, delimiter):
    rows = table(60)
    lines = [
        '# recorded by a bench',
        '# 2026-11-22',
        delimiter.join(['t', 'pos', 'vel', 'iq', 'i']),
    ]
    number = (lambda x: f'{x:.6g}'.replace('.', ',')) if delimiter == ';' else '{:.6g}'.format
    lines += [delimiter.join(number(x) for x in row) for row in rows]
    (tmp_path / 'log.csv').write_bytes(ending.join([*lines, '']).encode())
    assert run(tmp_path / 'log.csv', MAP, tmp_path / 'bag') == 0
    joints = Recording.open(tmp_path / 'bag').joint_states()
    np.testing.assert_allclose(joints.position[:, 0], 2 * np.pi * rows[:, 1], atol=1e-4)


def test_units_in_the_head_are_used_where_the_map_says_none(tmp_path):
    head = 'time [ms],a1 pos [deg],a1 torque [Nm],v [V],i [mA]'
    rows = np.stack([10.0 * np.arange(50), np.arange(50), *np.ones((2, 50)), np.full(50, 500)], 1)
    mapping = """
format: import/1
time: {column: time}
drives:
  A1:
    position: {from: a1 pos}
    torque: {from: a1 torque}
    voltage: {from: v}
    current: {from: i}
"""
    assert run(csv(tmp_path / 'log.csv', rows, head), mapping, tmp_path / 'bag') == 0
    recording = Recording.open(tmp_path / 'bag')
    np.testing.assert_allclose(recording.joint_states().position[45], np.pi / 4, rtol=1e-5)
    np.testing.assert_allclose(recording.drive_supply().current, 0.5)


def test_arrays_of_mat_hdf5_json_parquet_and_xlsx_files_are_columns(tmp_path):
    import h5py
    import pyarrow as pa
    from openpyxl import Workbook
    from pyarrow import feather, parquet
    from scipy.io import savemat

    rows = table(80)
    named = {n: rows[:, i] for i, n in enumerate(('t', 'pos', 'vel', 'iq', 'i'))}
    savemat(tmp_path / 'log.mat', {'data': named})
    with h5py.File(tmp_path / 'log.h5', 'w') as file:
        for name, values in named.items():
            file[f'data/{name}'] = values[None, :]
    (tmp_path / 'log.json').write_text(
        json.dumps({'data': {k: v.tolist() for k, v in named.items()}})
    )
    records = [dict(zip(named, map(float, row), strict=True)) for row in rows]
    (tmp_path / 'log.jsonl').write_text('\n'.join(json.dumps({'data': r}) for r in records))
    parquet.write_table(pa.table(named), tmp_path / 'log.parquet')
    feather.write_feather(pa.table(named), tmp_path / 'log.feather')
    book = Workbook()
    book.active.append(list(named))
    for row in rows.tolist():
        book.active.append(row)
    book.save(tmp_path / 'log.xlsx')
    for ending in ('mat', 'h5', 'json', 'jsonl', 'parquet', 'feather', 'xlsx'):
        mapping = MAP
        if ending in ('mat', 'h5', 'json', 'jsonl'):
            for name in named:
                mapping = mapping.replace(f'from: {name},', f'from: data.{name},')
            mapping = mapping.replace('column: t,', 'column: data.t,')
        out = tmp_path / ending
        assert run(tmp_path / f'log.{ending}', mapping, out) == 0, ending
        position = Recording.open(out).joint_states().position[:, 0]
        np.testing.assert_allclose(position, 2 * np.pi * rows[:, 1], rtol=1e-5, atol=1e-6)


def test_signals_of_several_topics_are_put_on_common_times(tmp_path, walk):
    source = walk(3.0)
    source.position[:] = np.sin(source.joint_time)
    source.velocity[:] = np.cos(source.joint_time)
    bag = source.write(tmp_path / 'source')
    mapping = """
format: import/1
time: {stamp: header}
drives:
  '*':
    position: {from: '/joint_states:position[*]', unit: rad}
    velocity: {from: '/joint_states:velocity[*]', unit: rad/s}
    torque: {from: '/joint_states:effort[*]', unit: N*m}
    command: {from: '/joint_commands:position[*]', unit: rad}
    voltage: {from: '/drive_supply:voltage[*]', unit: V}
    current: {from: '/drive_supply:current[*]', unit: A}
"""
    assert run(bag, mapping, tmp_path / 'bag') == 0
    was, now = Recording.open(bag), Recording.open(tmp_path / 'bag')
    for topic in ('joint_states', 'drive_supply', 'joint_commands'):
        before, after = getattr(was, topic)(), getattr(now, topic)()
        assert before.names == after.names
        np.testing.assert_array_equal(before.stamp_ns, after.stamp_ns)
    np.testing.assert_allclose(was.joint_states().position, now.joint_states().position, rtol=1e-6)
    np.testing.assert_array_equal(was.drive_supply().power, now.drive_supply().power)


@pytest.mark.parametrize(
    ('old', 'new', 'line'),
    [
        ('from: pos,', 'from: poss,', "drives.KNEE.position: no column 'poss'; there is pos"),
        ('unit: rev}', 'unit: V}', "drives.KNEE.position: unit 'V' is none of position"),
        ('unit: rpm}', 'unit: furlong}', "unit 'furlong' is none of velocity"),
        ('unit: rpm}', 'unit: blah}', "unit 'blah' of velocity is not known"),
        ('format: import/1', 'format: import/2', "format: expected 'import/1'"),
        ('at: motor', 'at: gear', "torque.at: expected 'joint', 'motor' or ''"),
        ('column: t,', 'column: time,', "time.column: no column 'time'"),
        ('from: vel,', 'from: vel, value: 3,', 'a signal has either from, sum or value'),
        ('    voltage: {value: 24, unit: V}\n', '', 'current without voltage'),
        ('scale: 0.5', 'scale: .nan', 'torque.scale: expected -1e+12 to 1e+12'),
    ],
)
def test_a_map_that_does_not_fit_is_refused_in_one_line_and_nothing_is_written(
    tmp_path, capsys, old, new, line
):
    log = csv(tmp_path / 'log.csv', table())
    assert old in MAP
    assert run(log, MAP.replace(old, new), tmp_path / 'bag') == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count('\n') == 1
    assert not (tmp_path / 'bag').exists()


def test_times_that_are_of_no_use_are_refused(tmp_path, capsys):
    for name, times, line in (
        ('nan', np.full(500, np.nan), 'no row with a time'),
        ('same', np.zeros(500), 'repeat the time of the row before'),
        ('mixed', np.random.default_rng(0).permutation(500) * 1.0, 'time goes back in'),
        ('late', np.arange(500) * 1e12, 'is that their unit?'),
        ('s', np.arange(500) * 0.01, 's would make 100: time: {unit: s}'),
        ('us', np.arange(500) * 1e4, 'us would make 100: time: {unit: us}'),
        ('ns', 1.7e18 + np.arange(500) * 1e7, 'times reach 1.7e+18 ms; is that their unit?'),
    ):
        rows = table()
        rows[:, 0] = times
        assert run(csv(tmp_path / f'{name}.csv', rows), MAP, tmp_path / name) == 2
        assert line in capsys.readouterr().err
        assert not (tmp_path / name).exists()


def test_what_was_left_out_is_said(tmp_path, capsys):
    rows = table()
    rows[10, 0] = rows[9, 0]
    rows[20, 0] = np.nan
    rows[300:, 0] -= 2500.0  # the log starts again
    assert run(csv(tmp_path / 'log.csv', rows), MAP, tmp_path / 'bag') == 0
    out = capsys.readouterr().out
    assert '1 rows without a time left out' in out
    assert '1 rows with the time of the row before merged with it (mean)' in out
    assert '2 parts: time goes back in 1 places' in out


def test_list_prints_columns_and_a_map_that_can_be_used_at_once(tmp_path, capsys):
    rows = table()
    head = 'time_ms,knee_pos,knee_vel,knee_torque,bus_current'
    rows[:, 3:] += rows[:, 1:2]
    log = csv(tmp_path / 'log.csv', np.c_[rows, 24 + rows[:, 1]], f'{head},bus_voltage')
    assert main([str(log), '--list']) == 0
    listed = capsys.readouterr().out
    assert 'knee_pos' in listed
    assert '  changes\n' in listed  # a table has one rate, that of its time
    assert run(log, listed, tmp_path / 'bag') == 0


def test_bags_of_ros_1_are_read(tmp_path):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    header, joints = store.types['std_msgs/msg/Header'], store.types['sensor_msgs/msg/JointState']
    battery, time = (
        store.types['sensor_msgs/msg/BatteryState'],
        store.types['builtin_interfaces/msg/Time'],
    )
    with Writer(tmp_path / 'log.bag') as bag:
        states = bag.add_connection('/joint_states', joints.__msgtype__, typestore=store)
        supply = bag.add_connection('/supply', battery.__msgtype__, typestore=store)
        for i in range(200):
            stamp = 1_600_000_000_000_000_000 + i * 10_000_000
            head = header(i, time(*divmod(stamp, 10**9)), '')
            state = joints(head, ['KNEE'], np.array([0.01 * i]), np.array([1.0]), np.array([2.0]))
            bag.write(states, stamp, store.serialize_ros1(state, joints.__msgtype__))
            empty = np.zeros(0, np.float32)
            message = battery(
                head, 24.0, 0.0, -2.0, *[0.0] * 3, 0.0, 0, 0, 0, True, empty, empty, '', ''
            )
            bag.write(supply, stamp, store.serialize_ros1(message, battery.__msgtype__))
    out = tmp_path / 'bag'
    assert main([str(tmp_path / 'log.bag'), '--map', 'wattwalk', '-o', str(out)]) == 0
    recording = Recording.open(out)
    np.testing.assert_allclose(recording.joint_states().effort, 2.0)
    np.testing.assert_allclose(recording.supply().power, 48.0)


def test_a_velocity_that_was_not_recorded_is_the_rate_of_the_position_and_said_to_be(
    tmp_path, capsys
):
    rows = table(40_000, 1000.0)
    mapping = MAP.replace('    velocity: {from: vel, unit: rpm}\n', '')
    assert run(csv(tmp_path / 'log.csv', rows), mapping, tmp_path / 'bag') == 0
    assert 'velocity is the rate of the position, not measured: KNEE' in capsys.readouterr().out
    recording = Recording.open(tmp_path / 'bag')
    velocity = recording.joint_states().velocity[:, 0]
    truth = 0.25 * (2 * np.pi) ** 2 * np.cos(2 * np.pi * rows[:, 0] / 1e3)
    np.testing.assert_allclose(velocity[10:-10], truth[10:-10], atol=0.01)
    assert np.isnan(velocity[[0, 9, -10, -1]]).all()
    assert recording.card.derived_velocity == ('KNEE',)


@pytest.mark.parametrize(
    ('ending', 'module'),
    [
        ('csv', 'pyarrow'),
        ('parquet', 'pyarrow'),
        ('xlsx', 'openpyxl'),
        ('h5', 'h5py'),
        ('hebilog', 'hebi'),
    ],
)
def test_a_library_that_is_missing_is_named_with_the_line_that_installs_it(
    tmp_path, capsys, monkeypatch, ending, module
):
    there = importlib.util.find_spec
    monkeypatch.setattr(sources, 'find_spec', lambda name: None if name == module else there(name))
    (tmp_path / f'log.{ending}').write_text('a,b\n1,2\n')
    assert main([str(tmp_path / f'log.{ending}'), '--list']) == 2
    error = capsys.readouterr().err
    assert f'reading it needs {module}: pip install' in error
    assert error.count('\n') == 1


def test_an_import_to_a_recording_that_exists_names_the_option_that_replaces_it(tmp_path, capsys):
    log = csv(tmp_path / 'log.csv', table())
    assert run(log, MAP, tmp_path / 'bag') == 0
    assert run(log, MAP, tmp_path / 'bag') == 2
    assert 'bag exists already: choose another name, or --overwrite' in capsys.readouterr().err
    (tmp_path / 'thesis').mkdir()
    assert run(log, MAP, tmp_path / 'thesis') == 2
    assert 'choose another name or remove it' in capsys.readouterr().err
