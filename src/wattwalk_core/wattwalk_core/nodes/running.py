"""Start, spin and end of a node: signals ask it to end and never raise into rclpy."""

import signal
import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import FrameType
from typing import Any, Final, Self

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from wattwalk_core.namespace import absolute_namespace

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
PATIENCE: Final = 4.0  # s for a callback, or the making of a node, to return after a signal
_NAMESPACE: Final = '__ns:='
SERVED: Final = 0.02  # s between turns of the executor of a node that polls


class EndSignals:
    """SIGINT and SIGTERM as the future `received`, which is done at the first of them.

    Handlers do nothing, as rclpy turns an exception in them into a RuntimeError: the interpreter
    writes each signal to a socket, and a thread sets the future. Where `hold` is not called within
    PATIENCE s of a signal, a callback hangs and is left by a KeyboardInterrupt. Later signals
    change nothing, also after the end: launch files send SIGINT twice. Without a signal the former
    handlers come back. To be entered in the main thread.
    """

    def __init__(self) -> None:
        self.received: Future = Future()
        self._idle = threading.Event()
        self._overdue = False
        self._thread = threading.Thread(target=self._watch, name='signals', daemon=True)

    def __enter__(self) -> Self:
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        self._former_fd = signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        self._former = {number: signal.signal(number, self._handle) for number in SIGNALS}
        self._thread.start()
        # Bring-ups start nodes with SIGINT held back until it can end them soundly.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
        return self

    def __exit__(self, *_: object) -> None:
        self.hold()
        signal.set_wakeup_fd(self._former_fd)
        for number, former in self._former.items():
            signal.signal(number, signal.SIG_IGN if self.received.done() else former)
        self._writer.close()
        self._thread.join()
        self._reader.close()

    def hold(self) -> None:
        """Let no later signal interrupt, so that the shutdown takes the time it needs."""
        self._idle.set()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._overdue and not self._idle.is_set():
            self._overdue = False
            raise KeyboardInterrupt

    def _watch(self) -> None:
        while numbers := self._reader.recv(64):
            if not self.received.done() and set(SIGNALS) & set(numbers):
                self.received.set_result(None)
                if not self._idle.wait(PATIENCE):
                    self._overdue = True
                    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def spin(node: Node, *until: Future) -> None:
    """Run a node's callbacks until a future is done or the context is shut down.

    A node may have a method `poll`, which empties its polled topics and returns the
    time in s until it wants to be called again. The executor, whose turns are slow on rclpy, then
    serves parameters, services and timers at most 50 times a second; on ROS time it serves the
    clock in between, too.
    Errors of a callback are raised, but for a RuntimeError of a context that was shut down
    while the callback was at work.
    """
    # Executor.spin_until_future_complete of ROS 2 Jazzy adds a callback to the future at each
    # turn, which is a leak of some GB a day at 1 kHz.
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    poll: Callable[[], float] | None = getattr(node, 'poll', None)
    over = threading.Lock()

    def wake(_: Future) -> None:
        with over:
            if spinning:
                executor.create_task(lambda: None)

    spinning = True
    turn = executor.spin_once if poll is None else _polling_turn(node, poll, executor)
    try:
        for future in until:
            future.add_done_callback(wake)
        while node.context.ok() and not any(future.done() for future in until):
            turn()
    except ExternalShutdownException:
        return
    except RuntimeError:
        if node.context.ok():
            raise
    finally:
        with over:
            spinning = False
        executor.remove_node(node)
        executor.shutdown()


def _polling_turn(
    node: Node, poll: Callable[[], float], executor: SingleThreadedExecutor
) -> Callable[[], None]:
    """Return what polls a node, then serves the executor or sleeps until the next poll."""
    on_ros_time = bool(node.get_parameter('use_sim_time').value)
    due = time.monotonic()

    def turn() -> None:
        nonlocal due
        wait = max(poll(), 0.0)
        now = time.monotonic()
        if on_ros_time:
            executor.spin_once(timeout_sec=wait)
        elif now >= due:
            due = now + SERVED
            executor.spin_once(timeout_sec=0.0)
        else:
            time.sleep(min(wait, due - now))

    return turn


def run_node(make: Callable[[], Any], arguments: Sequence[str]) -> int:
    """Make a node, run it until its end, stop and destroy it; return the exit code.

    make: gives the node, with the context started. arguments: with those of ROS.
    The end is SIGINT, SIGTERM, a shutdown of the context, an error of a callback, which is
    raised, or the node's future `done`, where it has one, whose result is the exit code (None: 0).
    Then the node's method `stop` is called, where it has one: the context is still valid, so that
    last messages can be published, and no signal interrupts it. It has to return in bounded time;
    a number that it returns is the exit code.
    InputError for a namespace that no node can have.
    """
    # rclpy refuses a relative namespace with a traceback, and some only when a node is made.
    arguments = [
        f'{_NAMESPACE}{absolute_namespace(given.removeprefix(_NAMESPACE))}'
        if given.startswith(_NAMESPACE)
        else given
        for given in arguments
    ]
    code: int | None = None
    with EndSignals() as signals:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        try:
            with suppress(KeyboardInterrupt):
                node = make()
                try:
                    code = _run(node, signals)
                finally:
                    node.destroy_node()
        finally:
            signals.hold()
            rclpy.try_shutdown()
    return code or 0


def _run(node: Any, signals: EndSignals) -> int | None:
    done: Future | None = getattr(node, 'done', None)
    stop: Callable[[], int | None] = getattr(node, 'stop', lambda: None)
    try:
        with suppress(KeyboardInterrupt):
            spin(node, signals.received, *(() if done is None else (done,)))
    finally:
        signals.hold()
        code = stop()
    return done.result() if code is None and done is not None and done.done() else code
