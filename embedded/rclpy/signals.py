"""What SIGINT and SIGTERM do: shut the contexts down, so that spin ends."""

import signal
import threading
from enum import IntEnum
from types import FrameType
from typing import Any
from weakref import WeakSet


class SignalHandlerOptions(IntEnum):
    """Which signals shut the contexts down."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


_contexts: WeakSet[Any] = WeakSet()
_previous: dict[int, Any] = {}


def _watch(context: Any) -> None:
    """Shut a context down when a signal comes."""
    _contexts.add(context)


def _handle(number: int, frame: FrameType | None) -> None:
    for context in list(_contexts):
        context._interrupt()
    previous = _previous.get(number)
    if callable(previous):
        previous(number, frame)


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Take the signals over; the handlers that were there are called as well."""
    if threading.current_thread() is not threading.main_thread():
        return
    for option, number in (
        (SignalHandlerOptions.SIGINT, signal.SIGINT),
        (SignalHandlerOptions.SIGTERM, signal.SIGTERM),
    ):
        if options & option and number not in _previous:
            _previous[number] = signal.signal(number, _handle)


def uninstall_signal_handlers() -> None:
    """Give the signals back to the handlers that were there."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in list(_previous):
        previous = _previous.pop(number)
        if signal.getsignal(number) is _handle:
            signal.signal(number, signal.SIG_DFL if previous is None else previous)


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    """Tell which signals are taken over."""
    return SignalHandlerOptions(
        (SignalHandlerOptions.SIGINT if signal.SIGINT in _previous else 0)
        | (SignalHandlerOptions.SIGTERM if signal.SIGTERM in _previous else 0)
    )
