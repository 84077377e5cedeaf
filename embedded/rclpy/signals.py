"""Handlers of SIGINT and SIGTERM: they shut the contexts down, so that spin ends."""

import signal
import socket
import threading
from enum import IntEnum
from types import FrameType
from typing import Any
from weakref import WeakSet


class SignalHandlerOptions(IntEnum):
    """Signals that shut the contexts down."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


_contexts: WeakSet[Any] = WeakSet()
_previous: dict[int, Any] = {}
_bell: tuple[socket.socket, socket.socket] | None = None


def _watch(context: Any) -> None:
    """Shut a context down when a signal comes."""
    _contexts.add(context)


def _wake_executors(bell: socket.socket) -> None:
    """Wake what waits in C code at each signal, so that Python's handler gets to run."""
    while bell.recv(1):
        for context in list(_contexts):
            context._wake()


def _hang_bell() -> None:
    global _bell
    if _bell is None:
        _bell = socket.socketpair()
        _bell[1].setblocking(False)
        threading.Thread(target=_wake_executors, args=(_bell[0],), daemon=True).start()
    signal.set_wakeup_fd(_bell[1].fileno(), warn_on_full_buffer=False)


def _handle(number: int, frame: FrameType | None) -> None:
    for context in list(_contexts):
        context._interrupt()
    previous = _previous.get(number)
    if callable(previous):
        previous(number, frame)


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Install handlers that shut contexts down; previous handlers are called as well."""
    if threading.current_thread() is not threading.main_thread():
        return
    for option, number in (
        (SignalHandlerOptions.SIGINT, signal.SIGINT),
        (SignalHandlerOptions.SIGTERM, signal.SIGTERM),
    ):
        if options & option and number not in _previous:
            _previous[number] = signal.signal(number, _handle)
            _hang_bell()


def uninstall_signal_handlers() -> None:
    """Restore the previous handlers of the signals."""
    if threading.current_thread() is not threading.main_thread():
        return
    if _previous:
        signal.set_wakeup_fd(-1)
    for number in list(_previous):
        previous = _previous.pop(number)
        if signal.getsignal(number) is _handle:
            signal.signal(number, signal.SIG_DFL if previous is None else previous)
