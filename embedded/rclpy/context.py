"""The state between init and shutdown: arguments, participant, graph."""

import atexit
import gc
import os
import sys
import threading
from collections.abc import Sequence
from typing import Any
from weakref import WeakSet

from rclpy import logging, signals
from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import NotInitializedException
from rclpy.impl.arguments import RosArguments, parse
from rclpy.impl.graph import Graph
from rclpy.impl.transport import Participant, domain_configuration

MAX_DOMAIN_ID = 232

# Python's last garbage collection takes longer than all else that a node does at its end.
atexit.register(gc.freeze)


def _domain_id(given: int | None) -> int:
    if given is not None:
        if given < 0:
            raise RuntimeError(f'Domain id ({given}) should not be lower than zero.')
        return given
    text = os.environ.get('ROS_DOMAIN_ID') or '0'
    if not text.isdecimal() or int(text) > MAX_DOMAIN_ID:
        raise RCLError(
            f"Failed to initialize init_options: ROS_DOMAIN_ID is '{text}', "
            f'it must be an integer from 0 to {MAX_DOMAIN_ID}'
        )
    return int(text)


def _refuse_security() -> None:
    """Raise RCLError where security is asked for, with either strategy.

    This runtime has none: its nodes would talk in the clear to whoever is on the network.
    """
    if os.environ.get('ROS_SECURITY_ENABLE') == 'true':
        raise RCLError(
            "Failed to initialize init_options: ROS_SECURITY_ENABLE is 'true', but the embedded "
            'runtime has no security: run this on ROS 2 Jazzy, or unset ROS_SECURITY_ENABLE'
        )


class Context:
    """State of rclpy from init to shutdown; it cannot be started twice."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._executors: WeakSet[Any] = WeakSet()
        self._nodes: WeakSet[Any] = WeakSet()
        self._participant: Participant | None = None
        self._graph: Graph | None = None
        self._domain_id = 0
        self._configuration = ''
        self.arguments = RosArguments()
        self.initialized = False
        self.valid = False

    def init(self, args: Sequence[str] | None = None, *, domain_id: int | None = None) -> None:
        """Start the context; args: default to those of the process.

        Raises RuntimeError on a second call, RCLError for environment variables that are invalid
        or require security, UnknownROSArgsError or RCLInvalidROSArgsError for invalid arguments.
        """
        with self._lock:
            if self.initialized:
                raise RuntimeError('Context.init() must only be called once')
            _refuse_security()
            self._domain_id = _domain_id(domain_id)
            self._configuration = domain_configuration()
            self.arguments = parse(sys.argv if args is None else args)
            for name, level in self.arguments.log_levels.items():
                logging.set_logger_level(name, logging.LoggingSeverity[level.upper()])
            self.initialized = self.valid = True
        signals._watch(self)
        atexit.register(self._close)

    def ok(self) -> bool:
        """Return whether the context was started and not shut down."""
        return self.valid

    @property
    def participant(self) -> Participant:
        """DDS participant, made when it is first used."""
        with self._lock:
            if self._participant is None:
                if not self.valid:
                    raise NotInitializedException()
                self._participant = Participant(
                    self._domain_id, self._configuration, self.arguments.enclave
                )
            return self._participant

    @property
    def graph(self) -> Graph:
        """Graph of the nodes, topics and services of the domain."""
        with self._lock:
            if self._graph is None:
                self._graph = Graph(self.participant)
            return self._graph

    def _interrupt(self) -> None:
        """Become invalid and wake what waits; a signal handler may call this."""
        self.valid = False
        self._wake()

    def _wake(self) -> None:
        for executor in list(self._executors):
            executor.wake()

    def shutdown(self) -> None:
        """Shut down; RuntimeError if it was not started, RCLError if it was shut down before."""
        if not self.initialized:
            raise RuntimeError('Context must be initialized before it can be shutdown')
        was_valid = self.valid
        self._close()
        if not was_valid:
            raise RCLError('failed to shutdown: rcl_shutdown already called on the given context')

    def try_shutdown(self) -> None:
        """Shut down if it was started and is not shut down; raise nothing."""
        if self.initialized:
            self._close()

    def _close(self) -> None:
        """Leave the domain, so that other processes see the nodes go."""
        atexit.unregister(self._close)
        self.valid = False
        for executor in list(self._executors):
            executor.shutdown()
        for node in list(self._nodes):
            node._release()
        with self._lock:
            if self._graph is not None:
                self._graph.close()
            self._graph = self._participant = None
