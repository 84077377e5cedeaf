"""The same motion by the same name on the live simulated bench and on the one without nodes."""

import subprocess

import numpy as np
import pytest
import yaml
from power_recordings.reading.reader import Recording
from wattwalk_core.processes import find_program

SHORT = ('--duration', '4', '--load', '1.3kg@0.45m')
PENDULUM = ('-p', 'mass:=1.3', '-p', 'length:=0.45')
STEP = 1.0 / 400.0  # s


@pytest.fixture
def bench(node_process, tmp_path):
    bus = ['--ros-args', '-p', 'interface:=unixsocket', '-p', f'channel:={tmp_path}/bus']
    daq = node_process('power_daq', 'daq', *bus)
    node_process(
        *('sim_bridge', 'sim', *bus, '-p', 'world:=bench', '-p', 'joint:=RH_KFE'),
        *('-p', 'publish_clock:=true', *PENDULUM),
    )
    daq.wait_for_output('measuring|reading')


def commands_of(bag, drive, field):
    """Times and values of what a drive is commanded, from its first change on."""
    samples = Recording.open(bag).joint_commands()
    values = getattr(samples, field)[:, samples.names.index(drive)]
    there = np.isfinite(values)
    times, values = (samples.stamp_ns[there] - samples.stamp_ns[0]) * 1e-9, values[there]
    return times, values


@pytest.mark.parametrize(
    ('mode', 'field', 'most'), [('velocity', 'velocity', 3.0), ('torque', 'effort', 5.0)]
)
def test_live_and_offline_agree_in_what_is_commanded_and_reached(
    bench, node_process, tmp_path, mode, field, most
):
    motion = ('square', '--mode', mode, '--amplitude', f'{most}', *SHORT)
    node = node_process(
        *('drive_bench', 'run', *motion, '--drive', 'KFE'),
        *('--record', str(tmp_path / 'live')),
        *('--ros-args', '-p', 'stale_after:=1.0', '-p', 'use_sim_time:=true'),
    )
    assert node.wait(900) == 0, node.output
    offline = subprocess.run(
        (
            *(find_program('ros2'), 'run', 'sim_bridge', 'bench', *motion),
            *('--drive', 'RH_KFE', '-o', tmp_path / 'offline'),
        ),
        check=False,
        capture_output=True,
        text=True,
    )
    assert offline.returncode == 0, offline.stderr
    reached = {}
    for name in ('live', 'offline'):
        recording = Recording.open(tmp_path / name)
        joints = recording.joint_states()
        place = joints.names.index('RH_KFE')
        speed = joints.velocity[:, place]
        reached[name] = (
            np.percentile(speed, 2),
            np.percentile(speed, 98),
            STEP * np.count_nonzero(np.abs(speed) > 0.3),
        )
        _, values = commands_of(tmp_path / name, 'RH_KFE', field)
        assert values.max() == pytest.approx(most, rel=1e-3)
        assert values.min() == pytest.approx(-most, rel=1e-3)
    for live, off in zip(reached['live'], reached['offline'], strict=True):
        assert live == pytest.approx(off, rel=0.2, abs=0.3)
    card = yaml.safe_load((tmp_path / 'live' / 'card.yaml').read_text())
    assert (card['motion'], card['mode'], card['load']) == ('square', mode, '1.3kg@0.45m')
    assert card['complete'] is True
