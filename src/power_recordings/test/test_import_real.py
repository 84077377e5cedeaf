"""Logs of real drives that others published, where they lie beside the checkout."""

import numpy as np
import pytest
from power_recordings.commands.arguments import import_logs as main
from power_recordings.quality.check import check_recording
from power_recordings.reading.reader import Recording
from real_logs import HOPPER, REAL

pytestmark = pytest.mark.skipif(
    not REAL.is_dir(), reason='the public logs of real drives are not beside the checkout'
)

UR = ['ur3e_L0L1.csv', 'ur3e_L1L2.csv', 'ur3e_L2L3.csv', 'ur3e_L3L4.csv', 'ur3e_L4L5.csv']


def imported(log, mapping, folder):
    if log.endswith('.hebilog'):
        pytest.importorskip('hebi', reason='hebi-py is not installed')
    (folder / 'map.yaml').write_text(HOPPER)
    chosen = mapping or str(folder / 'map.yaml')
    assert main([str(REAL / log), '--map', chosen, '-o', str(folder / 'bag')]) == 0
    return Recording.open(folder / 'bag')


@pytest.mark.parametrize(
    ('log', 'mapping', 'drives', 'samples', 'rate', 'topic'),
    [
        ('hopper_500_hops.mat', '', 2, 20054, 50, 'drive_supply'),
        ('hopper_square.mat', '', 2, 451, 50, 'drive_supply'),
        ('yu_cobot.parquet', 'voraus', 6, 398, 99.3, 'drive_supply'),
        ('ur3e_move.xlsx', 'ur_rtde', 6, 888, 25, 'supply'),
        *((log, 'ur_rtde', 6, None, 25, 'supply') for log in UR),
        ('hebi_x.hebilog', 'hebi', 1, 999, 100, 'drive_supply'),
    ],
)
def test_real_logs_are_imported_and_found_fit_to_be_judged(
    tmp_path, log, mapping, drives, samples, rate, topic
):
    recording = imported(log, mapping, tmp_path)
    quality = check_recording(recording)
    assert len(recording.joint_states().names) == drives
    assert samples in (None, len(getattr(recording, topic)()))
    assert quality.topics['joint_states'].rate == pytest.approx(rate, rel=0.01)
    assert not [f for f in quality.findings if f.severity == 'error']
    assert set(recording.card.torque.values()) == {'motor'}
    moving = [d for d in quality.drives.values() if np.ptp(d.velocity_range) > 0.1]
    assert moving
    for drive in moving:
        slope = drive.velocity_slope  # NaN of logs that are too short to tell
        assert np.isnan(slope) or slope == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize(
    ('was', 'wrong', 'code', 'mend'),
    [
        ('motor_pos.*, unit: rev', 'motor_pos.*, unit: rad', 'velocity_units', 'position'),
        ('unit: rev/s', 'unit: rad/s', 'velocity_units', 'velocity: {unit: rev/s}'),
        ('unit: rev/s', 'unit: rpm', 'velocity_units', 'velocity: {unit: rev/s}'),
        ('0.02506', '-0.02506', 'power_units', 'torque: {scale: 0.02506}'),
        (
            'bus_current.*, unit: A',
            'bus_current.*, unit: kA',
            'units',
            'current: {unit: mA}',
        ),
    ],
)
def test_a_wrong_unit_in_the_map_of_the_hopper_is_found(tmp_path, was, wrong, code, mend):
    assert was in HOPPER
    (tmp_path / 'map.yaml').write_text(HOPPER.replace(was, wrong))
    log, mapping = REAL / 'hopper_500_hops.mat', tmp_path / 'map.yaml'
    assert main([str(log), '--map', str(mapping), '-o', str(tmp_path / 'bag')]) == 0
    errors = [
        f
        for f in check_recording(Recording.open(tmp_path / 'bag')).findings
        if f.severity == 'error'
    ]
    assert errors[0].code == code
    assert errors[0].mend.startswith(mend)


def test_the_effort_of_a_spring_is_no_torque_that_draws_power(tmp_path):
    pytest.importorskip('hebi', reason='hebi-py is not installed')
    from power_recordings.importing.map_file import MAPS

    text = (MAPS / 'hebi.yaml').read_text()
    assert 'motor_winding_current.*, unit: A, at: motor' in text
    effort = text.replace('motor_winding_current.*, unit: A, at: motor', 'effort.*, unit: N*m')
    (tmp_path / 'map.yaml').write_text(effort)
    log, mapping = REAL / 'hebi_x.hebilog', tmp_path / 'map.yaml'
    assert main([str(log), '--map', str(mapping), '-o', str(tmp_path / 'bag')]) == 0
    quality = check_recording(Recording.open(tmp_path / 'bag'))
    assert 'torque_unrelated' in [f.code for f in quality.findings]


def test_several_moves_of_one_arm_become_one_recording(tmp_path):
    logs = [str(REAL / log) for log in UR]
    assert main([*logs, '--map', 'ur_rtde', '-o', str(tmp_path / 'bag')]) == 0
    recording = Recording.open(tmp_path / 'bag')
    stamps = recording.supply().stamp_ns
    assert (np.diff(stamps) > 0).all()
    assert (np.diff(stamps) > 5e8).sum() == len(UR) - 1  # a pause between two logs
    assert recording.card.other['imported']['from'] == UR


@pytest.mark.parametrize(
    ('log', 'name'),
    [('ur3e_L0L1.csv', 'ur_rtde'), ('yu_cobot.parquet', 'voraus'), ('hebi_x.hebilog', 'hebi')],
)
def test_list_names_the_ready_map_that_fits(capsys, log, name):
    if log.endswith('.hebilog'):
        pytest.importorskip('hebi', reason='hebi-py is not installed')
    assert main([str(REAL / log), '--list']) == 0
    assert f'# the ready map {name} fits: --map {name}' in capsys.readouterr().out
