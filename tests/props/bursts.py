"""Publishes numbered electrical samples in bursts of 500, longer than a recorder's short queue."""

import sys

from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from wattwalk_core.nodes.running import run_node

from drive_power_msgs.msg import DriveSupply

BURST, BURSTS = 500, 20


class Bursts(Node):
    """Waits for a subscriber, then sends a burst each 0.1 s."""

    def __init__(self):
        super().__init__('bursts')
        self.publisher = self.create_publisher(DriveSupply, 'drive_supply', 1000)
        self.sent, self.done = 0, Future()
        self.create_timer(0.1, self.speak)

    def speak(self):
        if self.publisher.get_subscription_count() == 0:
            return
        for _ in range(BURST):
            message = DriveSupply(sequence=self.sent, device_time=[self.sent * 1_000_000])
            message.name, message.voltage, message.current = ['LF_KFE'], [48.0], [1.0]
            message.status = [0]
            message.header.stamp = Time(nanoseconds=10**18 + self.sent * 10**6).to_msg()
            self.publisher.publish(message)
            self.sent += 1
        if self.sent == BURST * BURSTS:
            print(f'sent {self.sent}', flush=True)
            self.done.set_result(0)


if __name__ == '__main__':
    sys.exit(run_node(Bursts, sys.argv))
