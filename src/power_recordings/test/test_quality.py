import json

import numpy as np
import pytest
from power_recordings.card import Card
from power_recordings.commands.arguments import import_logs as main
from power_recordings.commands.arguments import info as info
from power_recordings.messages.samples import DriveSamples, JointSamples
from power_recordings.quality.causes import OF_POWER, cause_of
from power_recordings.quality.check import check_recording
from power_recordings.quality.findings import power_finding
from power_recordings.quality.physics import factor_of, power_balance
from power_recordings.quality.refusal import refuse_wrong_units
from power_recordings.reading.reader import Recording
from table_log import MAP, csv, run, table
from wattwalk_core.errors import InputError


def test_wrong_units_are_found_by_physics_with_the_line_that_mends_them(tmp_path):
    rows = table(2000)
    rows[:, 3] = np.cos(3 * rows[:, 0] / 1e3)  # A
    torque, speed = 0.5 * rows[:, 3], rows[:, 2] * 2 * np.pi / 60
    rows[:, 4] = -(torque * speed + 2 * torque**2 + 1) / 24 * 1e3
    log = csv(tmp_path / 'log.csv', rows)
    for change, code, mend in (
        (('', ''), None, ''),
        (('unit: rpm', 'unit: rev/s'), 'velocity_units', 'velocity: {unit: rpm}'),
        (('unit: rev}', 'unit: rad}'), 'velocity_units', 'position: {unit: rev}'),
        (('scale: 0.5', 'scale: -0.5'), 'power_units', 'torque: {scale: 0.5}'),
        (('positive: fed', 'positive: drawn'), 'power_units', 'current: {positive: fed}'),
    ):
        run(log, MAP.replace(*change) if change[0] else MAP, tmp_path / 'bag', '--overwrite')
        errors = [
            f
            for f in check_recording(Recording.open(tmp_path / 'bag')).findings
            if f.severity == 'error'
        ]
        assert [f.code for f in errors][:1] == ([code] if code else [])
        if code:
            assert errors[0].mend == mend


@pytest.mark.parametrize(
    ('right', 'wrong', 'mend'),
    [
        (('rev', 'rpm'), ('rev', 'deg/s'), 'velocity: {unit: rpm}'),
        (('rev', 'rpm'), ('deg', 'rpm'), 'position: {unit: rev}'),
        (('deg', 'deg/s'), ('deg', 'rpm'), 'velocity: {unit: deg/s}'),
        (('deg', 'rad/s'), ('deg', 'deg/s'), 'velocity: {unit: rad/s}'),
        (('deg', 'rpm'), ('rev', 'rpm'), 'position: {unit: deg}'),
    ],
)
def test_a_finding_never_advises_what_the_map_has(tmp_path, right, wrong, mend):
    log = csv(tmp_path / 'log.csv', table(2000) * np.array([1.0, *_sizes(right), 1.0, 1.0]))
    mapping = MAP.replace('unit: rev}', f'unit: {wrong[0]}}}').replace(
        'unit: rpm', f'unit: {wrong[1]}'
    )
    assert run(log, mapping, tmp_path / 'bag') == 0
    (found,) = [f for f in checked(tmp_path / 'bag') if f.code == 'velocity_units']
    assert found.mend == mend


def _sizes(units):
    """Return what turns and rpm are in other units."""
    return [
        {'rev': 1.0, 'deg': 360.0, 'rpm': 1.0, 'deg/s': 6.0, 'rad/s': np.pi / 30}[u] for u in units
    ]


def test_units_are_named_by_the_factor_that_they_make(tmp_path):
    rows = table(2000)
    rows[:, 3] = np.cos(3 * rows[:, 0] / 1e3)  # A
    torque, speed = 0.5 * rows[:, 3], rows[:, 2] * 2 * np.pi / 60
    rows[:, 4] = -(torque * speed + 2 * torque**2 + 1) / 24 * 1e3
    for name, factor, expected in (
        ('degrees a second', (1, 360 / 60, 1), ('velocity_units', 'degrees per second')),
        ('degrees', (360, 1, 1), ('velocity_units', 'the position is in degrees')),
        ('the other way round', (1, -60 / 60, 1), ('velocity_units', 'its sign is wrong')),
        ('milliamperes', (1, 1, 1), ('power_units', 'current is in mA?')),
        ('amperes', (1, 1, 1e-3), ('power_units', 'current is in A or torque is in mN·m?')),
        ('fed', (1, 1, -1), ('power_units', "the meter's sign is wrong")),
    ):
        changed = rows.copy()
        changed[:, 1] *= factor[0]
        changed[:, 2] *= factor[1]
        changed[:, 4] *= factor[2]
        mapping = MAP
        if name == 'degrees a second':
            mapping = mapping.replace('unit: rpm', 'unit: rad/s')
        if name == 'milliamperes':
            mapping = mapping.replace('unit: mA', 'unit: A')
        if name == 'degrees':
            mapping = mapping.replace('unit: rev}', 'unit: rad}')
        log = csv(tmp_path / 'log.csv', changed)
        assert run(log, mapping, tmp_path / 'bag', '--overwrite') == 0
        errors = [f for f in checked(tmp_path / 'bag') if f.severity == 'error']
        assert [f.code for f in errors] == [expected[0]], name
        assert expected[1] in errors[0].text, name


@pytest.mark.parametrize('slope', [0.6e-3, 1e-3, 1.9e-3])
@pytest.mark.parametrize(
    ('stated', 'first'),
    [({'current': 'mA'}, {'current': 'A'}), ({'voltage': 'mV'}, {'voltage': 'V'}), ({}, None)],
)
def test_a_meter_that_reads_a_thousandth_is_suspected_before_the_torque(slope, stated, first):
    card = Card.of({'imported': {'units': {'KNEE': stated}}})
    cause = cause_of(slope, OF_POWER['current'], card, 'KNEE')
    torque = {'torque': 'mN*m'}
    assert [cause.units, *cause.others] == ([first, torque] if first else [torque])


def test_a_meter_is_suspected_by_its_size_where_its_power_hardly_follows_the_shaft():
    torque, speed = np.random.default_rng(3).normal(size=(2, 5000))
    balance = power_balance(1e-3 * (5 + 0 * speed), torque, 3 * speed)
    card = Card.of({'imported': {'units': {'KNEE': {'current': 'mA'}}}})
    found = power_finding('KNEE', balance, card)
    assert 'current is in A, or units of torque and speed?' in found.text


@pytest.mark.parametrize(
    ('at', 'entry', 'mend'),
    [
        ('joint', 'motor_current: {from: i, unit: A}', 'torque: {at: motor}'),
        ('motor', 'motor_current: {from: i, unit: A}', None),  # as the map says
        ('joint', 'current: {from: i, unit: A}', ''),
    ],
)
def test_a_torque_that_is_a_current_times_a_constant_is_no_measurement(tmp_path, at, entry, mend):
    rows = table(2000)
    rows[:, 4] = np.cos(3 * rows[:, 0] / 1e3)
    noise = 0.02 * np.random.default_rng(1).normal(size=len(rows))
    for torque, computed in ((0.3 * rows[:, 4], True), (0.3 * rows[:, 4] + noise, False)):
        rows[:, 3] = np.round(torque, 4)
        mapping = MAP.replace('{from: iq, scale: 0.5, from_unit: A, at: motor}', '{from: iq}')
        mapping = mapping.replace('{from: iq}', f'{{from: iq, unit: N*m, at: {at}}}')
        mapping = mapping.replace('current: {from: i, unit: mA, positive: fed}', entry)
        power = '    power: {from: pos, unit: W}\n' if 'motor' in entry else ''
        mapping = mapping.replace('card:', f'{power}card:')
        assert run(csv(tmp_path / 'log.csv', rows), mapping, tmp_path / 'bag', '--overwrite') == 0
        found = [f for f in checked(tmp_path / 'bag') if f.code == 'computed_torque']
        assert [f.mend for f in found] == ([mend] if computed and mend is not None else [])
        assert all('0.3 N·m for each A' in f.text for f in found)


def test_one_wrong_sample_or_two_levels_make_no_torque_of_a_current():
    random = np.random.default_rng(1)
    current = random.normal(size=2000)
    torque = 0.3 * current + 0.02 * random.normal(size=2000)
    current[7], torque[7] = 6000.0, 2000.0
    assert factor_of(torque, current) is None
    levels = np.repeat([1.0, 3.0], 1000)
    assert factor_of(0.3 * levels, levels) is None


def checked(bag):
    return check_recording(Recording.open(bag)).findings


def test_clipped_frozen_and_broken_signals_are_found(tmp_path, walk):
    def codes(change):
        source = walk(20.0)
        t = source.joint_time
        source.position[:] = np.sin(2 * np.pi * t)
        source.velocity[:] = 2 * np.pi * np.cos(2 * np.pi * t)
        source.effort[:] = np.sin(7 * t)
        source.current[:] = 2 + np.sin(np.arange(len(source.current)) / 50)[:, None]
        change(source)
        return {f.code for f in checked(source.write(tmp_path / change.__name__))}

    def nothing(source):
        pass

    def clipped_torque(source):
        source.effort[:] = np.clip(source.effort, -0.5, 0.5)

    def frozen_torque(source):
        source.effort[2000:3000] = source.effort[2000]

    def frozen_power(source):
        source.current[5000:8000] = 2.5

    def gaps(source):
        source.drop_supply(slice(5000, 9000))

    def set_back(source):
        source.joint_stamps[4000:] -= 2_000_000_000
        source.late = np.maximum.accumulate  # messages arrive in this order

    def two_clocks(source):
        source.supply_stamps += 3_600_000_000_000

    def late_power(source):
        source.drop_supply(slice(0, 10_000))

    def jitter(source):
        late = np.random.default_rng(0).integers(0, 2_400_000, len(source.joint_stamps))
        source.joint_stamps += late  # of a period of 2.5 ms

    usual = {'clipped', 'frozen', 'gaps', 'clock_step', 'two_clocks', 'coverage', 'jitter'}
    assert not codes(nothing) & usual
    for change, code in (
        (clipped_torque, 'clipped'),
        (frozen_torque, 'frozen'),
        (frozen_power, 'frozen'),
        (gaps, 'gaps'),
        (set_back, 'clock_step'),
        (two_clocks, 'two_clocks'),
        (late_power, 'coverage'),
        (jitter, 'jitter'),
    ):
        assert code in codes(change), code


def test_samples_missing_from_sequence_are_counted_with_a_way_to_record_them(
    tmp_path, walk, capsys
):
    source = walk(4.0)
    source.drop_supply(np.r_[100:110, 500:503, 2000])  # 14 samples in 3 gaps, too short to be seen
    bag = source.write(tmp_path / 'bag')
    assert info([str(bag), '--json', str(tmp_path / 'info.json')]) == 0
    said = capsys.readouterr().out
    assert 'drive_supply: 14 of 4000 samples are missing in 3 gaps of sequence' in said
    assert 'docs/rosbag2_qos.yaml' in said
    assert 'zstd_fast' in said
    (found,) = json.loads((tmp_path / 'info.json').read_text()).values()
    assert found['lost'] == {'drive_supply': {'samples': 14, 'gaps': 3}}


def test_a_whole_sequence_and_one_that_starts_anew_have_no_loss(tmp_path, walk):
    whole, anew = walk(2.0), walk(2.0)
    anew.sequence[1000:] -= 900
    for name, source in (('whole', whole), ('anew', anew)):
        assert 'lost' not in {f.code for f in checked(source.write(tmp_path / name))}


def test_a_torque_that_is_a_current_is_shown_as_one(tmp_path, capsys):
    mapping = MAP.replace('scale: 0.5, from_unit: A', 'unit: A')
    assert run(csv(tmp_path / 'log.csv', table()), mapping, tmp_path / 'bag') == 0
    out = capsys.readouterr().out
    assert 'torque A' in out
    assert 'motor A' in out


def test_a_table_faster_than_its_meter_is_found_slow(tmp_path):
    rows = table(3000)
    rows[:, 4] = -np.repeat(np.random.default_rng(1).normal(1e3, 100, 60), 50)  # 2 Hz
    run(csv(tmp_path / 'log.csv', rows), MAP, tmp_path / 'bag')
    quality = check_recording(Recording.open(tmp_path / 'bag'))
    assert 'slow_power' in [f.code for f in quality.findings]
    assert quality.drives['KNEE'].updates_hz == pytest.approx(2, abs=0.5)


def test_the_robots_power_is_set_against_the_sum_of_its_drives(tmp_path):
    rows = table()
    rows[:, 4] = -1e3 * np.linspace(0.5, 1.5, len(rows))  # mA at 24 V
    robot = 1.1 * 24 * -rows[:, 4] / 1e3 + 7.0
    log = csv(tmp_path / 'a.csv', np.column_stack([rows, robot / 24]), 't,pos,vel,iq,i,all')
    chart = tmp_path / 'map.yaml'
    supply = (
        'supply: {voltage: {value: 24, unit: V}, current: {from: all, unit: A, positive: drawn}}'
    )
    chart.write_text(MAP + supply)
    assert main([str(log), '--map', str(chart), '-o', str(tmp_path / 'bag')]) == 0
    line = check_recording(Recording.open(tmp_path / 'bag')).supply
    assert (line.slope, line.offset) == pytest.approx((1.1, 7.0), rel=1e-2)
    assert line.r2 == pytest.approx(1.0, abs=1e-4)


def test_wrong_units_of_a_long_recording_are_refused_by_the_stretch_that_moves_most():
    time = np.arange(0, 400.0, 0.01)
    stamps = (time * 1e9).astype(np.int64)
    moves = (time > 250) & (time < 350)
    velocity = np.where(moves, 2.0 * np.cos(3 * time), 0.0)[:, None]
    position = np.cumsum(velocity, axis=0) * 0.01
    torque = 5.0 * np.sin(1.7 * time)[:, None]
    size = len(time)

    def recording(scale):
        joints = JointSamples(stamps, ('KNEE',), *np.float32([position * scale, velocity, torque]))
        voltage = np.full((size, 1), 48.0, np.float32)
        power = torque * velocity + 0.05 * torque**2 + 8.0
        index = np.arange(size, dtype=np.uint64)
        still = np.full((size, 1), np.nan, np.float32)
        flags = np.zeros((size, 1), np.uint8)
        current = (power / 48.0).astype(np.float32)
        electric = DriveSamples(stamps, ('KNEE',), index, index, voltage, current, still, flags)
        return Recording.in_memory('log', {'joint_states': joints, 'drive_supply': electric})

    refuse_wrong_units(recording(1.0))
    with pytest.raises(InputError, match='KNEE'):
        refuse_wrong_units(recording(1.0 / (2 * np.pi)))
