"""Entry points of commands: one line on stderr for bad input and for signals."""

import argparse
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from functools import wraps
from pkgutil import resolve_name
from types import FrameType
from typing import Any, Final, Self

from wattwalk_core import early
from wattwalk_core.errors import InputError, printable

Arguments = Sequence[str] | None
Entry = Callable[[Arguments], int]

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """Exception for an end by a signal; the message, if any, is one line for the user."""

    def __init__(self, number: signal.Signals, message: str = '') -> None:
        super().__init__(message)
        self.number = number


class RaisedSignals:
    """SIGINT and SIGTERM as the exception Interrupted, within a `with` block of the main thread.

    received: the last one. In other threads the handlers stay as they are. A signal that comes
    while a module is imported is raised after the import: extension modules turn an exception
    into an ImportError of their own, and callbacks of the import system lose it.
    """

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self._former: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._former = {number: signal.signal(number, self._handle) for number in _SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, former in self._former.items():
            # A node that a signal has ended leaves the next ones ignored.
            if signal.getsignal(number) == self._handle:
                signal.signal(number, former)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.received = signal.Signals(number)
        if _importing(frame):
            early.send_again(number)
        else:
            raise Interrupted(self.received)


def _importing(frame: FrameType | None) -> bool:
    """Return whether a frame, or a caller of it, is importing a module."""
    while frame is not None:
        if frame.f_code.co_filename.startswith('<frozen importlib'):
            return True
        frame = frame.f_back
    return False


class DeferredSignals(RaisedSignals):
    """RaisedSignals that only stores a first signal, so that loops can end between two writes."""

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.received is not None:
            super()._handle(number, frame)
        self.received = signal.Signals(number)


_LONGEST: Final = 2000
_EXTRAS: Final = {
    **dict.fromkeys(('pyvisa', 'pysoem', 'hebi'), 'hardware'),
    **dict.fromkeys(('dask', 'distributed', 'cryptography'), 'cluster'),
}
"""Extra that has a library which a wheel does not require, by its import name."""
_INTERRUPTED: Final = 'interrupted'


def command(body: Callable[[Arguments], int | None]) -> Entry:
    """Turn a function of the argument list into an entry point that returns an exit code.

    InputError ends with its message on stderr and code 2, SIGINT (Ctrl-C) with one line and code
    130 and SIGTERM with code 143, both after `finally` clauses.
    """

    @wraps(body)
    def main(args: Arguments = None) -> int:
        early.install()
        with RaisedSignals() as signals:
            try:
                code = body(args) or 0
                sys.stdout.flush()
                return code
            except BrokenPipeError:
                if not _is_stdout_closed():
                    raise
                return 128 + signal.SIGPIPE
            except InputError as error:
                _say(error)
                return 2
            except KeyboardInterrupt as end:
                number = end.number if isinstance(end, Interrupted) else signal.SIGINT
                _say(str(end) or _INTERRUPTED)
            except ModuleNotFoundError as error:
                extra = _EXTRAS.get((error.name or '').partition('.')[0])
                if extra is None:
                    raise
                _say(f"needs {error.name}: pip install 'wattwalk[{extra}]'")
                return 2
            except Exception:
                # Extension modules that a signal interrupts at their import raise ImportError.
                if signals.received is None:
                    raise
                number = signals.received
                _say(_INTERRUPTED)
            finally:
                if args is None:
                    _end_at_once_by_signals()
        return 128 + number

    return main


def entry_point(
    body: str, description: str, epilog: str, *, name: str | None = None
) -> Callable[[Callable[[argparse.ArgumentParser, Arguments], object]], Entry]:
    """Turn a function that adds arguments to a parser and parses them into a command.

    body: `module:function`, which takes what the function returns; it is imported once the
    arguments are read, so that `--help` and errors in arguments wait for no library. epilog: its
    lines are printed as they are. name: of the command, else the function's.
    """

    def decorate(read: Callable[[argparse.ArgumentParser, Arguments], object]) -> Entry:
        @wraps(read)
        def main(args: Arguments = None) -> int | None:
            parser = argparse.ArgumentParser(
                prog=f'ros2 run {body.partition(".")[0]} {name or read.__name__}',
                description=description,
                epilog=epilog,
                formatter_class=argparse.RawDescriptionHelpFormatter,
                allow_abbrev=False,
            )
            options = read(parser, args)
            found: int | None = resolve_name(body)(options)
            return found

        return command(main)

    return decorate


def _is_stdout_closed() -> bool:
    """Tell whether the reader of a pipe has left, as `head` does; what is left goes nowhere."""
    poll = select.poll()
    poll.register(sys.stdout.fileno(), 0)
    if not any(event & select.POLLERR for _, event in poll.poll(0)):
        return False
    with open(os.devnull, 'w') as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    return True


def _end_at_once_by_signals() -> None:
    """Ignore signals while the interpreter exits, where they would print a traceback."""
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, signal.SIG_DFL)


def _say(message: object) -> None:
    """Print one line, in which control characters of names and files are escaped."""
    name = sys.argv[0].rsplit('/', 1)[-1]
    print(printable(f'{name}: {message}', _LONGEST), file=sys.stderr)


def own_arguments(args: Arguments = None) -> list[str]:
    """Return a command's arguments: args, or the process's, without each `--ros-args … --`.

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


def node_options(parser: argparse.ArgumentParser, args: Arguments) -> argparse.Namespace:
    """Parse a node's arguments; those of ROS are ignored, and all of them are in `ros_args`."""
    given = sys.argv[1:] if args is None else list(args)
    return parser.parse_args(own_arguments(given), argparse.Namespace(ros_args=given))


def watt_hours(text: str) -> float:
    """Parse the energy of a battery in Wh, `907Wh`, `0.9kWh` or `907`, as an argument's type."""
    value, unit = text.rstrip('Whk '), text.lstrip('0123456789.').strip()
    try:
        hours = float(value) * {'Wh': 1.0, 'kWh': 1e3, '': 1.0}[unit]
    except (KeyError, ValueError):
        raise argparse.ArgumentTypeError(f'{text!r}: give watt hours, as 907Wh') from None
    if not 0.0 < hours < 1e6:
        raise argparse.ArgumentTypeError(f'{text!r} lies outside 0..1000 kWh')
    return hours
