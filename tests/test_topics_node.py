"""`ros2 run power_daq topics` across processes: a robot's topics are republished and recorded."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from power_recordings.reading.reader import Recording
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import BatteryState, JointState

from drive_power_msgs.msg import DriveSupply

PERIOD = 0.01
RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT


class Robot:
    """Joint states (reliable) and a battery (best effort) under names of its own."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('robot', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.joints = self._publisher(JointState, '/robot/joints', RELIABLE)
        self.battery = self._publisher(BatteryState, '/robot/battery', BEST_EFFORT)
        self.heard: dict[str, list[Any]] = {}
        for kind, topic in (
            (JointState, 'joint_states'),
            (DriveSupply, 'drive_supply'),
            (DiagnosticArray, 'diagnostics'),
        ):
            self.heard[topic] = []
            self.node.create_subscription(kind, topic, self.heard[topic].append, 1000)
        self.is_metered = True

    def _publisher(self, kind: Any, topic: str, reliability: ReliabilityPolicy) -> Any:
        return self.node.create_publisher(
            kind, topic, QoSProfile(depth=10, reliability=reliability)
        )

    def until(self, condition: Callable[[], object], seconds: float = 60.0) -> None:
        """Publish at 100 Hz until something holds: hip turns at 1 turn/s and draws t A."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, [m.status[0].message for m in self.heard['diagnostics']]
            ns = time.time_ns()
            now = ns / 1e9
            message = JointState(name=['knee', 'hip'], position=[0.0, now % 1000.0])
            message.velocity, message.effort = [0.0, 1.0], [0.25, 0.5]
            whole, rest = divmod(ns, 10**9)
            message.header.stamp.sec, message.header.stamp.nanosec = whole, rest
            self.joints.publish(message)
            if self.is_metered:
                battery = BatteryState(voltage=24.0, current=-2.0 - now % 1000.0)
                battery.header.stamp.sec, battery.header.stamp.nanosec = whole, rest
                self.battery.publish(battery)
            deadline = time.monotonic() + PERIOD
            while (left := deadline - time.monotonic()) > 0:
                self.executor.spin_once(timeout_sec=left)

    def said(self) -> str:
        """Return the newest sentence of the topics node."""
        found = [s for m in self.heard['diagnostics'] for s in m.status if s.name == 'topics']
        return found[-1].message if found else ''

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def robot(ros_domain: int) -> Iterator[Robot]:
    made = Robot(ros_domain)
    yield made
    made.close()


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    hip = {
        'position': {'from': '/robot/joints:position[hip]', 'unit': 'rev'},
        'velocity': {'from': '/robot/joints:velocity[hip]', 'unit': 'rev/s'},
        'torque': {'from': '/robot/joints:effort[hip]', 'unit': 'A', 'at': 'motor'},
        'voltage': {'from': '/robot/battery:voltage', 'unit': 'V'},
        'current': {'from': '/robot/battery:current', 'unit': 'A', 'positive': 'fed'},
    }
    path = tmp_path / 'arm.yaml'
    path.write_text(yaml.safe_dump({'format': 'import/1', 'drives': {'hip': hip}}))
    return path


def stamp(message: Any) -> float:
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def test_a_robot_s_topics_are_republished_and_recorded_with_what_the_card_has_to_say(
    robot: Robot, arm: Path, node_process: Any, tmp_path: Path
) -> None:
    robot.is_metered = False
    node = node_process('power_daq', 'topics', '--map', str(arm))
    robot.until(lambda: 'waiting for /robot/battery (no ' in robot.said())
    robot.is_metered = True
    robot.until(lambda: len(robot.heard['drive_supply']) > 100)
    recorder = node_process('power_daq', 'record', '-o', str(tmp_path / 'bag'), '--duration', '4')
    robot.until(lambda: robot.said() == 'republishing')
    robot.until(lambda: not recorder.running)
    node.interrupt()
    assert node.wait() == 0, node.output
    assert 'Traceback' not in node.output
    supply, joints = robot.heard['drive_supply'], robot.heard['joint_states']
    for message in joints:
        assert list(message.name) == ['hip']
        turns = message.position[0] / (2 * np.pi)
        assert turns == pytest.approx(stamp(message) % 1000.0, abs=1e-3)
        assert message.velocity[0] == pytest.approx(2 * np.pi)
        assert message.effort[0] == 0.5
    for message in supply:
        assert message.voltage[0] == 24.0
        assert message.current[0] == pytest.approx(2.0 + stamp(message) % 1000.0, abs=1e-3)
        assert list(message.status) == [0]
    recording = Recording.open(tmp_path / 'bag')
    assert recording.card.torque == {'hip': 'motor'}
    assert recording.card.torque_unit == {'hip': 'A'}
    assert recording.card.drives == ('hip',)
    assert len(recording.drive_supply()) > 100


def test_a_topic_that_stops_is_named_and_the_others_go_on(
    robot: Robot, arm: Path, node_process: Any
) -> None:
    node_process('power_daq', 'topics', '--map', str(arm))
    robot.until(lambda: robot.said() == 'republishing')
    robot.is_metered = False
    robot.until(lambda: robot.said() == 'no message in the last second of /robot/battery')
    count = len(robot.heard['joint_states'])
    robot.until(lambda: len(robot.heard['joint_states']) > count + 50)


@pytest.mark.parametrize(
    ('words', 'map_words', 'line'),
    [
        (['--map', 'ur_ros2'], None, 'map ur_ros2 reads /joint_states, which this node would'),
        (['--map', 'ur_rtde'], None, "'actual_q_*' names no topic"),
        (['--map', 'gone'], None, "no map 'gone': give a file, or one of"),
        (None, ('effort[hip]', 'efort[hip]'), 'there is /robot/joints:effort[hip]'),
    ],
)
def test_a_map_that_does_not_fit_ends_the_node_with_one_line(
    robot: Robot, arm: Path, node_process: Any, words: Any, map_words: Any, line: str
) -> None:
    if map_words:
        arm.write_text(arm.read_text().replace(*map_words))
    node = node_process('power_daq', 'topics', *(words or ['--map', str(arm)]))
    robot.until(lambda: not node.running)
    assert node.wait() == 2
    assert line in node.output
    assert 'Traceback' not in node.output
    assert len([text for text in node.output.splitlines() if 'topics: ' in text]) == 1
