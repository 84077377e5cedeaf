"""A motion file on the live simulated bench: every node in a process of its own."""

import numpy as np
import pytest
from power_recordings.reading.reader import Recording
from priority import prefer

MOTION = """
format: motion/1
drives: [RH_KFE]
segments:
- {mode: velocity, speed: 2.0, load: 5.0, seconds: 2}
- {mode: velocity, speed: -2.0, load: 5.0, seconds: 2}
- {mode: torque, torque: 5.0, speed: 0.0, seconds: 5}
"""
STILL = """
format: motion/1
drives: [RH_KFE]
segments:
- {mode: rest, seconds: 600}
"""
ATTEMPTS = 5
LATE = 0.03  # s without a command, after which a motion at its speeds is another one
MOST_LATE = 1.0  # s of such gaps, by which the limits below are wider
SWING = 20.0  # rad/s², 5 N·m on the pendulum's 0.26 kg·m²
PENDULUM = ('-p', 'mass:=1.3', '-p', 'length:=0.45')  # 9.81 · 1.3 · 0.45 = 5.7 N·m


@pytest.fixture
def bench(node_process, tmp_path):
    bus = ['--ros-args', '-p', 'interface:=unixsocket', '-p', f'channel:={tmp_path}/bus']
    daq = node_process('power_daq', 'daq', *bus)
    sim = node_process(
        *('sim_bridge', 'sim', *bus, '-p', 'world:=bench', '-p', 'joint:=RH_KFE'),
        *('-p', 'publish_clock:=true', *PENDULUM),
    )
    prefer(daq, sim)
    daq.wait_for_output('measuring|reading')
    return sim


def run_motion(node_process, tmp_path, motion, *parameters):
    (tmp_path / 'next.yaml').write_text(motion)
    return node_process(
        *('drive_bench', 'run', str(tmp_path / 'next.yaml'), '--pendulum', '5.74', '--start'),
        *('--ros-args', '-p', 'stale_after:=1.0', *parameters),
    )


def recorded(node_process, tmp_path, attempt):
    """Run the motion on simulated time with a recorder beside it, and return the recording."""
    bag = tmp_path / f'next{attempt}'
    recorder = node_process('power_daq', 'record', '-o', str(bag))
    recorder.wait_for_output('recording to')
    in_its_time = ('-p', 'use_sim_time:=true')  # a busy machine makes it slow then, not wrong
    node = run_motion(node_process, tmp_path, MOTION, *in_its_time)
    prefer(node, recorder)
    assert node.wait(90) == 0, node.output
    assert 'segment 3 of 3: hold 5 N·m, 5 s' in node.output
    assert 'ros2 run power_lab diagnose bags/next' in node.output
    recorder.stop()
    return Recording.open(bag)


def without_commands(recording):
    """Seconds of a recording in which the bench went on with an old command."""
    gaps = np.diff(recording.joint_commands().stamp_ns) / 1e9
    return gaps[gaps > LATE].sum()


@pytest.mark.alone
def test_a_motion_is_executed_and_recorded_as_asked(bench, node_process, tmp_path):
    late = np.inf
    for attempt in range(ATTEMPTS):
        found = recorded(node_process, tmp_path, attempt)
        if without_commands(found) < late:
            recording, late = found, without_commands(found)
        if not late:
            break
    assert late < MOST_LATE, f'commands were kept from the bench in {ATTEMPTS} attempts'
    joints = recording.joint_states()
    drive = joints.names.index('RH_KFE')
    velocity, torque = joints.velocity[:, drive], joints.effort[:, drive]
    step = 1.0 / 400.0  # s
    for speed in (2.0, -2.0):
        held = step * np.count_nonzero(np.abs(velocity - speed) < 0.25)
        assert 1.2 - late < held < 2.5 + late
    still = np.abs(velocity) < 0.1
    held = step * np.count_nonzero(still & (np.abs(torque - 5.0) < 0.5))
    assert 4.0 - late < held < 6.0 + late
    # 2.8 rad/s on an idle machine; up to 3.1 were seen where commands come late on a busy one.
    assert np.abs(velocity).max() < 3.5 + SWING * late
    assert abs(joints.position[-1, drive]) < 0.1, 'it is led back before the drive is damped'


def test_a_robot_that_goes_is_damped_and_named(bench, node_process, tmp_path):
    node = run_motion(node_process, tmp_path, STILL)
    node.wait_for_output('segment 1 of 1')
    bench.kill()
    assert node.wait() == 1
    assert 'damping, stale input: joint_states is' in node.output
