"""A network namespace for one test: interfaces that nobody else sees, gone at its end."""

import ctypes
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

_NEW_NETWORK = 0x40000000
_LIBC = ctypes.CDLL(None, use_errno=True)


def why_not() -> str:
    """Return the reason why no namespace can be made here; empty if it can."""
    if os.geteuid() != 0:
        return 'a network namespace needs root'
    try:
        with namespace():
            subprocess.run(['ip', 'link', 'add', 'probe0', 'type', 'veth'], check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        return f'no veth pair in a network namespace here: {error}'
    return ''


@contextmanager
def namespace() -> Iterator[None]:
    """Put this thread, and all it starts, into a namespace with nothing but loopback."""
    with open('/proc/thread-self/ns/net') as home:
        if _LIBC.unshare(_NEW_NETWORK):
            raise OSError(ctypes.get_errno(), 'unshare')
        try:
            subprocess.run(['ip', 'link', 'set', 'lo', 'up'], check=True)
            yield
        finally:
            if _LIBC.setns(home.fileno(), _NEW_NETWORK):
                raise OSError(ctypes.get_errno(), 'setns')


@contextmanager
def cable() -> Iterator[tuple[str, str]]:
    """Two ends of a cable, in a namespace of their own."""
    with namespace():
        near, far = 'ecat0', 'ecat1'
        subprocess.run(
            ['ip', 'link', 'add', near, 'type', 'veth', 'peer', 'name', far], check=True
        )
        for end in (near, far):
            subprocess.run(['ip', 'link', 'set', end, 'up'], check=True)
        yield near, far
