"""The nodes of a bring-up as child processes that live and end as one."""

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, Self

from wattwalk_core.processes import ChildProcess, wait_until

from wattwalk_bringup import tether
from wattwalk_bringup.node_set import NodeCommand

_LOGGED: Final = re.compile(r'^\[(\w+)\] \[[\d.]+\] \[[\w.]+\]: ')
_ESCAPES: Final = re.compile(r'\x1b\[[0-9;]*[A-Za-z]')
_MOST: Final = 1 << 16  # bytes at once


class LogFollower:
    """Reads what a process has added to its log since the last time."""

    def __init__(self, path: Path) -> None:
        self.last = ''
        self._path, self._place, self._rest = path, 0, b''

    def new_lines(self) -> list[str]:
        """Return new lines that are not empty, without time and name of ROS's log.

        The newest one stays in `last`.
        """
        with self._path.open('rb') as log:
            log.seek(self._place)
            data = log.read(_MOST)
        self._place += len(data)
        *whole, self._rest = (self._rest + data).replace(b'\r', b'\n').split(b'\n')
        self._rest = self._rest[-_MOST:]
        lines = [line for part in whole if (line := _plain(part))]
        self.last = lines[-1] if lines else self.last
        return lines

    def rest(self) -> list[str]:
        """Return all lines up to the end of a log that grows no more."""
        lines: list[str] = []
        while self._place < self._path.stat().st_size:
            lines += self.new_lines()
        if line := _plain(self._rest):
            self._rest, self.last = b'', line
            lines.append(line)
        return lines


def _plain(line: bytes) -> str:
    text = _ESCAPES.sub('', line.decode(errors='replace')).strip()
    found = _LOGGED.match(text)
    if found is None:
        return text
    level = '' if found[1] == 'INFO' else f'{found[1].lower()}: '
    return f'{level}{text[found.end() :]}'


PATIENCE: Final = ((signal.SIGINT, 12.0), (signal.SIGTERM, 4.0))
"""Signals at the end, and the s that nodes have after each; then SIGKILL."""
HURRIED: Final = 2.0  # s between SIGTERM and SIGKILL after a second Ctrl-C
SOUND_ENDS: Final = (0, 128 + signal.SIGINT, -signal.SIGINT)
_FIRST: Final = ('policy', 'recorder')
"""Ended before the others: the last damping command is delivered, and is in the recording."""
_CPU_PERIOD: Final = 2.0  # s


class RunningNode:
    """A node as a child process: its state, share of a core, and lines of its log."""

    def __init__(self, name: str, line: Sequence[str], folder: Path) -> None:
        self.name = name
        tethered = [sys.executable, '-SE', tether.__file__, str(os.getpid()), *line]
        self.process = ChildProcess(tethered, folder / f'{name}.log')
        self.log = LogFollower(self.process.log)
        self.since = time.monotonic()
        self.state = 'starting'
        self.cpu_share = 0.0
        self._measured = (self.since, 0.0)
        self._unread: list[str] = []

    def update(self) -> list[str]:
        """Update state and share of a core; return the lines of its log since the last update."""
        self._look()
        lines, self._unread = self._unread, []
        return lines

    def _look(self) -> None:
        now = time.monotonic()
        code = self.process.returncode
        if code is None:
            before, used = self._measured
            if now - before >= _CPU_PERIOD:
                self._measured = (now, self.process.cpu_seconds())
                self.cpu_share = (self._measured[1] - used) / (now - before)
            self._unread += self.log.new_lines()
            if self.state == 'starting' and self.log.last:
                self.state, self.since = 'running', now
            return
        if self.state in ('starting', 'running', 'ending'):
            self.since, self.cpu_share = now, 0.0
            self.state = f'ended, code {code}' if code in SOUND_ENDS else f'failed, code {code}'
        self._unread += self.log.rest()

    def begin_end(self) -> None:
        """Interrupt the node with SIGINT, if it runs."""
        if self.process.running:
            self.state, self.since = 'ending', time.monotonic()
            self.process.interrupt()

    def failure(self) -> str | None:
        """Return one line about a node that has failed, None for others."""
        code = self.process.returncode
        if code is None or code in SOUND_ENDS:
            return None
        self._look()
        return f'{self.name} failed with code {code}: {self.log.last or "no output"}'


class NodeGroup:
    """Nodes that are started together and end together, the policy runner first.

    folder: of their logs. At the end of a `with` block none runs. InputError for a package that is
    not installed, before any is started.
    """

    def __init__(self, commands: Sequence[NodeCommand], folder: Path) -> None:
        # All lines are made first: a package that is not installed starts nothing.
        lines = {command.name: command.line() for command in commands}
        self.nodes: list[RunningNode] = []
        try:
            for name, line in lines.items():
                self.nodes.append(RunningNode(name, line, folder))
        except BaseException:
            self.kill()
            raise

    @property
    def ended(self) -> RunningNode | None:
        """The first node that has ended, one that failed before others; None while all run."""
        over = [node for node in self.nodes if not node.process.running]
        return min(over, key=lambda node: node.failure() is None, default=None)

    def failures(self) -> list[str]:
        """Return one line about each node that has failed."""
        return [text for node in self.nodes if (text := node.failure()) is not None]

    def end(self, look: Callable[[], None]) -> None:
        """End all nodes, within 48 s; look: called several times a second meanwhile."""
        first = [[node for node in self.nodes if node.name == name] for name in _FIRST]
        for stage in (*first, [node for node in self.nodes if node.name not in _FIRST]):
            for node in stage:
                node.begin_end()
            self._wait_for(stage, look)
        look()

    def _wait_for(self, stage: Sequence[RunningNode], look: Callable[[], None]) -> None:
        def over() -> bool:
            look()
            return not any(node.process.running for node in stage)

        for number, patience in PATIENCE:
            if number != signal.SIGINT:
                for node in stage:
                    node.process.send_signal(number)
            if wait_until(over, patience):
                return
        for node in stage:
            node.process.kill()

    def kill(self) -> None:
        """End what still runs within HURRIED s: time for a last damping command."""
        running = [node.process for node in self.nodes if node.process.running]
        try:
            for process in running:
                process.send_signal(signal.SIGTERM)
            wait_until(lambda: not any(process.running for process in running), HURRIED)
        finally:
            for process in running:
                process.kill()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
