"""Start processes on either runtime: the embedded one of this Python, and a ROS 2 beside it."""

import fcntl
import os
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

VARIABLE = 'WATTWALK_ROS_SETUP'
"""Names a file to be sourced by bash; afterwards `python` imports ROS 2 and this workspace."""
BUILT = Path(__file__).resolve().parents[1] / '.ros' / 'setup.sh'


def missing() -> str:
    """Return the reason why the two runtimes cannot be run together; '' if they can."""
    if find_spec('rosidl_embedded') is None:
        return 'this Python has no embedded runtime: run it from .venv, without ROS 2 sourced'
    setup = os.environ.get(VARIABLE)
    if setup is None and not BUILT.is_file():
        return f'no ROS 2: run `make build-ros`, or name a setup file in {VARIABLE}'
    if setup is not None and not Path(setup).is_file():
        return f'{VARIABLE} names {setup!r}, which is no file'
    return ''


def embedded(*arguments: str | Path) -> list[str]:
    """Return the command that runs Python with arguments on the embedded runtime."""
    return [sys.executable, *map(str, arguments)]


def embedded_ros2(*arguments: str) -> list[str]:
    """Return the command that runs the embedded `ros2` with arguments."""
    return [str(Path(sys.executable).with_name('ros2')), *arguments]


def real(*arguments: str | Path) -> list[str]:
    """Return the command that runs Python with arguments on ROS 2."""
    return _sourced('python', *arguments)


def real_ros2(*arguments: str) -> list[str]:
    """Return the command that runs the `ros2` of ROS 2 with arguments."""
    return _sourced('ros2', *arguments)


def _sourced(*command: str | Path) -> list[str]:
    setup = os.environ.get(VARIABLE, str(BUILT))
    keep = 'domain=$ROS_DOMAIN_ID; . "$0" && export ROS_DOMAIN_ID=$domain && exec "$@"'
    return ['bash', '-c', keep, setup, *map(str, command)]


DOMAINS = range(1, 101)


class NoDomainError(Exception):
    """Raised when every ROS domain is taken."""


def _is_quiet(domain: int) -> bool:
    """Tell whether nobody listens where the first participant of a domain would."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('127.0.0.1', 7410 + 250 * domain))
        except OSError:
            return False
    return True


@contextmanager
def reserved() -> Iterator[int]:
    """Reserve and yield a free ROS_DOMAIN_ID, 1 to 100, for the duration of the context.

    It is locked by a file in the temporary folder, against other processes and checkouts that use
    this function. Raises NoDomainError where all are taken.
    """
    start = os.getpid()
    for step in range(len(DOMAINS)):
        domain = DOMAINS[(start + step) % len(DOMAINS)]
        path = Path(tempfile.gettempdir()) / f'wattwalk_ros_domain_{domain}.lock'
        with path.open('w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            if _is_quiet(domain):
                yield domain
                return
    raise NoDomainError('all ROS domains from 1 to 100 are taken')
