"""Fixtures for tests across processes: a ROS domain of their own, and nodes run in it."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest
import runtimes
from hypothesis import settings
from synthetic_walk import Walk
from wattwalk_core.processes import PATIENCE, ChildProcess, ProcessError, find_program

# The same examples in every run; HYPOTHESIS_RANDOM=1 looks for new ones.
settings.register_profile('same', derandomize=not os.environ.get('HYPOTHESIS_RANDOM'))
settings.load_profile('same')
# Tests share no index with the user nor with each other.
os.environ['WATTWALK_INDEX'] = ''

DAEMON_PORT = 11511
_BEHIND = 10  # nice value: a ninth of the weight of a live test
_OWN = os.getpriority(os.PRIO_PROCESS, 0)
SLOW_FILES = {*(Path(__file__).parent / 'tests' / 'slow_files.txt').read_text().split()}
"""Files whose tests took 2 s of CPU and more together, `make test-fast` leaves them out."""
ENDED_BY_INTERRUPT = (0, 130, -signal.SIGINT)
IS_EMBEDDED = find_spec('rosidl_embedded') is not None


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option of `make test-fast`."""
    parser.addoption('--fast', action='store_true', help='leave out what starts processes or fits')


def pytest_configure(config: pytest.Config) -> None:
    """Give each of several workers one thread a matrix product: they would wait for each other."""
    if config.getoption('numprocesses', None):
        for library in ('OMP', 'OPENBLAS', 'MKL'):
            os.environ.setdefault(f'{library}_NUM_THREADS', '1')


def is_fast(item: pytest.Item) -> bool:
    """Tell whether a test starts no node and is in no file that takes long."""
    started = {'node_process', 'ros_domain'} & {*getattr(item, 'fixturenames', ())}
    return not (started or item.get_closest_marker('alone') or item.path.name in SLOW_FILES)


def shares_a_fixture(item: pytest.Item) -> bool:
    """Tell whether a fixture of the test is made once for its file."""
    found = getattr(item, '_fixtureinfo', None)
    made = found.name2fixturedefs.values() if found else ()
    return any(definitions[-1].scope == 'module' for definitions in made)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Live systems run one at a time: two of them need more than two cores.

    Tests with a fixture of their file run on one worker, others would make it again.
    """
    if config.getoption('--fast'):
        config.hook.pytest_deselected(items=[item for item in items if not is_fast(item)])
        items[:] = filter(is_fast, items)
    for item in items:
        if 'node_process' in getattr(item, 'fixturenames', ()):
            item.add_marker(pytest.mark.xdist_group('live'))
        elif shares_a_fixture(item) and not item.get_closest_marker('xdist_group'):
            item.add_marker(pytest.mark.xdist_group(item.path.name))


@cache
def _may_raise_priority() -> bool:
    """Try in another process, as a container's root may lack the right."""
    there_and_back = 'import os; [os.setpriority(0, 0, os.getpriority(0, 0) + n) for n in (1, -1)]'
    command = [sys.executable, '-c', there_and_back]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Let live tests go first on the processors: the others take the time in which they wait.

    Where a priority cannot be raised again, all keep theirs.
    """
    if 'PYTEST_XDIST_WORKER' in os.environ and _may_raise_priority():
        mark = item.get_closest_marker('xdist_group')
        live = mark is not None and mark.args == ('live',)
        os.setpriority(os.PRIO_PROCESS, 0, _OWN + (0 if live else _BEHIND))
    return (yield)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Keep failed tests by names without the groups of workers, for a run without these."""
    cache = getattr(session.config, 'cache', None)
    if cache is not None and not hasattr(session.config, 'workerinput'):
        failed = cache.get('cache/lastfailed', {})
        cache.set('cache/lastfailed', {re.sub(r'@[^\]]*$', '', name): True for name in failed})


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a ROS domain for one test and set it in the environment."""
    with runtimes.reserved() as domain:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        yield domain


@pytest.fixture
def walk() -> Callable[..., Walk]:
    """Makes a recording of `seconds` to be changed and written."""
    return Walk


class NodeProcess(ChildProcess):
    """A running process of a test, which fails where what is waited for does not come."""

    def __init__(self, command: Sequence[str], log: Path, environment: dict[str, str]):
        super().__init__(command, log, environment)
        self.ended_by_interrupt: tuple[int, ...] = ENDED_BY_INTERRUPT

    def wait_for_output(self, pattern: str, timeout: float = PATIENCE) -> re.Match[str]:
        """Wait for a line that a regular expression is found in; fail where none comes."""
        try:
            return self.wait_for_line(pattern, timeout)
        except ProcessError as error:
            pytest.fail(f'{self.command}: {error}\n{self.output}')

    def wait(self, timeout: float = PATIENCE) -> int:
        """Wait for the end and return the exit code; fail where it does not end."""
        try:
            return super().wait(timeout)
        except ProcessError as error:
            pytest.fail(f'{self.command}: {error}\n{self.output}')

    @property
    def own_lines(self) -> list[str]:
        """Lines that are not empty, without those that `ros2 run` of ROS 2 adds at the end."""
        return [line for line in self.lines if line and not line.startswith('[ros2run]')]

    def wait_after(self, number: int, timeout: float = PATIENCE) -> int | None:
        """Wait for the end by a signal; return the node's own exit code, None where it is unknown.

        ROS 2's own `ros2 run` is ended by SIGTERM itself, before the node is.
        """
        code = self.wait(timeout)
        hidden = not IS_EMBEDDED and number == signal.SIGTERM and code == -number
        return None if hidden else code

    def stop(self) -> None:
        """Interrupt what still runs and make sure that it ends in good order."""
        if self.running:
            self.interrupt()
            code = self.wait()
            assert code in self.ended_by_interrupt, f'{self.command} exited {code}:\n{self.output}'


def _stop_daemon(domain: int) -> None:
    """End the daemon that ROS 2's command line tools leave behind."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        if probe.connect_ex(('127.0.0.1', DAEMON_PORT + domain)) != 0:
            return
    command = [find_program('ros2'), 'daemon', 'stop']
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


class NodeProcesses:
    """Starts processes in the test's domain and remembers them."""

    def __init__(self, folder: Path) -> None:
        self.started: list[NodeProcess] = []
        self._folder = folder
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
        log = self._folder / f'{len(self.started)}.log'
        process = NodeProcess([find_program(first), *rest], log, environment)
        self.started.append(process)
        return process


@pytest.fixture
def node_process(
    ros_domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[NodeProcesses]:
    """Start processes in a domain of the test's own.

    `node_process('power_daq', 'daq', '--ros-args', '-p', 'a:=1')` runs an executable of a
    package; `.ros2(…)`, `.python(…)` and `.command(…)` run the rest. At the end, whatever still
    runs is interrupted and must exit with 0 or as Ctrl-C makes it.
    """
    processes = NodeProcesses(tmp_path_factory.mktemp('processes'))
    try:
        yield processes
        for process in reversed(processes.started):
            process.stop()
    finally:
        for process in processes.started:
            process.kill()
        _stop_daemon(ros_domain)
