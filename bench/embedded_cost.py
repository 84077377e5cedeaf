"""Cost of publishing and receiving a 12-joint JointState between two processes."""

import argparse
import json
import os
import subprocess
import sys
import time
from array import array
from collections.abc import Sequence
from statistics import median
from typing import Any

import domains
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rich.console import Console
from rich.table import Table
from sensor_msgs.msg import JointState

JOINTS = [f'{leg}_{joint}' for leg in ('LF', 'RF', 'LH', 'RH') for joint in ('HAA', 'HFE', 'KFE')]
QOS = QoSProfile(depth=1000)
WARM_UP = 500
"""Messages left out of the figures, while processes start."""
REFERENCE = {'publish_us': 54.0, 'latency_us': 172.0}
"""Real rclpy on Cyclone DDS on a two-core machine: middle of 45-63 and of 157-187 µs."""


def _message(number: int) -> Any:
    message = JointState()
    message.header.frame_id = str(number)
    message.name = JOINTS
    message.position = array('d', range(12))
    message.velocity = array('d', range(12))
    message.effort = array('d', range(12))
    return message


class Sink(Node):
    """Notes the age of each message; ends at the message without joints."""

    def __init__(self) -> None:
        super().__init__('sink', start_parameter_services=False)
        self.ages: list[float] = []
        self.cpu = 0.0
        self.done = rclpy.Future()
        self.create_subscription(JointState, 'joint_states', self.take, QOS)

    def take(self, message: Any) -> None:
        """Note the age [µs] of a message."""
        now = time.time_ns()
        if not message.name:
            self.done.set_result(None)
            return
        if len(self.ages) == WARM_UP:
            self.cpu = time.process_time()
        stamp = message.header.stamp
        self.ages.append((now - stamp.sec * 1_000_000_000 - stamp.nanosec) / 1e3)


def _sink() -> None:
    rclpy.init(args=[])
    node = Sink()
    try:
        rclpy.spin_until_future_complete(node, node.done)
    except (KeyboardInterrupt, ExternalShutdownException):
        return
    ages = sorted(node.ages[WARM_UP:])
    cpu = (time.process_time() - node.cpu) / max(1, len(ages)) * 1e6
    print(
        json.dumps(
            {
                'received': len(node.ages),
                'latency_us': median(ages),
                'latency_p99_us': ages[int(0.99 * len(ages))],
                'receive_cpu_us': cpu,
            }
        )
    )
    node.destroy_node()
    rclpy.try_shutdown()


class Source(Node):
    """Publishes at a rate and takes the time of each publish."""

    def __init__(self, rate: float, count: int):
        super().__init__('source', start_parameter_services=False)
        self.publisher = self.create_publisher(JointState, 'joint_states', QOS)
        self.costs: list[float] = []
        self.count = count
        self.done = rclpy.Future()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.timer = self.create_timer(1.0 / rate, self.tick, clock=steady)

    def tick(self) -> None:
        """Publish one message."""
        if self.publisher.get_subscription_count() == 0:
            return
        if len(self.costs) == self.count:
            self.timer.cancel()
            self.publisher.publish(JointState())
            self.publisher.wait_for_all_acked()
            self.done.set_result(None)
            return
        message = _message(len(self.costs))
        message.header.stamp = self.get_clock().now().to_msg()
        start = time.perf_counter()
        self.publisher.publish(message)
        self.costs.append((time.perf_counter() - start) * 1e6)


def _per_call(function: Any, *arguments: Any) -> float:
    count = 5000
    start = time.perf_counter()
    for _ in range(count):
        function(*arguments)
    return (time.perf_counter() - start) / count * 1e6


def measure(rate: float = 1000.0, seconds: float = 10.0) -> dict[str, float]:
    """
    Run source and sink and return their figures.

    Keys ending in `_us` are µs a message; `lost` counts messages. Costs are medians of wall
    time, `receive_cpu_us` is the CPU time of the receiving process, waiting and waking included.
    """
    with domains.reserved() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        command = [sys.executable, __file__, '--sink']
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as sink:
            rclpy.init(args=[])
            node = Source(rate, int(rate * seconds))
            try:
                rclpy.spin_until_future_complete(node, node.done)
                output, _ = sink.communicate(timeout=30.0)
            finally:
                sink.kill()
                node.destroy_node()
                rclpy.try_shutdown()
    figures = json.loads(output)
    message = _message(0)
    data = serialize_message(message)
    return {
        'publish_us': median(node.costs[WARM_UP:]),
        'serialize_us': _per_call(serialize_message, message),
        'deserialize_us': _per_call(deserialize_message, data, JointState),
        'receive_cpu_us': figures['receive_cpu_us'],
        'latency_us': figures['latency_us'],
        'latency_p99_us': figures['latency_p99_us'],
        'lost': len(node.costs) - figures['received'],
    }


def main(args: Sequence[str] | None = None) -> int:
    """Print the figures as a table beside those of ROS 2."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rate', type=float, default=1000.0, help='messages per second')
    parser.add_argument('--seconds', type=float, default=10.0, help='at least one')
    parser.add_argument('--sink', action='store_true', help=argparse.SUPPRESS)
    options = parser.parse_args(args)
    if options.sink:
        _sink()
        return 0
    figures = measure(options.rate, max(options.seconds, 2 * WARM_UP / options.rate))
    table = Table(title=f'JointState of 12 joints at {options.rate:g} Hz between two processes')
    for heading in ('what', 'here', 'ROS 2 rclpy', 'ratio'):
        table.add_column(heading, justify='left' if heading == 'what' else 'right')
    for name, value in figures.items():
        other = REFERENCE.get(name)
        unit = ' µs' if name.endswith('_us') else ''
        label = name.removesuffix('_us').replace('_', ' ')
        ratio = f'{value / other:.2f}' if other else ''
        table.add_row(label, f'{value:.1f}{unit}', f'{other:.0f}{unit}' if other else '', ratio)
    Console().print(table)
    return 0


if __name__ == '__main__':
    sys.exit(main())
