import signal

import numpy as np
import policy_folders
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from peers import Peer, wait_until
from sensor_msgs.msg import Imu, JointState
from wattwalk_core.anymal import DEFAULT_POSE, JOINT_NAMES

PATIENT = ('--ros-args', '-p', 'stale_after:=1.0')


class FakeRobot(Peer):
    """Joint states and IMU at 100 Hz of a robot whose joints stay where they are."""

    def __init__(self):
        super().__init__('fake_robot', 'start', 'stop', 'estop')
        self.silent, self.velocities = False, 12
        self.commands, self.reasons, self.told = [], [], []
        self.joints = self.node.create_publisher(JointState, 'joint_states', 10)
        self.imu = self.node.create_publisher(Imu, 'imu', 10)
        self.twist = self.node.create_publisher(TwistStamped, 'cmd_vel', 10)
        self.node.create_subscription(JointState, 'joint_commands', self.commands.append, 10)
        self.node.create_subscription(TwistStamped, 'cmd_vel', self.told.append, 10)
        self.node.create_subscription(DiagnosticArray, 'diagnostics', self.on_diagnostics, 10)
        self.open()

    def on_diagnostics(self, message):
        self.reasons += [s.message for s in message.status if s.name == 'policy_runner']

    def speak(self):
        if self.silent:
            return
        stamp = self.node.get_clock().now().to_msg()
        joints = JointState(name=list(JOINT_NAMES), position=list(map(float, DEFAULT_POSE)))
        joints.velocity = [0.0] * self.velocities
        joints.header.stamp = stamp
        self.joints.publish(joints)
        imu = Imu()
        imu.header.stamp = stamp
        imu.orientation.w = 1.0
        self.imu.publish(imu)


@pytest.fixture
def robot(ros_domain):
    robot = FakeRobot()
    yield robot
    robot.close()


def started(robot):
    """Call start until the robot's first messages have reached the node."""
    wait_until(lambda: robot.call('start').success, 'a start')


def test_a_robot_is_run_damped_by_estop_and_only_started_after_stop(robot, node_process):
    node_process('policy_runner', 'run', '--policy', 'trot', *PATIENT)
    started(robot)
    wait_until(lambda: len(robot.commands) > 20, 'commands')
    command = robot.commands[0]
    assert list(command.name) == list(JOINT_NAMES)
    assert np.allclose(command.position, DEFAULT_POSE, atol=0.05)
    assert len(command.velocity) == len(command.effort) == 0
    wait_until(lambda: 'running' in robot.reasons, 'running')

    assert robot.call('estop').success
    robot.commands.clear()
    wait_until(lambda: len(robot.commands) > 5, 'damping')
    damping = robot.commands[-1]
    assert len(damping.position) == 0
    assert list(damping.velocity) == [0.0] * 12
    wait_until(lambda: 'emergency stop: asked for' in robot.reasons, 'the reason')

    refused = robot.call('start')
    assert not refused.success
    assert 'stop' in refused.message
    assert robot.call('stop').success
    assert robot.call('start').success


def test_a_robot_that_falls_silent_is_damped_with_the_reason_in_diagnostics(robot, node_process):
    node = node_process(
        'policy_runner', 'run', '--start', '--random-commands', '--seed', '3', *PATIENT
    )
    wait_until(lambda: 'running' in robot.reasons, 'running')
    robot.silent = True
    wait_until(lambda: any('stale input' in reason for reason in robot.reasons), 'the reason')
    robot.commands.clear()
    wait_until(lambda: robot.commands, 'damping')
    assert len(robot.commands[-1].position) == 0
    node.wait_for_output(r'damping, stale input: (joint_states|imu) is \d+ ms old')


def test_a_robot_that_stops_telling_its_velocities_is_damped_with_the_reason(robot, node_process):
    node_process('policy_runner', 'run', '--start', '--policy', 'trot', *PATIENT)
    wait_until(lambda: 'running' in robot.reasons, 'running')
    robot.velocities = 0
    reason = 'malformed input: joint_states has 12 names, 12 positions and 0 velocities'
    wait_until(lambda: reason in robot.reasons, 'the reason')
    robot.commands.clear()
    wait_until(lambda: robot.commands, 'damping')
    assert len(robot.commands[-1].position) == 0


def test_it_says_what_it_waits_for_and_starts_once_that_comes(robot, node_process):
    robot.silent = True
    node = node_process('policy_runner', 'run', '--start', *PATIENT)
    node.wait_for_output('waiting: .*joint_states')
    assert not robot.commands
    robot.silent = False
    wait_until(lambda: 'running' in robot.reasons, 'running')


def test_a_velocity_command_makes_it_step(robot, node_process):
    node_process('policy_runner', 'run', '--start', *PATIENT)
    wait_until(lambda: 'running' in robot.reasons, 'running')
    robot.commands.clear()
    twist = TwistStamped()
    twist.twist.linear.x = 0.4

    def lifted():
        robot.twist.publish(twist)
        knees = np.array([list(m.position) for m in robot.commands if len(m.position)])
        return len(knees) > 0 and np.ptp(knees[:, 2]) > 0.5

    wait_until(lifted, 'a lifted foot')


def test_a_held_velocity_makes_it_step_and_is_told_on_cmd_vel(robot, node_process):
    given = ('-p', 'start:=true', '-p', 'velocity:=0.4,0,-0.2')
    node_process('policy_runner', 'run', *PATIENT, *given)
    wait_until(lambda: 'running' in robot.reasons, 'running')

    def told():
        twists = [message.twist for message in robot.told]
        return any(t.linear.x == 0.4 and t.angular.z == -0.2 for t in twists)

    wait_until(told, 'the whole velocity')
    robot.commands.clear()

    def lifted():
        knees = np.array([list(m.position) for m in robot.commands if len(m.position)])
        return len(knees) > 0 and np.ptp(knees[:, 2]) > 0.5

    wait_until(lifted, 'a lifted foot')


def test_the_policy_is_changed_by_its_parameter_while_the_robot_stands(
    robot, node_process, tmp_path
):
    folder = policy_folders.save(tmp_path / 'standing')
    node = node_process('policy_runner', 'run', '--policy', 'trot', '--start', *PATIENT)
    wait_until(lambda: 'running' in robot.reasons, 'running')
    bad = node_process.ros2('param', 'set', '/policy_runner', 'policy', 'gallop')
    bad.wait_for_output("(?i)failed.*no policy 'gallop'")
    trust = node_process.ros2('param', 'set', '/policy_runner', 'trust_code', 'true')
    trust.wait_for_output('(?i)failed')
    good = node_process.ros2('param', 'set', '/policy_runner', 'policy', str(folder))
    good.wait_for_output('(?i)successful')
    node.wait_for_output('standing: the robot comes to a stand')

    def stands():
        last = robot.commands[-1].position
        return len(last) == 12 and np.allclose(last, DEFAULT_POSE, atol=1e-6)

    wait_until(stands, 'the default pose')


def test_a_bad_policy_folder_ends_with_one_line_and_code_2(node_process, tmp_path):
    folder = policy_folders.save(tmp_path / 'p')
    (folder / 'weights.safetensors').unlink()
    node = node_process('policy_runner', 'run', '--policy', str(folder))
    assert node.wait() == 2
    assert 'cannot read' in node.output
    assert 'weights.safetensors' in node.output
    assert 'Traceback' not in node.output


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_the_drives_damped(robot, node_process, number):
    node = node_process('policy_runner', 'run', '--start', *PATIENT)
    wait_until(lambda: 'running' in robot.reasons, 'running')
    node.send_signal(number)
    assert node.wait_after(number) in (0, None)
    assert 'Traceback' not in node.output
    wait_until(lambda: len(robot.commands[-1].position) == 0, 'a last damping command')


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (('--policy', 'gallop'), "no policy 'gallop'; there are trot, trot_slow, trot_high"),
        (('--seed', '-3'), '--seed is -3; give 0 or more'),
        (('--ros-args', '-p', 'rate:=9999.0'), 'from 10 to 400'),
        (('--ros-args', '-p', 'stale_after:=soon'), 'from 0.01 to 1'),
        (('--restart-after', '-1'), '--restart-after is -1.0; give 0 (never) to 3600 seconds'),
    ],
)
def test_bad_arguments_end_with_one_line_and_code_2(node_process, arguments, words):
    node = node_process('policy_runner', 'run', *arguments)
    assert node.wait() == 2
    assert words in node.output
    assert 'Traceback' not in node.output
