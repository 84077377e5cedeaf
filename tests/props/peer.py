"""
Talks to a peer on the other runtime, in every way that the suite's nodes do.

`talk` publishes a message of each type, serves a service and has parameters; `hear` says what of
that reaches it: a line `heard TOPIC` for each message that is as it was sent.
"""

import argparse
import sys

import rclpy
from contents import MESSAGES
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.utilities import remove_ros_args
from std_srvs.srv import SetBool, Trigger

from drive_power_msgs.msg import PowerEstimate

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Talker(Node):
    """Publishes ten times a second; what it latched, it sent once, before anybody listened."""

    def __init__(self):
        super().__init__('talker')
        span = FloatingPointRange(from_value=0.0, to_value=10.0)
        gain = ParameterDescriptor(description='gain, 1', floating_point_range=[span])
        self.declare_parameter('gain', 1.5, gain)
        self.declare_parameter('device', 'board', ParameterDescriptor(read_only=True))
        self.declare_parameter('enabled', False)
        self.declare_parameter('count', 3)
        self.declare_parameter('rates', [1000.0, 400.0])
        self.latched = self.create_publisher(PowerEstimate, 'latched', LATCHED)
        self.latched.publish(PowerEstimate(total=42.0))
        self.made = {
            self.create_publisher(type(make()), topic, 10): make()
            for topic, make in MESSAGES.items()
        }
        self.create_service(Trigger, 'push', self.push)
        self.create_service(SetBool, 'enable', self.enable)
        self.create_timer(0.1, self.tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        print('talking', flush=True)

    def tick(self):
        for publisher, message in self.made.items():
            publisher.publish(message)

    def push(self, request, response):
        response.success, response.message = True, 'pushed by 0.30 m/s'
        return response

    def enable(self, request, response):
        response.success, response.message = request.data, 'enabled' if request.data else 'off'
        return response


class Hearer(Node):
    """Compares what it hears with what the talker is to say."""

    def __init__(self):
        super().__init__('hearer')
        self.heard = set()
        for topic, make in MESSAGES.items():
            wanted = make()
            self.create_subscription(
                type(wanted),
                topic,
                lambda message, topic=topic, wanted=wanted: self.take(topic, message, wanted),
                10,
            )
        self.create_subscription(PowerEstimate, 'latched', self.take_latched, LATCHED)
        self.trigger = self.create_client(Trigger, 'push')
        self.switch = self.create_client(SetBool, 'enable')
        self.asked = False
        self.create_timer(0.1, self.ask, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def take(self, topic, message, wanted):
        if topic not in self.heard:
            self.heard.add(topic)
            same = repr(message) == repr(wanted)
            print(f'heard {topic}' if same else f'differs: {message} {wanted}', flush=True)

    def take_latched(self, message):
        print(f'heard latched {message.total}', flush=True)

    def ask(self):
        ready = self.trigger.service_is_ready() and self.switch.service_is_ready()
        if self.asked or not ready:
            return
        self.asked = True
        self.trigger.call_async(Trigger.Request()).add_done_callback(self.answered)
        for data in (True, False):
            future = self.switch.call_async(SetBool.Request(data=data))
            future.add_done_callback(self.answered)

    def answered(self, future):
        answer = future.result()
        print(f'answered {answer.success} {answer.message}', flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('role', choices=('talk', 'hear'))
    options = parser.parse_args(remove_ros_args(sys.argv)[1:])
    rclpy.init()
    node = {'talk': Talker, 'hear': Hearer}[options.role]()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
