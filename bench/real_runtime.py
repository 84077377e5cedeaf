"""The embedded runtime and ROS 2 beside each other, and across: cost, latency and loss.

A source publishes `drive_supply` at 1 kHz and `joint_states` at 400 Hz, both of 12 drives, to a
sink in another process. Each of the four ways round is measured, one after the other.

    python bench/real_runtime.py [--seconds 60]
"""

import argparse
import json
import sys
import time
from array import array
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import rclpy
import runtimes
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.console import output, print_table
from wattwalk_core.processes import ChildProcess

from drive_power_msgs.msg import DriveSupply

HERE = Path(__file__).resolve()
DRIVES = list(JOINT_NAMES)
RATES = {'drive_supply': 1000.0, 'joint_states': 400.0}
QOS = QoSProfile(depth=1000)
WARM_UP = 2.0  # s, left out of costs and latencies


def _supply() -> Any:
    message = DriveSupply(name=DRIVES, device_time=array('Q', [1]), status=array('B', bytes(12)))
    message.voltage = message.current = message.temperature = array('f', range(12))
    return message


def _joints() -> Any:
    numbers = array('d', range(12))
    return JointState(name=DRIVES, position=numbers, velocity=numbers, effort=numbers)


class LoadSource(Node):
    """Publishes at the rates of the live system, with a running number in the frame_id.

    Late calls catch up. seconds: duration after the warm-up, which begins once both topics have a
    subscription.
    """

    def __init__(self, seconds: float) -> None:
        super().__init__('source', start_parameter_services=False)
        self.done = rclpy.Future()
        self.costs: dict[str, list[float]] = {name: [] for name in RATES}
        self.cpu = self.wall = 0.0
        self._messages = {'drive_supply': _supply(), 'joint_states': _joints()}
        self._wanted = {name: int(rate * (seconds + WARM_UP)) for name, rate in RATES.items()}
        self._publishers_by_topic = {
            name: self.create_publisher(type(message), name, QOS)
            for name, message in self._messages.items()
        }
        self._start = 0.0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.001, self.tick, clock=steady)

    def tick(self) -> None:
        """Publish the messages that are due."""
        publishers = self._publishers_by_topic
        if not all(publisher.get_subscription_count() for publisher in publishers.values()):
            return
        if self._start == 0.0:
            self._start = time.monotonic()
        elapsed = time.monotonic() - self._start
        if self.cpu == 0.0 and elapsed > WARM_UP:
            self.cpu, self.wall = time.process_time(), time.monotonic()
        for name, rate in RATES.items():
            due = min(int(elapsed * rate) + 1, self._wanted[name])
            while len(self.costs[name]) < due:
                self._send(name)
        finished = all(len(self.costs[name]) == count for name, count in self._wanted.items())
        if finished and not self.done.done():
            for publisher in publishers.values():
                publisher.wait_for_all_acked()
            self.done.set_result(None)

    def _send(self, name: str) -> None:
        message = self._messages[name]
        number = len(self.costs[name])
        message.header.frame_id = str(number)
        now = self.get_clock().now()
        message.header.stamp = now.to_msg()
        if name == 'drive_supply':
            message.sequence, message.device_time = number, array('Q', [now.nanoseconds])
        start = time.perf_counter()
        self._publishers_by_topic[name].publish(message)
        self.costs[name].append((time.perf_counter() - start) * 1e6)

    def figures(self) -> dict[str, float]:
        """Return by name: median cost of publish [µs], share of a core, messages sent."""
        share = (time.process_time() - self.cpu) / (time.monotonic() - self.wall)
        sent = {f'{name} sent': float(len(costs)) for name, costs in self.costs.items()}
        costs = {
            f'{name} publish': median(costs[int(WARM_UP * RATES[name]) :])
            for name, costs in self.costs.items()
        }
        return {**sent, **costs, 'source cpu': share}


class LoadSink(Node):
    """Records age and number of each message until none has come for two seconds."""

    def __init__(self) -> None:
        super().__init__('sink', start_parameter_services=False)
        self.done = rclpy.Future()
        self.ages: dict[str, list[float]] = {name: [] for name in RATES}
        self.order: dict[str, list[int]] = {name: [] for name in RATES}
        self.cpu = self.wall = self.used = self.last = 0.0
        for name, kind in (('drive_supply', DriveSupply), ('joint_states', JointState)):
            self.create_subscription(
                kind, name, lambda message, name=name: self.take(name, message), QOS
            )
        self.create_timer(0.5, self.watch, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def take(self, name: str, message: Any) -> None:
        """Record age and number of a message of topic `name`."""
        now = time.time_ns()
        stamp = message.header.stamp
        self.ages[name].append((now - stamp.sec * 1_000_000_000 - stamp.nanosec) / 1e3)
        self.order[name].append(int(message.header.frame_id))
        self.last = time.monotonic()

    def watch(self) -> None:
        """Begin to count CPU time after the warm-up, and end after the last message."""
        if self.last == 0.0:
            return
        if self.cpu == 0.0 and len(self.ages['drive_supply']) > WARM_UP * RATES['drive_supply']:
            self.cpu, self.wall = time.process_time(), time.monotonic()
        if time.monotonic() - self.last < 0.5 and self.cpu:
            self.used = (time.process_time() - self.cpu) / (time.monotonic() - self.wall)
        if time.monotonic() - self.last > 2.0 and not self.done.done():
            self.done.set_result(None)

    def figures(self) -> dict[str, float]:
        """Return by name: latencies [µs], share of a core, messages (0 unless all in order)."""
        result = {'sink cpu': self.used}
        for name, ages in self.ages.items():
            steady = sorted(ages[int(WARM_UP * RATES[name]) :])
            order = self.order[name]
            result[f'{name} received'] = float(order == list(range(len(order)))) * len(order)
            result[f'{name} latency'] = median(steady)
            result[f'{name} p99'] = steady[int(0.99 * len(steady))]
        return result


def _role(role: str, seconds: float) -> None:
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = LoadSource(seconds) if role == 'source' else LoadSink()
    try:
        rclpy.spin_until_future_complete(node, node.done)
    except (KeyboardInterrupt, ExternalShutdownException):
        return
    print(json.dumps(node.figures()), flush=True)
    node.destroy_node()
    rclpy.try_shutdown()


def measure(source: str, sink: str, seconds: float, domain: int) -> dict[str, float]:
    """Run a source and a sink, each on 'embedded' or 'ROS 2', in a domain; return their figures.

    Cost and latency are µs, CPU is a share of a core; `lost` counts messages that did not come or
    came out of order.
    """
    start = {'embedded': runtimes.embedded, 'ROS 2': runtimes.real}
    environment = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_DOMAIN_ID': str(domain)}
    figures: dict[str, float] = {}
    with TemporaryDirectory() as folder, ExitStack() as running:
        processes = []
        for role, runtime in (('sink', sink), ('source', source)):
            command = start[runtime](HERE, '--role', role, '--seconds', str(seconds))
            process = ChildProcess(command, Path(folder) / f'{role}.log', environment)
            processes.append(running.enter_context(process))
        for process in processes:
            process.succeed(seconds + 120.0)
            figures |= json.loads(next(line for line in process.lines if line.startswith('{')))
    figures['lost'] = sum(figures[f'{name} sent'] - figures[f'{name} received'] for name in RATES)
    return figures


def main(args: Sequence[str] | None = None) -> int:
    """Print a table of the four ways round; 0 also where there is only one runtime."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=10.0, help='of each way round')
    parser.add_argument('--role', choices=('source', 'sink'), help=argparse.SUPPRESS)
    options = parser.parse_args(args)
    if options.role:
        _role(options.role, options.seconds)
        return 0
    reason = runtimes.missing()
    if reason:
        print(f'skipped: {reason}')
        return 0
    ways = [(a, b) for a in ('embedded', 'ROS 2') for b in ('embedded', 'ROS 2')]
    with runtimes.reserved() as domain:
        results = {way: measure(*way, options.seconds, domain) for way in ways}
    costs = [f'{name} {figure}' for name in RATES for figure in ('publish', 'latency', 'p99')]
    rows = [(cost, *(f'{results[way][cost]:.0f} µs' for way in ways)) for cost in costs]
    rows += [
        (share, *(f'{100 * results[way][share]:.1f} %' for way in ways))
        for share in ('source cpu', 'sink cpu')
    ]
    rows.append(('lost', *(f'{results[way]["lost"]:.0f}' for way in ways)))
    columns = ('', *(f'{source} →\n{sink}' for source, sink in ways))
    title = f'1 kHz drive_supply and 400 Hz joint_states, {options.seconds:g} s each'
    print_table(output(), columns, rows, title)
    return 0


if __name__ == '__main__':
    sys.exit(main())
