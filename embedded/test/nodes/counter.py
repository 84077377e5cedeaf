"""Publishes joint states with a running number, or counts what of them comes."""

import argparse
import sys

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState

JOINTS = [f'{leg}_{joint}' for leg in ('LF', 'RF', 'LH', 'RH') for joint in ('HAA', 'HFE', 'KFE')]


def profile(options):
    qos = QoSProfile(depth=options.depth)
    if options.best_effort:
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
    if options.transient_local:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return qos


class Source(Node):
    """Sends `count` messages once a subscription is there, at once where none is asked for."""

    def __init__(self, options):
        super().__init__('source')
        self.left, self.wait = options.count, not options.at_once
        self.sent = 0
        self.publisher = self.create_publisher(JointState, 'numbers', profile(options))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.timer = self.create_timer(options.period, self.tick, clock=steady)

    def tick(self):
        if self.wait and self.publisher.get_subscription_count() == 0:
            return
        self.wait = False
        if self.sent == self.left:
            self.timer.cancel()
            print(f'sent {self.sent}', flush=True)
            return
        message = JointState(name=JOINTS, position=[float(self.sent)] * 12)
        message.header.stamp = self.get_clock().now().to_msg()
        self.publisher.publish(message)
        self.sent += 1


class Sink(Node):
    """Prints the number of messages and of gaps once the last one is there."""

    def __init__(self, options):
        super().__init__('sink')
        self.numbers = []
        self.last = options.count - 1
        self.create_subscription(JointState, 'numbers', self.take, profile(options))
        print('listening', flush=True)

    def take(self, message):
        self.numbers.append(int(message.position[11]))
        if self.numbers[-1] == self.last:
            gaps = sum(b != a + 1 for a, b in zip(self.numbers, self.numbers[1:], strict=False))
            print(f'received {len(self.numbers)} gaps {gaps} first {self.numbers[0]}', flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('role', choices=('source', 'sink'))
    parser.add_argument('--count', type=int, default=1)
    parser.add_argument('--period', type=float, default=0.01)
    parser.add_argument('--depth', type=int, default=10)
    parser.add_argument('--best-effort', action='store_true')
    parser.add_argument('--transient-local', action='store_true')
    parser.add_argument('--at-once', action='store_true')
    options = parser.parse_args(remove_ros_args(sys.argv)[1:])
    rclpy.init()
    node = {'source': Source, 'sink': Sink}[options.role](options)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
