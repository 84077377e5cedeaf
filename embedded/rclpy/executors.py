"""Executors: they wait for messages, requests and timers and call back."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from cyclonedds.core import GuardCondition

from rclpy.context import Context
from rclpy.impl.transport import EntityWaitSet
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.utilities import get_default_context

LONGEST_WAIT_NS = 100_000_000


class ExternalShutdownException(Exception):  # noqa: N818
    """Raised when the context is shut down while spinning, for instance by SIGTERM."""


class SingleThreadedExecutor:
    """Runs all callbacks, one after the other, in the thread that spins."""

    def __init__(self, *, context: Context | None = None):
        self.context = get_default_context() if context is None else context
        self._lock = threading.RLock()
        self._nodes: list[Any] = []
        self._ready: deque[tuple[Callable[[Any], None], Any]] = deque()
        self._timers: list[Timer] = []
        self._stale = True
        self._is_shutdown = False
        self._wait_set: EntityWaitSet | None = None
        self._guard: GuardCondition | None = None
        self._takers: dict[int, tuple[Any, Callable[[], list[Any]]]] = {}
        self.context._executors.add(self)

    def add_node(self, node: Any) -> bool:
        """Add a node, whose callbacks are then run; False if it was added before."""
        with self._lock:
            if node in self._nodes:
                return False
            if node.executor is not None and node.executor is not self:
                node.executor.remove_node(node)
            self._nodes.append(node)
            node._executor = self
        self.wake(changed=True)
        return True

    def remove_node(self, node: Any) -> None:
        """Remove a node, whose callbacks are then no longer run."""
        with self._lock:
            if node not in self._nodes:
                return
            self._nodes.remove(node)
            node._executor = None
        self.forget()

    def wake(self, changed: bool = False) -> None:
        """Interrupt waiting; `changed`: nodes have new or fewer entities (timers, topics …)."""
        if changed:
            self._stale = True
        guard = self._guard  # another thread may release it meanwhile
        if guard is not None:
            guard.set(True)

    def forget(self) -> None:
        """Release entities that the nodes have destroyed, at once."""
        if self._wait_set is not None:
            self._refresh()
        self.wake()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop spinning and remove all nodes; return True. The timeout is ignored."""
        self._is_shutdown = True
        self.wake()
        with self._lock:
            for node in self._nodes:
                node._executor = None
            self._nodes.clear()
            self._stale = True
            self._ready.clear()
            self._takers.clear()
            self._timers = []
            self._wait_set = self._guard = None
        return True

    def _refresh(self) -> None:
        """Attach what the nodes have now, detach what they no longer have."""
        with self._lock:
            self._stale = False
            if self._wait_set is None:
                self._guard = GuardCondition(self.context.participant.dds)
                self._wait_set = EntityWaitSet(self.context.participant)
                self._wait_set.attach(self._guard)
            wanted = {
                id(entity): (entity, take)
                for node in self._nodes
                for entity, take in node._conditions()
            }
            timers = [timer for node in self._nodes for timer in node.timers]
            for key in self._takers.keys() - wanted.keys():
                self._wait_set.detach(self._takers[key][0])
            for key in wanted.keys() - self._takers.keys():
                self._wait_set.attach(wanted[key][0])
            self._takers, self._timers = wanted, timers

    def _wait_ns(self, deadline: int | None) -> int:
        wait = LONGEST_WAIT_NS
        if deadline is not None:
            wait = min(wait, deadline - time.monotonic_ns())
        for timer in self._timers:
            if timer._follows_wall_time():
                left = timer.time_until_next_call()
                if left is not None:
                    wait = min(wait, left)
        return max(wait, 0)

    def _collect(self, deadline: int | None) -> None:
        """Wait once and queue what is due."""
        if self._stale:
            self._refresh()
        wait_set, guard = self._wait_set, self._guard
        if wait_set is None or guard is None:
            return
        triggered = wait_set.wait_for_entities(self._wait_ns(deadline))
        for timer in self._timers:
            if timer._advance() and timer.callback is not None:
                self._ready.append((_call_timer, timer))
        for entity in triggered:
            if entity is guard:
                guard.set(False)
                continue
            _, take = self._takers.get(id(entity), (None, None))
            if take is not None:
                self._ready.extend(take())

    def _work(self, deadline: int | None) -> bool:
        """Run one callback, after waiting for it; False at the deadline."""
        while not self._ready:
            self._collect(deadline)
            if self._is_shutdown:
                return False
            if not self.context.valid:
                self._ready.clear()
                raise ExternalShutdownException
            if not self._ready and deadline is not None and time.monotonic_ns() >= deadline:
                return False
        function, argument = self._ready.popleft()
        function(argument)
        return True

    def create_task(self, callback: Callable[[], Any]) -> None:
        """Schedule a callback to run once in the spinning thread; callable from any thread."""
        self._ready.append((_call, callback))
        self.wake()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for one callback, at most `timeout_sec` [s], and run it.

        Raises ExternalShutdownException after shutdown of the context.
        """
        if not self.context.valid:
            raise ExternalShutdownException
        self._work(_deadline(timeout_sec))

    def spin(self) -> None:
        """Run callbacks until shutdown."""
        while self.context.valid and not self._is_shutdown:
            self._work(None)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Run callbacks until a future is done, at most `timeout_sec` [s]."""
        future.add_done_callback(lambda _: self.wake())
        deadline = _deadline(timeout_sec)
        while self.context.valid and not future.done() and not self._is_shutdown:
            step = time.monotonic_ns() + LONGEST_WAIT_NS
            self._work(step if deadline is None else min(step, deadline))
            if deadline is not None and time.monotonic_ns() >= deadline:
                return


def _deadline(timeout_sec: float | None) -> int | None:
    if timeout_sec is None or timeout_sec < 0:
        return None
    return time.monotonic_ns() + int(timeout_sec * 1e9)


def _call(callback: Callable[[], Any]) -> None:
    callback()


def _call_timer(timer: Timer) -> None:
    if not timer.is_canceled() and timer.callback is not None:
        timer.callback()
