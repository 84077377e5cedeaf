"""The topics node: republishes a robot's own topics as the suite's, by an import map."""

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from power_recordings.card import Card
from power_recordings.importing.map_file import ImportMap, load_map
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosidl_runtime_py.utilities import get_message
from sensor_msgs.msg import BatteryState, JointState
from wattwalk_core.errors import InputError
from wattwalk_core.nodes.diagnostics import Reporter
from wattwalk_core.nodes.running import run_node

from drive_power_msgs.msg import DriveSupply
from power_daq.acquisition.publishing import JointStatePublisher, SupplyPublisher
from power_daq.acquisition.receiver import Sample
from power_daq.nodes.card_topic import publish_card
from power_daq.supply.answers import Reading
from power_daq.supply.battery import BatteryPublisher
from power_daq.topics.health import TopicsHealth
from power_daq.topics.republisher import Republisher

_DISCOVERY = 0.5  # s
_SETTLED = 4  # looks at the graph without a new topic, until the drives are taken to be all
_RELIABLE = QoSProfile(depth=1000)
# Best effort matches publishers of either kind.
_ANY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


class TopicsNode(Node):
    """Publishes what a map finds in other topics; InputError for a map that does not fit them.

    where: the name of the map, for errors. commands: publish joint_commands too.
    """

    def __init__(self, mapping: ImportMap, where: str, commands: bool) -> None:
        super().__init__('topics')
        self._where = where
        self._republisher = Republisher(mapping, where, commands=commands)
        self._check_outputs(commands)
        self._publish: dict[str, Callable[[Sample], object]] = {}
        self._sources: dict[str, Any] = {}
        self._quiet = 0
        self._health = TopicsHealth(self._republisher)
        self._reporter = Reporter(self)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DISCOVERY, self._discover, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)

    def _check_outputs(self, commands: bool) -> None:
        topics = self._republisher.topics
        outputs = [*topics.outputs, *(['joint_commands'] if commands else [])]
        published = [self.resolve_topic_name(name) for name in outputs]
        if both := topics.matching(published):
            raise InputError(
                f'{self._where} reads {both[0]}, which this node would publish too; move what it '
                'publishes with --ros-args -r __ns:=/measured'
            )

    def _present(self) -> dict[str, list[str]]:
        graph = dict(self.get_topic_names_and_types())
        return {name: graph[name] for name in self._republisher.topics.matching(graph)}

    def _discover(self) -> None:
        """Subscribe to topics of the map; begin when all are heard and no new one comes."""
        if self._republisher.plan is not None:
            return
        self._quiet += 1
        for name, types in self._present().items():
            if name not in self._sources:
                self._quiet = 0
                self._sources[name] = self._subscribe(name, types)
        heard = self._republisher.heard.keys() >= self._sources.keys()
        if self._republisher.awaited or self._quiet < (_SETTLED if heard else 3 * _SETTLED):
            return
        for name, group in self._republisher.begin().items():
            self._publish[name] = self._publisher(name, group.drives)
        plan = self._republisher.plan
        assert plan is not None
        publish_card(self, Card.of_source(plan.torque_at, plan.torque_unit, plan.derived))
        self.get_logger().info(f'republishing {", ".join(self._publish)}')

    def _subscribe(self, name: str, types: list[str]) -> Any:
        try:
            (kind,) = types
            message_class = get_message(kind)
        except (ValueError, AttributeError, ImportError, LookupError):
            raise InputError(
                f'{name} is of type {" and ".join(types)}, which this runtime does not know; '
                'source the workspace that defines it (ROS 2), or record the topic and import '
                'the bag'
            ) from None
        return self.create_subscription(message_class, name, partial(self._take, name), _ANY)

    def _take(self, name: str, message: Any) -> None:
        now = self.get_clock().now().nanoseconds
        for sample in self._republisher.take(name, now, message):
            self._publish[sample.group](sample)

    def _publisher(self, name: str, drives: tuple[str, ...]) -> Callable[[Sample], object]:
        if name == 'supply':
            publisher = self.create_publisher(BatteryState, name, _RELIABLE)
            return partial(_publish_supply, BatteryPublisher(publisher, 'supply', self._where))
        if name == 'drive_supply':
            publisher = self.create_publisher(DriveSupply, name, _RELIABLE)
            return partial(
                _publish_drives, SupplyPublisher(publisher, drives, 'topics', 1, drives)
            )
        publisher = self.create_publisher(JointState, name, _RELIABLE)
        if name == 'joint_commands':
            return partial(_publish_commands, publisher, list(drives))
        return JointStatePublisher(publisher, drives).take

    def _diagnose(self) -> None:
        self._reporter.say(self._health.report(time.monotonic(), self._present()))


def _publish_supply(publisher: BatteryPublisher, sample: Sample) -> None:
    voltage, current = sample.values[:2, 0].tolist()
    publisher.publish(Reading(sample.stamp, sample.stamp, voltage, current, None, 0.0), '')


def _publish_commands(publisher: Publisher, names: list[str], sample: Sample) -> None:
    message = JointState(name=names, position=sample.values[0].tolist())
    message.header.stamp = Time(nanoseconds=sample.stamp).to_msg()
    publisher.publish(message)


def _publish_drives(publisher: SupplyPublisher, sample: Sample) -> None:
    temperature = sample._replace(group='temperature', values=sample.values[4:])
    if (temperature.values == temperature.values).any():
        publisher.take_temperature(temperature)
    publisher.take(sample._replace(values=sample.values[:3]))


def run(options: argparse.Namespace) -> int:
    """Run the node until Ctrl-C; InputError for a map that does not fit the topics."""
    make = partial(TopicsNode, load_map(options.map), f'map {options.map}', options.commands)
    return run_node(make, options.ros_args)
