"""The network that is installed with the package."""

from pathlib import Path

import pytest
from power_estimator.network.checkpoint import SHIPPED, Checkpoint
from wattwalk_core.errors import InputError

BAGS = Path(__file__).resolve().parents[3] / 'bags'


def test_a_shipped_network_goes_by_its_name_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Checkpoint.load(Path('ppn_small')).networks
    with pytest.raises(InputError, match=r'ppn_smal: there is no such .*shipped: ppn_small'):
        Checkpoint.load(Path('ppn_smal'))


def test_the_shipped_network_is_the_one_of_the_checkout():
    run = BAGS / 'ppn_small' / 'model.safetensors'
    assert (SHIPPED / 'ppn_small.safetensors').read_bytes() == run.read_bytes()
