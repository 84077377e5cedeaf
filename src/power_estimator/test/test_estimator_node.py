import math
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from power_estimator.live.change_watch import ReferenceNoise, WatchReference
from power_estimator.network.ppn import PowerPredictionNetwork
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from drive_power_msgs.msg import DriveSupply, PowerEstimate

PATIENCE = 60.0
RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)


class Robot:
    """Plays a dataset as joint states, commands and supply, and listens to the estimates."""

    def __init__(self, data):
        self.data = data
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('robot', context=self.context)
        self.states = self.node.create_publisher(JointState, 'joint_states', RELIABLE)
        self.commands = self.node.create_publisher(JointState, 'joint_commands', RELIABLE)
        self.supply = self.node.create_publisher(DriveSupply, 'drive_supply', RELIABLE)
        self.estimates, self.figures, self.sentences = [], {}, []
        self.watched = []
        self.node.create_subscription(
            PowerEstimate, 'power_estimate', self.estimates.append, RELIABLE
        )
        self.node.create_subscription(DiagnosticArray, 'diagnostics', self.on_diagnostics, 10)
        self.silent = False
        self.index = 0
        self.node.create_timer(0.005, self.speak)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.spin, daemon=True)
        self.thread.start()

    def spin(self):
        with suppress(ExternalShutdownException):
            self.executor.spin()

    def on_diagnostics(self, message):
        for status in message.status:
            if status.name == 'power_estimator: watch':
                self.watched.append((status.message, {v.key: v.value for v in status.values}))
            if status.name == 'power_estimator: estimate':
                self.sentences.append(status.message)
                self.figures = {v.key: v.value for v in status.values}

    def speak(self):
        if self.silent:
            return
        row = self.index % len(self.data.time)
        names = list(self.data.names)
        stamp = (1_700_000_000_000 + 5 * self.index) * 1_000_000
        self.index += 1

        def vector(values):
            return values[row].astype(float).tolist()

        command = JointState(name=names, position=vector(self.data.command))
        state = JointState(
            name=names,
            position=vector(self.data.position),
            velocity=vector(self.data.velocity),
            effort=vector(self.data.torque),
        )
        supply = DriveSupply(name=names, device_time=[0, 1])
        # A second sample is flagged, and far off.
        supply.status = [0] * len(names) + [DriveSupply.OVERRANGE] * len(names)
        supply.voltage = vector(self.data.voltage) * 2
        supply.current = vector(self.data.current) + [1000.0] * len(names)
        for message in (command, state, supply):
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        self.commands.publish(command)
        self.supply.publish(supply)
        self.states.publish(state)

    def until(self, condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'never happened; heard {self.sentences[-3:]}'
            time.sleep(0.02)

    def close(self):
        self.executor.shutdown()
        self.thread.join(PATIENCE)
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def model(checkpoint, tmp_path):
    path = tmp_path / 'model.safetensors'
    checkpoint.save(path)
    return f'ppn:{path}'


@pytest.fixture
def robot(ros_domain, drives):
    robot = Robot(drives(10.0, seed=4))
    yield robot
    robot.close()


def test_the_node_estimates_and_says_so_when_its_input_stops(node_process, robot, model):
    node = node_process(
        'power_estimator', 'estimate', '--ros-args', '-p', f'model:={model}', '-p', 'compare:=true'
    )
    robot.until(lambda: sum(m.status == PowerEstimate.OK for m in robot.estimates) > 100)
    found = [m for m in robot.estimates if m.status == PowerEstimate.OK][-1]
    assert list(found.name) == ['LF_HAA', 'LF_HFE']
    assert found.model == model
    assert found.total == pytest.approx(sum(found.power), rel=1e-4)
    assert all(math.isfinite(p) for p in found.power)
    assert found.header.stamp.sec >= 1_700_000_000
    robot.until(lambda: 'R² of the sum' in robot.figures)
    assert float(robot.figures['measured'].split()[0]) < 1000
    assert robot.sentences[-1] in (
        'estimating',
        'the robot moves as it never did in the training data',
    )
    robot.silent = True
    robot.until(lambda: robot.estimates[-1].status == PowerEstimate.INPUT_STALE)
    assert all(math.isnan(p) for p in robot.estimates[-1].power)
    robot.until(lambda: robot.sentences[-1] == 'joint_states have stopped')
    robot.silent = False
    robot.until(lambda: robot.estimates[-1].status == PowerEstimate.OK)
    node.send_signal(signal.SIGINT)
    assert node.wait() == 0
    assert 'Traceback' not in node.output


@pytest.mark.parametrize(
    ('parameters', 'quoted'),
    [
        ([], 'parameter model is empty'),
        (['model:=ppn:nowhere'], 'nowhere'),
        (['model:=torque'], "'torque' is not known"),
        (['stale_after:=-1.0'], 'parameter stale_after'),
        (['compare:=perhaps', 'model:=torque_abs'], 'expected true or false'),
    ],
)
def test_bad_parameters_end_the_node_with_code_2_and_one_line(node_process, parameters, quoted):
    options = [part for text in parameters for part in ('-p', text)]
    node = node_process('power_estimator', 'estimate', '--ros-args', *options)
    assert node.wait() == 2
    assert quoted in node.output
    assert 'Traceback' not in node.output
    said = node.own_lines
    assert len(said) == 1
    node_process.started.remove(node)


def test_a_robot_that_the_network_does_not_know_ends_the_node_with_code_2(
    node_process, robot, model, drives
):
    robot.data = drives(1.0, ('wheel', 'arm'))
    node = node_process('power_estimator', 'estimate', '--ros-args', '-p', f'model:={model}')
    assert node.wait() == 2
    assert 'knows none of the joints' in node.output
    node_process.started.remove(node)


def test_the_watch_learns_a_reference_and_takes_one_that_was_kept(
    node_process, robot, model, tmp_path
):
    file = tmp_path / 'reference.yaml'
    own = ('estimate', '--ros-args', '-p', f'model:={model}', '-p', 'watch:=true')
    own += ('-p', f'reference:={file}')
    node = node_process('power_estimator', *own)
    robot.until(lambda: robot.watched)
    assert robot.watched[-1][0] == 'learning the reference'
    assert robot.watched[-1][1]['false alarms allowed'] == '1 a month of motion'
    node.send_signal(signal.SIGINT)
    assert node.wait() == 0
    name = PowerPredictionNetwork.load(Path(model.removeprefix('ppn:'))).name
    noise = ReferenceNoise(
        0.0, *[(v,) * 4 for v in (0.0, 0.0, -1e9, 1e9)], 0.0, 50.0, 0.0, 1.0, 0.0
    )
    drives = dict.fromkeys(robot.data.names, noise)
    WatchReference('watch_reference/1', name, 10, drives).save(file)
    robot.watched.clear()
    node = node_process('power_estimator', *own)
    robot.until(lambda: robot.watched and robot.watched[-1][0] == 'as the reference')
    assert robot.watched[-1][1]['reference'] == '100 % learned'
    node.send_signal(signal.SIGINT)
    assert node.wait() == 0
    assert 'Traceback' not in node.output
