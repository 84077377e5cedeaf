"""Base of commands with verbs: parser, a node of their own, wait for discovery."""

import argparse
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from ros2cli.main import CommandError

QUIET = 0.3
PATIENCE = 5.0


class Verbs:
    """The verbs of a command, each with its arguments and a function."""

    def __init__(self, command: str, description: str):
        self._parser = argparse.ArgumentParser(f'ros2 {command}', description=description)
        self._verbs = self._parser.add_subparsers(metavar='verb', required=True)

    def add(
        self,
        name: str,
        function: Callable[[argparse.Namespace], int | None],
        text: str,
        example: str,
    ) -> argparse.ArgumentParser:
        """Add a verb and return its parser."""
        verb = self._verbs.add_parser(
            name, help=text, description=text, epilog=f'Example: {example}'
        )
        verb.set_defaults(function=function)
        return verb

    def run(self, argv: Sequence[str]) -> int:
        """Run the verb of a command line; without one, show the help."""
        if not argv:
            self._parser.print_help()
            return 0
        options = self._parser.parse_args(argv)
        return options.function(options) or 0


def add_spin_time(parser: argparse.ArgumentParser) -> None:
    """Let users say how long to wait for discovery."""
    parser.add_argument('--no-daemon', action='store_true', help='no effect: there is no daemon')
    parser.add_argument(
        '--spin-time',
        type=float,
        default=None,
        metavar='SECONDS',
        help='how long to look for others (default: until nothing new comes for 0.3 s)',
    )


@contextmanager
def direct_node() -> Iterator[Any]:
    """Give a node that does not show in lists of nodes."""
    import rclpy  # slow to import
    from rclpy.node import Node

    try:
        rclpy.init(args=[])
        node = Node(f'_ros2cli_{os.getpid()}', start_parameter_services=False)
    except RuntimeError as error:
        raise CommandError(str(error)) from error
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def discover(node: Any, spin_time: float | None = None) -> None:
    """Wait until the picture of the domain no longer changes."""
    graph = node.context.graph
    start = changed = time.monotonic()
    seen: Any = None
    limit = PATIENCE if spin_time is None else spin_time
    while (now := time.monotonic()) - start < limit:
        nodes = [
            (n.name, n.namespace, len(n.readers), len(n.writers)) for n in graph.participants()
        ]
        found = (nodes, len(graph.endpoints('reader')), len(graph.endpoints('writer')))
        if found != seen:
            seen, changed = found, now
        if spin_time is None and now - changed > QUIET and now - start > 2 * QUIET:
            return
        time.sleep(0.05)


def wait_until(condition: Callable[[], bool], timeout: float) -> bool:
    """Wait until a condition holds; False where it does not within `timeout` [s]."""
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True
