"""The live system for benchmarks: each node in a process of its own."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import domains

TICKS = os.sysconf('SC_CLK_TCK')


class BenchError(Exception):
    """A process of the live system failed."""


class LiveSystem:
    """
    Starts nodes by `ros2 run`, tells what share of a core each takes, and ends them.

    The nodes are alone in a ROS domain, which is reserved from entering the context to its end.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._environment = {**os.environ, 'PYTHONUNBUFFERED': '1'}
        self._domain = ExitStack()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._since: dict[str, tuple[float, float]] = {}

    def start(self, package: str, executable: str, *arguments: str) -> None:
        """Run an executable of a package; its output goes to a log in the folder."""
        beside = Path(sys.executable).with_name('ros2')
        ros2 = str(beside) if beside.is_file() else shutil.which('ros2')
        if ros2 is None:
            raise BenchError('no ros2 command; run `make setup` or source ROS 2')
        with (self._folder / f'{executable}.log').open('w') as log:
            self._processes[executable] = subprocess.Popen(
                [ros2, 'run', package, executable, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                start_new_session=True,
            )

    def log(self, executable: str) -> str:
        """What a node has said so far."""
        return (self._folder / f'{executable}.log').read_text(errors='replace')

    def wait_for(self, executable: str, words: str, patience: float = 60.0) -> None:
        """Wait until a node has said some words."""
        deadline = time.monotonic() + patience
        while words not in self.log(executable):
            self.check(executable)
            if time.monotonic() > deadline:
                raise BenchError(f'{executable} did not say {words!r}:\n{self.log(executable)}')
            time.sleep(0.1)

    def check(self, executable: str) -> None:
        """Raise BenchError if a node has ended."""
        if self._processes[executable].poll() is not None:
            raise BenchError(f'{executable} ended:\n{self.log(executable)}')

    def running(self, executable: str) -> bool:
        """Whether a node runs."""
        return self._processes[executable].poll() is None

    def mark(self, executables: Sequence[str]) -> None:
        """Count CPU time from now on."""
        for name in executables:
            self._since[name] = (time.monotonic(), self._cpu(name))

    def share(self, executable: str) -> float:
        """CPU time over wall time since the mark: 1 is a core."""
        start, used = self._since[executable]
        return (self._cpu(executable) - used) / (time.monotonic() - start)

    def _cpu(self, executable: str) -> float:
        group = self._processes[executable].pid
        total = 0.0
        for entry in Path('/proc').iterdir():
            if not entry.name.isdigit():
                continue
            try:
                fields = (entry / 'stat').read_text().rsplit(')', 1)[1].split()
            except OSError:
                continue
            if int(fields[2]) == group:
                total += (int(fields[11]) + int(fields[12])) / TICKS
        return total

    def __enter__(self) -> Self:
        self._environment['ROS_DOMAIN_ID'] = str(self._domain.enter_context(domains.reserved()))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number in (signal.SIGINT, signal.SIGKILL):
            for process in self._processes.values():
                if process.poll() is None:
                    os.killpg(process.pid, number)
            for process in self._processes.values():
                try:
                    process.wait(10.0)
                except subprocess.TimeoutExpired:
                    continue
        self._domain.close()
