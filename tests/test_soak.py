"""Acquisition with faults for 40 s: every sample is recorded or counted as lost."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SOAK = Path(__file__).parents[1] / 'bench' / 'soak.py'


@pytest.mark.xdist_group('live')
def test_through_every_fault_each_sample_is_recorded_or_counted_as_lost(tmp_path):
    done = subprocess.run(
        [sys.executable, SOAK, '--seconds', '40', '-o', tmp_path / 'soak'],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((tmp_path / 'soak' / 'soak.json').read_text())
    assert found['closes']
    assert {event['what'] for event in found['events']} >= {
        *('bus off', 'recorder killed', 'supply unplugged', 'disk filled'),
        *('clock +1.5 s', 'clock -0.7 s'),
    }
    assert [bag['ended'] for bag in found['bags']] == [
        *('killed', 'stopped', 'disk full', 'stopped')
    ]
    assert int(found['nodes']['daq']['times opened']) >= 2
    assert int(found['nodes']['supply']['connections']) >= 2
    assert int(found['nodes']['daq']['steps of the system clock']) >= 4
    for stream in ('electrical', 'joints', 'supply'):
        account = found['streams'][stream]
        assert account['recorded'] > 0
        assert account['unaccounted'] == 0
        assert all(count >= 0 for count in account['rows'].values())
        assert any('what the recorder counted' in c['name'] for c in account['checks'])
        assert account['rows']['no recorder ran'] > 0
    for stream in ('electrical', 'joints'):
        rows = found['streams'][stream]['rows']
        assert rows['bus off'] > 0
        assert rows['lost on the wire'] == 0
        assert rows['stamps not trusted yet'] > 0
