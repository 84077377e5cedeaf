"""A ROS domain that nobody else on this machine uses."""

import fcntl
import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

DOMAINS = range(1, 101)


class NoDomainError(Exception):
    """Every domain is taken."""


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
    """
    Keep a ROS_DOMAIN_ID between 1 and 100 from others while the context lasts.

    A lock on a file in the temporary folder keeps it from whoever else asks here at the same
    time, in other processes or other checkouts. Raises NoDomainError where all are taken.
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
