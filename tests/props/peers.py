"""Peer of the nodes under test: a node of the test's own, spun in a thread."""

import threading
import time
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from std_srvs.srv import Trigger

PATIENCE = 60.0


class Peer:
    """A node in a context of its own; `speak` is called at 100 Hz once it is `open`."""

    def __init__(self, name, *services):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(name, context=self.context)
        self.triggers = {name: self.node.create_client(Trigger, name) for name in services}

    def open(self):
        self.timer = self.node.create_timer(0.01, self.speak)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def _spin(self):
        with suppress(ExternalShutdownException):
            self.executor.spin()

    def speak(self):
        raise NotImplementedError

    def call(self, name):
        client = self.triggers[name]
        assert client.wait_for_service(timeout_sec=PATIENCE)
        future = client.call_async(Trigger.Request())
        wait_until(future.done, f'an answer of {name}')
        return future.result()

    def close(self):
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)
        self.thread.join(PATIENCE)


def wait_until(condition, what):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, f'{what} never came'
        time.sleep(0.01)
