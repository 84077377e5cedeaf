"""The benchmark of logs of real drives: lines edited and the expert's regression."""

import drive_logs
import numpy as np
import pytest
import real_drives
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.importing.map_file import parse_map

USED = {
    'format': 'import/1',
    'time': {'column': 't', 'unit': 's'},
    'drives': {
        'A': {
            'velocity': {'from': 'w', 'unit': 'rpm'},
            'torque': {'from': 'cell', 'unit': 'N*m', 'at': 'joint'},
            'voltage': {'from': 'u', 'unit': 'V'},
            'current': {'from': 'i', 'unit': 'A'},
        }
    },
}


def edited(**changes):
    drive = {**USED['drives']['A'], **changes}
    guess = {**USED, 'drives': {'OTHER': {'velocity': {'from': 'x'}}, 'B': drive}}
    return real_drives.edited(parse_map(guess, 'guess'), parse_map(USED, 'used'))


def test_the_same_map_with_other_names_and_spellings_takes_no_edit():
    assert edited() == 0
    assert edited(torque={'from': 'cell', 'unit': 'Nm'}) == 0


@pytest.mark.parametrize(
    'changed',
    [
        {'velocity': {'from': 'w', 'unit': 'rad/s'}},
        {'torque': {'from': 'cell', 'unit': 'N*mm'}},
        {'torque': {'from': 'cell', 'unit': 'N*m', 'at': 'motor'}},
        {'current': {'from': 'i', 'unit': 'A', 'positive': 'fed'}},
        {'current': {'from': 'phase', 'unit': 'A'}},
    ],
)
def test_another_column_unit_sign_or_side_is_one_line(changed):
    assert edited(**changed) == 1


def test_the_regression_of_an_expert_finds_the_factor_of_the_shaft():
    t = np.arange(400) / 100.0
    torque, speed = 2 + np.sin(7 * t), 5 + 3 * np.cos(3 * t)
    power = 1.5 * torque * speed + 0.2 * torque**2 + 3.0
    data = AlignedDataset.blank(
        100.0, ('A',), t, 'made up', torque=torque[:, None], velocity=speed[:, None],
        power=power[:, None],
    )  # fmt: skip
    assert real_drives.expert(data) == '1.000 (a 1.50)'


def test_absent_logs_are_a_row_with_the_reason(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(drive_logs, 'LOGS', tmp_path)
    monkeypatch.setattr('sys.argv', ['real_drives.py', 'hopper', '--no-write'])
    assert real_drives.main() == 0
    assert 'not read: ' in capsys.readouterr().out
