import math

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from peers import Peer, wait_until
from sensor_msgs.msg import JointState

PATIENT = ('--ros-args', '-p', 'stale_after:=1.0')
MOTION = """
format: motion/1
drives: [LF_KFE]
segments:
- {mode: velocity, speed: 0.5, seconds: 8}
- {mode: rest, seconds: 600}
"""


class Joints(Peer):
    """Two joints that follow their commands at once and tell so at 100 Hz."""

    def __init__(self):
        super().__init__('joints', 'start', 'estop')
        self.position = {'LF_HFE': 0.3, 'LF_KFE': -0.2}
        self.commands, self.reasons = [], []
        self.publisher = self.node.create_publisher(JointState, 'joint_states', 10)
        self.node.create_subscription(JointState, 'joint_commands', self.on_command, 10)
        self.node.create_subscription(DiagnosticArray, 'diagnostics', self.on_diagnostics, 10)
        self.open()

    def on_command(self, message):
        self.commands.append(message)
        for name, value in zip(message.name, message.position, strict=False):
            if math.isfinite(self.position[name]):
                self.position[name] = value

    def on_diagnostics(self, message):
        self.reasons += [s.message for s in message.status if s.name == 'drive_bench']

    def speak(self):
        message = JointState(name=list(self.position), position=list(self.position.values()))
        message.velocity = [0.0, 0.0]
        message.header.stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(message)


@pytest.fixture
def joints(ros_domain):
    joints = Joints()
    yield joints
    joints.close()


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'next.yaml'
    path.write_text(MOTION)
    return str(path)


def assert_last_damps(joints):
    wait_until(lambda: len(joints.commands[-1].position) == 0, 'a damping command')
    assert list(joints.commands[-1].velocity) == [0.0, 0.0]


def test_it_waits_for_start_moves_one_drive_and_ends_by_an_emergency_stop(
    joints, file, node_process
):
    node = node_process('drive_bench', 'run', file, *PATIENT)
    node.wait_for_output('next: 608 s of LF_KFE; record it: ros2 run power_daq record')
    wait_until(lambda: 'ready, waits for start' in joints.reasons, 'readiness')
    assert not joints.commands
    wait_until(lambda: joints.call('start').success, 'a start')
    wait_until(lambda: joints.position['LF_KFE'] > 0.0, 'motion')
    assert joints.commands[-1].velocity[1] == 0.5
    assert {message.position[0] for message in joints.commands} == {0.3}
    assert 'segment 1 of 2: +0.5 rad/s, 8 s' in joints.reasons
    assert joints.call('estop').success
    assert_last_damps(joints)
    assert node.wait() == 1
    assert 'emergency stop: asked for' in joints.reasons
    assert 'damping, emergency stop: asked for' in node.output


def test_nan_in_the_joint_states_damps_with_the_reason_and_code_1(joints, file, node_process):
    node = node_process('drive_bench', 'run', file, '--start', *PATIENT)
    wait_until(lambda: joints.position['LF_KFE'] > -0.1, 'motion')
    joints.position['LF_KFE'] = math.nan
    assert_last_damps(joints)
    assert node.wait() == 1
    wait_until(lambda: any('not finite' in reason for reason in joints.reasons), 'the reason')


def test_a_soak_is_not_begun_while_nobody_tells_how_warm_the_winding_is(
    joints, file, node_process, tmp_path
):
    (tmp_path / 'next.yaml').write_text(
        'format: motion/1\ndrives: [LF_KFE]\nsegments:\n'
        '- {mode: position, amplitude: 0.2, frequency: 1.0, until_warmer: 20, seconds: 600}\n'
    )
    node = node_process('drive_bench', 'run', file, '--start', *PATIENT)
    node.wait_for_output('waiting: .*has no winding temperature of LF_KFE')
    answer = joints.call('start')
    assert not answer.success
    assert 'has no winding temperature of LF_KFE' in answer.message
    wait_until(
        lambda: any(
            reason.startswith('not ready: ') and 'no winding temperature' in reason
            for reason in joints.reasons
        ),
        'a diagnosis',
    )
    assert not joints.commands
    node.interrupt()
    assert node.wait() == 0


def test_ctrl_c_leaves_the_drives_damped_and_says_that_the_motion_is_not_whole(
    joints, file, node_process
):
    node = node_process('drive_bench', 'run', file, '--start', *PATIENT)
    wait_until(lambda: joints.position['LF_KFE'] > -0.1, 'motion')
    node.interrupt()
    assert node.wait() == 130
    assert_last_damps(joints)


@pytest.mark.parametrize(
    ('change', 'arguments', 'words'),
    [
        (('0.5', '50.0'), (), '50 rad/s asked of LF_KFE; its limits are 0..8 rad/s'),
        (('seconds: 8', 'seconds: 80'), (), 'would go to 39.79 rad; its limits are -9.42..9.42'),
        (('', ''), ('--drive', 'LF_TAIL'), "no drive 'LF_TAIL' in joint_states; it has LF_HFE"),
        (('', ''), ('--ros-args', '-p', 'rate:=9.0'), 'from 50 to 400'),
        (('motion/1', 'song/1'), (), "format: expected 'motion/1', there is 'song/1'"),
    ],
)
def test_what_may_not_be_executed_ends_with_one_line_and_code_2(
    joints, file, node_process, tmp_path, change, arguments, words
):
    (tmp_path / 'next.yaml').write_text(MOTION.replace(*change))
    node = node_process('drive_bench', 'run', file, '--start', *arguments)
    assert node.wait() == 2
    assert words in node.output
    assert 'Traceback' not in node.output
    assert not joints.commands
