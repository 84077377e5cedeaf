"""Start processes on either runtime: the embedded one of this Python, and a ROS 2 beside it."""

import os
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

VARIABLE = 'WATTWALK_ROS_SETUP'
"""Names a file to be sourced by bash; afterwards `python` imports ROS 2 and this workspace."""
BUILT = Path(__file__).resolve().parents[1] / '.ros' / 'setup.sh'


def missing(environment: Mapping[str, str] = os.environ) -> str:
    """Reason why the two runtimes cannot be run together; empty if they can."""
    if find_spec('rosidl_embedded') is None:
        return 'this Python has no embedded runtime: run it from .venv, without ROS 2 sourced'
    setup = environment.get(VARIABLE)
    if setup is None and not BUILT.is_file():
        return f'no ROS 2: run `make build-ros`, or name a setup file in {VARIABLE}'
    if setup is not None and not Path(setup).is_file():
        return f'{VARIABLE} names {setup!r}, which is no file'
    return ''


def embedded(*arguments: str | Path) -> list[str]:
    """The command that runs Python with arguments on the embedded runtime."""
    return [sys.executable, *map(str, arguments)]


def embedded_ros2(*arguments: str) -> list[str]:
    """The command that runs the embedded `ros2`."""
    return [str(Path(sys.executable).with_name('ros2')), *arguments]


def real(*arguments: str | Path) -> list[str]:
    """The command that runs Python with arguments on ROS 2."""
    return _sourced('python', *arguments)


def real_ros2(*arguments: str) -> list[str]:
    """The command that runs the `ros2` of ROS 2."""
    return _sourced('ros2', *arguments)


def _sourced(*command: str | Path) -> list[str]:
    setup = os.environ.get(VARIABLE, str(BUILT))
    keep = 'domain=$ROS_DOMAIN_ID; . "$0" && export ROS_DOMAIN_ID=$domain && exec "$@"'
    return ['bash', '-c', keep, setup, *map(str, command)]
