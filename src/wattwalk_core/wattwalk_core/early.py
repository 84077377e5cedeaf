"""Ctrl-C before a command is at work, and in destructors: one line instead of a traceback."""

# Commands import this before all else, so few modules and none that are slow to import.
import _thread
import os
import signal
import sys
import time
from types import TracebackType

_AGAIN = 0.02  # s


def install() -> None:
    """Replace Python's default hooks for uncaught errors by ones that print one line for Ctrl-C.

    Packages of commands call it when they are imported, so that libraries leave the hooks.
    """
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _on_uncaught
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _on_unraisable


def send_again(number: int) -> None:
    """Send this process the signal `number` 20 ms later, from another thread."""

    def send() -> None:
        time.sleep(_AGAIN)
        os.kill(os.getpid(), number)

    # A threading.Thread takes locks that the interrupted code may hold.
    _thread.start_new_thread(send, ())


def _on_uncaught(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print one line for Ctrl-C, also where an extension module turned it into an error."""
    if not _is_interrupt(error):
        sys.__excepthook__(kind, error, trace)
        return
    print(f'{sys.argv[0].rsplit("/", 1)[-1]!a}: interrupted'.replace("'", ''), file=sys.stderr)
    sys.stdout.flush()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGINT)


def _on_unraisable(ignored: 'sys.UnraisableHookArgs') -> None:
    """Send Ctrl-C again where it came in a destructor or callback, in which it is lost."""
    if isinstance(ignored.exc_value, KeyboardInterrupt):
        send_again(getattr(ignored.exc_value, 'number', signal.SIGINT))
    else:
        sys.__unraisablehook__(ignored)


def _is_interrupt(error: BaseException | None) -> bool:
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None
