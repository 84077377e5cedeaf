"""Entry point of `ros2`: finds the command and the verb and runs it."""

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module

COMMANDS = {
    'run': 'run an executable of a package',
    'pkg': 'list packages and their executables',
    'topic': 'list, print and measure topics',
    'node': 'list nodes and what they have',
    'param': 'read and set the parameters of nodes',
    'service': 'list and call services',
}
EXAMPLE = 'Example: ros2 topic hz /joint_states'


class CommandError(Exception):
    """Raised for a command that cannot be carried out; the message says why in one line."""


def main(args: Sequence[str] | None = None) -> int:
    """Run `ros2` and return its exit code."""
    argv = list(sys.argv[1:] if args is None else args)
    overview = '\n'.join(f'  {name:<9}{text}' for name, text in COMMANDS.items())
    parser = argparse.ArgumentParser(
        'ros2',
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='ros2 on the embedded rclpy, for machines without ROS 2.',
        epilog=f'Commands:\n{overview}\n\n{EXAMPLE}',
    )
    parser.add_argument('command', choices=COMMANDS, metavar='command')
    parser.add_argument('arguments', nargs=argparse.REMAINDER, metavar='...')
    if not argv:
        parser.print_help()
        return 0
    chosen = parser.parse_args(argv[:1])
    try:
        return import_module(f'ros2cli.{chosen.command}').main(argv[1:]) or 0
    except CommandError as error:
        print(f'ros2 {chosen.command}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE


if __name__ == '__main__':
    sys.exit(main())
