"""Fixtures for tests across processes: a ROS domain of their own, and nodes run in it."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import domains
import pytest
from hypothesis import settings
from synthetic_walk import Walk

# The same examples in every run; HYPOTHESIS_RANDOM=1 looks for new ones.
settings.register_profile('same', derandomize=not os.environ.get('HYPOTHESIS_RANDOM'))
settings.load_profile('same')

PATIENCE = 30.0
DAEMON_PORT = 11511
ENDED_BY_INTERRUPT = (0, 130, -signal.SIGINT)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Live systems run one at a time: two of them need more than two cores."""
    for item in items:
        if 'node_process' in getattr(item, 'fixturenames', ()):
            item.add_marker(pytest.mark.xdist_group('live'))


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a ROS domain for one test and set it in the environment."""
    with domains.reserved() as domain:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        yield domain


@pytest.fixture
def walk() -> Callable[..., Walk]:
    """Makes a recording of `seconds` to be changed and written."""
    return Walk


class NodeProcess:
    """A running process whose output, stderr included, can be waited for."""

    def __init__(self, command: Sequence[str], environment: dict[str, str]):
        self.command = list(command)
        self.ended_by_interrupt: tuple[int, ...] = ENDED_BY_INTERRUPT
        self.lines: list[str] = []
        self._news = threading.Condition()
        self._process = subprocess.Popen(
            self.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._news:
                self.lines.append(line.rstrip('\n'))
                self._news.notify_all()
        with self._news:
            self._news.notify_all()

    @property
    def output(self) -> str:
        """Everything written so far."""
        return '\n'.join(self.lines)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """Exit code, None while it runs."""
        return self._process.poll()

    def wait_for_output(self, pattern: str, timeout: float = PATIENCE) -> re.Match[str]:
        """Wait for a line that a regular expression is found in; fail where none comes."""
        deadline = time.monotonic() + timeout
        seen = 0
        with self._news:
            while True:
                while seen < len(self.lines):
                    match = re.search(pattern, self.lines[seen])
                    seen += 1
                    if match is not None:
                        return match
                left = deadline - time.monotonic()
                if left <= 0 or not self._reader.is_alive():
                    break
                self._news.wait(min(left, 0.2))
        pytest.fail(f'no {pattern!r} in the output of {self.command}:\n{self.output}')

    def send_signal(self, number: int) -> None:
        """Send a signal to the process and, as a terminal does, to its children."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)

    def interrupt(self) -> None:
        """Do what Ctrl-C does."""
        self.send_signal(signal.SIGINT)

    def wait(self, timeout: float = PATIENCE) -> int:
        """Wait for the end and return the exit code; fail where it does not end."""
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            pytest.fail(f'{self.command} did not end; its output:\n{self.output}')
        self._reader.join(timeout)
        return code

    def stop(self) -> None:
        """Interrupt what still runs and make sure that it ends in good order."""
        if self.returncode is None:
            self.interrupt()
            code = self.wait()
            assert code in self.ended_by_interrupt, f'{self.command} exited {code}:\n{self.output}'

    def kill(self) -> None:
        """End it and its children without asking."""
        self.send_signal(signal.SIGKILL)
        self._process.wait()


def _stop_daemon(domain: int) -> None:
    """End the daemon that ROS 2's command line tools leave behind."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        if probe.connect_ex(('127.0.0.1', DAEMON_PORT + domain)) != 0:
            return
    ros2 = shutil.which('ros2')
    assert ros2 is not None, 'a daemon of ROS 2 runs without the ros2 command'
    subprocess.run([ros2, 'daemon', 'stop'], check=True, stdout=subprocess.DEVNULL)


class NodeProcesses:
    """Starts processes in the test's domain and remembers them."""

    def __init__(self) -> None:
        self.started: list[NodeProcess] = []
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            # Started in the background of a shell; children would inherit deafness to Ctrl-C.
            signal.signal(signal.SIGINT, signal.default_int_handler)

    def __call__(self, package: str, executable: str, *arguments: str) -> NodeProcess:
        """Start `ros2 run package executable arguments…`."""
        return self.command('ros2', 'run', package, executable, *arguments)

    def ros2(self, *arguments: str) -> NodeProcess:
        """Start `ros2 arguments…`, which exits with the number of the signal that ends it."""
        process = self.command('ros2', *arguments)
        process.ended_by_interrupt = (*ENDED_BY_INTERRUPT, signal.SIGINT)
        return process

    def python(self, *arguments: str | Path, **environment: str) -> NodeProcess:
        """Start this Python, for instance with a script or `-m module`."""
        return self.command(sys.executable, *arguments, **environment)

    def command(self, *arguments: str | Path, **environment: str) -> NodeProcess:
        """Start any command; keywords are added to its environment."""
        first, *rest = map(str, arguments)
        beside = Path(sys.executable).parent / first
        found = str(beside) if beside.is_file() else shutil.which(first)
        assert found is not None, f'{first} is not installed'
        added = {'PYTHONUNBUFFERED': '1', **environment}
        process = NodeProcess([found, *rest], {**os.environ, **added})
        self.started.append(process)
        return process


@pytest.fixture
def node_process(ros_domain: int) -> Iterator[NodeProcesses]:
    """
    Start processes in a domain of the test's own.

    `node_process('power_daq', 'daq', '--ros-args', '-p', 'a:=1')` runs an executable of a
    package; `.ros2(…)`, `.python(…)` and `.command(…)` run the rest. At the end, whatever still
    runs is interrupted and must exit with 0 or as Ctrl-C makes it.
    """
    processes = NodeProcesses()
    try:
        yield processes
        for process in reversed(processes.started):
            process.stop()
    finally:
        for process in processes.started:
            process.kill()
        _stop_daemon(ros_domain)
