"""Service clients."""

import threading
import time
from typing import Any

from rclpy.impl.service_transport import ServiceEntity
from rclpy.qos import QoSProfile
from rclpy.task import Future


class Client(ServiceEntity):
    """Client of a service, which sends requests."""

    def __init__(self, node: Any, srv_type: Any, srv_name: str, qos_profile: QoSProfile):
        super().__init__(node, srv_type, srv_name, qos_profile, False)
        self._pending: dict[int, Future] = {}
        self._lock = threading.Lock()

    def call_async(self, request: Any) -> Future:
        """Send a request and return a Future of the response; the node must be spun meanwhile."""
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f'Expected {self.srv_type.Request}, got {type(request)}')
        future = Future()
        with self._lock:
            self._pending[self._alive().request(request)] = future
        return future

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request and return the response, which another thread's spin must receive.

        Raises TimeoutError after `timeout_sec`; None waits without limit.
        """
        done = threading.Event()
        future = self.call_async(request)
        future.add_done_callback(lambda _: done.set())
        if not done.wait(timeout_sec):
            with self._lock:
                self._pending = {key: f for key, f in self._pending.items() if f is not future}
            raise TimeoutError(f"no response from '{self.srv_name}' within {timeout_sec} s")
        return future.result()

    def service_is_ready(self) -> bool:
        """Return whether a server of the service is connected."""
        return self._alive().server_is_there()

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Block until a server is connected; False at timeout (s) or shutdown."""
        end = float('inf') if timeout_sec is None else time.monotonic() + timeout_sec
        while self.context.ok():
            if self.service_is_ready():
                return True
            if time.monotonic() >= end:
                return False
            time.sleep(min(0.02, max(0.0, end - time.monotonic())))
        return False

    def _is_mine(self, taken: tuple[int, int, int, Any]) -> bool:
        return taken[0] == self._alive().handle

    def _execute(self, taken: tuple[int, int, int, Any]) -> None:
        with self._lock:
            future = self._pending.pop(taken[1], None)
        if future is not None:
            future.set_result(taken[3])
