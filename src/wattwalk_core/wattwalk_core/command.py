"""Entry points of commands: one line on stderr and exit code 2 on bad input."""

import signal
import sys
from collections.abc import Callable, Sequence
from functools import wraps

from wattwalk_core.errors import InputError
from wattwalk_core.interruption import Interrupted, RaisedSignals


def command(
    body: Callable[[Sequence[str] | None], int | None],
) -> Callable[[Sequence[str] | None], int]:
    """
    Turn a function of the argument list into an entry point that returns an exit code.

    InputError ends with its message on stderr and code 2, SIGINT (Ctrl-C) with code 130 and
    SIGTERM with code 143, both after `finally` clauses.
    """

    def say(message: object) -> None:
        print(f'{sys.argv[0].rsplit("/", 1)[-1]}: {message}', file=sys.stderr)

    @wraps(body)
    def main(args: Sequence[str] | None = None) -> int:
        with RaisedSignals() as signals:
            try:
                return body(args) or 0
            except InputError as error:
                say(error)
                return 2
            except KeyboardInterrupt as end:
                number = end.number if isinstance(end, Interrupted) else signal.SIGINT
                if str(end):
                    say(end)
            except Exception:
                # Extension modules that a signal interrupts at their import raise ImportError.
                if signals.received is None:
                    raise
                number = signals.received
        return 128 + number

    return main


def own_arguments(args: Sequence[str] | None = None) -> list[str]:
    """
    Return a command's own arguments: args, or the process's, without each `--ros-args … --`.

    The same as rclpy.utilities.remove_ros_args, without the import of rclpy.
    """
    own, is_own = [], True
    for argument in sys.argv[1:] if args is None else args:
        if argument == '--ros-args':
            is_own = False
        elif is_own:
            own.append(argument)
        elif argument == '--':
            is_own = True
    return own
