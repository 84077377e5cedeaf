"""The library of drives is what the public logs give."""

import drive_logs
import make_drives
import numpy as np
import pytest
from power_lab.drives.library import FOLDER, load_drive, names
from wattwalk_core.errors import InputError
from wattwalk_core.yaml_file import read_yaml


def numbers(content, *, of_intervals, inside=False):
    """Numbers of a file in order: those of its intervals, which are drawn, or all others."""
    if isinstance(content, dict):
        parts = [(each, inside or key == 'interval') for key, each in content.items()]
    elif isinstance(content, list):
        parts = [(each, inside) for each in content]
    else:
        return [content] if isinstance(content, float) and inside is of_intervals else []
    return [n for each, own in parts for n in numbers(each, of_intervals=of_intervals, inside=own)]


def test_every_drive_has_its_recipe():
    assert set(names()) == set(make_drives.RECIPES)


@pytest.mark.parametrize('name', make_drives.RECIPES)
def test_a_drive_is_made_again_from_its_logs(name, tmp_path):
    try:
        make_drives.make(name, tmp_path)
    except InputError as error:
        if 'is absent' not in str(error):
            raise
        pytest.skip(str(error))
    for file in ('model.yaml', 'drive.yaml'):
        made, kept = (read_yaml(at / name / file, 'drive') for at in (tmp_path, FOLDER))
        for of_intervals, far in ((False, 0.02), (True, 0.2)):
            own, other = (numbers(one, of_intervals=of_intervals) for one in (made, kept))
            np.testing.assert_allclose(own, other, rtol=far, atol=0.02)
    assert load_drive(name).card.findings == tuple(made['findings'])


def test_absent_logs_are_told(monkeypatch, tmp_path):
    monkeypatch.setattr(drive_logs, 'LOGS', tmp_path)
    with pytest.raises(InputError, match='WATTWALK_REAL_DATA says where logs lie'):
        make_drives.make('mn8014_sspg_7', tmp_path)
