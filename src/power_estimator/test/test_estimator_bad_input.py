"""Recordings that cannot be learned from: train names recording and field in one line."""

import numpy as np
import pytest
from power_estimator.commands.arguments import train as train_command

DRIVES = ('LF_HAA', 'LF_HFE')
HFE = 1
LONG = 37.0  # s, enough for the protocol


def multiply(name, factor, column=HFE):
    def spoil(arrays):
        arrays[name][:, column] *= factor

    return spoil


def fill(name, value, column=HFE, rows=slice(None)):
    def spoil(arrays):
        arrays[name][rows, column] = value

    return spoil


def thin_out(arrays):
    """Joint states at 400 Hz for a while, then at 100 Hz."""
    half = len(arrays['states']) // 4
    keep = np.r_[0:half, half : len(arrays['states']) : 4]
    for name in ('states', 'position', 'velocity', 'torque'):
        arrays[name] = arrays[name][keep]


CASES = {
    'too little data': ({'seconds': 20.0}, ['HAA', 'training needs 36 s']),
    'a torque that never changes': (
        {'seconds': LONG, 'spoil': fill('torque', 3.0)},
        ['HFE', 'torque is constant'],
    ),
    'a speed that never changes': (
        {'seconds': LONG, 'spoil': fill('velocity', 0.0)},
        ['velocity is constant'],
    ),
    'a power that never changes': (
        {'seconds': LONG, 'spoil': fill('current', 0.5)},
        ['power is constant'],
    ),
    'torque of NaN': ({'spoil': fill('torque', np.nan)}, ['joint_states.effort of LF_HFE', 'NaN']),
    'power of NaN': (
        {'spoil': lambda a: a['current'].fill(np.nan)},
        ['drive_supply has a bad status or NaN'],
    ),
    'positions in degrees': (
        {'spoil': multiply('position', 57.3)},
        ['position is in degrees', 'LF_HFE'],
    ),
    'speeds in degrees': (
        {'spoil': multiply('velocity', 57.3)},
        ['degrees per second'],
    ),
    'torques in N·mm': ({'spoil': multiply('torque', 1e3)}, ['LF_HFE', 'units of torque']),
    'currents in mA': ({'spoil': multiply('current', 1e3)}, ['current', 'LF_HFE', 'mA']),
    'voltages in mV': ({'spoil': multiply('voltage', 1e3)}, ['voltage', 'LF_HFE', 'mV']),
    'joint states at 100 Hz': ({'rate': 100.0}, ['joint_states come at 100 Hz', '195 Hz']),
    'joint states of two rates': ({'spoil': thin_out}, ['joint_states', '100 Hz']),
    'a drive without commands': (
        {'commanded': ('LF_HAA',)},
        ['joint_commands say nothing of LF_HFE'],
    ),
}


@pytest.mark.parametrize('case', CASES)
def test_it_is_refused_in_one_line_by_recording_and_field(case, bags, tmp_path, capsys):
    options, quoted = CASES[case]
    bag = bags(tmp_path / 'spoilt', **{'seconds': 8.0, 'names': DRIVES, **options})
    run = tmp_path / 'run'
    quick = ['--folds', '1', '--epochs', '1', '--hidden', '4', '--workers', '1']
    assert train_command([str(bag), '-o', str(run), *quick]) == 2
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1, error
    for part in ('spoilt', *quoted):
        assert part in error
    assert not (run / 'model.safetensors').exists()


def test_recordings_of_other_rates_or_drives_do_not_make_one_set(bag, bags, tmp_path, capsys):
    slow = bags(tmp_path / 'slow', 5.0, seed=1, rate=200.0)
    other = bags(tmp_path / 'other', 5.0, seed=1, names=('LF_HAA', 'LF_KFE'))
    for second, quoted in ((slow, ['at 200 Hz', '400 Hz']), (other, ['LF_KFE', 'LF_HFE'])):
        command = [str(bag), str(second), '-o', str(tmp_path / 'run')]
        assert train_command(command) == 2
        error = capsys.readouterr().err.strip()
        assert len(error.splitlines()) == 1
        assert all(part in error for part in (second.name, *quoted))


def test_a_few_lost_or_invalid_samples_are_cut_out_and_training_goes_on(bags, tmp_path):
    def spoil(arrays):
        arrays['torque'][8000:8010, HFE] = np.nan
        arrays['current'][30_000:30_005, 0] = np.nan

    bag = bags(tmp_path / 'bag', 45.0, spoil=spoil)
    quick = ['--folds', '1', '--epochs', '1', '--hidden', '4', '--workers', '1']
    assert train_command([str(bag), '-o', str(tmp_path / 'run'), *quick]) == 0
