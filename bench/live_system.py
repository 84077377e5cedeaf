"""The live system for benchmarks: each node in a process of its own."""

import re
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import domains
from wattwalk_core.processes import ChildProcess, find_program, wait_until


class LiveSystem:
    """
    Starts nodes by `ros2 run`, measures the share of a core that each takes, and ends them.

    The nodes are alone in a ROS domain, which is reserved from entering the context to its end.
    """

    def __init__(
        self, folder: Path, ros2: Callable[..., list[str]] = lambda *words: ['ros2', *words]
    ) -> None:
        """ros2: gives the command line of a `ros2` command; that of the path by default."""
        self._folder, self._ros2 = folder, ros2
        self._environment: dict[str, str] = {}
        self._domain = ExitStack()
        self._processes: dict[str, ChildProcess] = {}
        self._since: dict[str, tuple[float, float]] = {}

    def start(self, package: str, executable: str, *arguments: str) -> None:
        """Run an executable of a package; its output goes to a log in the folder."""
        program, *rest = self._ros2('run', package, executable, *arguments)
        command = [find_program(program), *rest]
        self._processes[executable] = ChildProcess(
            command, self._folder / f'{executable}.log', self._environment
        )

    def log(self, executable: str) -> str:
        """Return what a node has said so far."""
        return self._processes[executable].output

    def wait_for(self, executable: str, words: str, patience: float = 60.0) -> None:
        """Wait until a node has said some words; ProcessError where it never does."""
        self._processes[executable].wait_for_line(re.escape(words), patience)

    def check(self, executable: str) -> None:
        """Raise ProcessError if a node has ended."""
        self._processes[executable].check()

    def running(self, executable: str) -> bool:
        """Tell whether a node runs."""
        return self._processes[executable].running

    def mark(self, executables: Sequence[str]) -> None:
        """Count CPU time from now on."""
        for name in executables:
            self._since[name] = (time.monotonic(), self._processes[name].cpu_seconds())

    def share(self, executable: str) -> float:
        """Return CPU time over wall time since the mark: 1 is a core."""
        start, used = self._since[executable]
        now = self._processes[executable].cpu_seconds()
        return (now - used) / (time.monotonic() - start)

    def __enter__(self) -> Self:
        self._environment['ROS_DOMAIN_ID'] = str(self._domain.enter_context(domains.reserved()))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for process in self._processes.values():
            process.interrupt()
        for process in self._processes.values():
            wait_until(lambda child=process: not child.running, 10.0)
            process.kill()
        self._domain.close()
