"""Module run as a child process, with a pipe to it whose messages a thread takes."""

import os
import socket
import subprocess
import sys
import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any


class PipedProcess(ABC):
    """Base of what runs `module` as a process, which gets the descriptor of its pipe as argument.

    `_lock` is held at calls of `_start` and `_stop`. patience: s for the process to end by itself.
    """

    def __init__(self, module: str, patience: float = 0.0) -> None:
        self._module, self._patience = module, patience
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None

    @property
    def pid(self) -> int | None:
        """Process id, None while there is no process."""
        return None if self._process is None else self._process.pid

    def _start(self) -> bool:
        """Start the process where none runs; return whether it was started."""
        if self._process is not None and self._process.poll() is None:
            return False
        self._stop()
        own, other = socket.socketpair()
        with other:
            self._process = subprocess.Popen(
                [sys.executable, '-m', self._module, str(other.fileno())],
                pass_fds=[other.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
        self._pipe = Connection(own.detach())
        arguments = (self._pipe, self._process)
        threading.Thread(target=self._listen, args=arguments, daemon=True).start()
        return True

    def _stop(self) -> None:
        process, pipe, self._process, self._pipe = self._process, self._pipe, None, None
        if pipe is not None:
            # The thread that reads from it ends by itself, as the process does.
            with suppress(OSError), socket.socket(fileno=os.dup(pipe.fileno())) as link:
                link.shutdown(socket.SHUT_RDWR)
        if process is not None:
            try:
                process.wait(self._patience)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _listen(self, pipe: Connection, process: 'subprocess.Popen[bytes]') -> None:
        try:
            while True:
                self._heard(pipe, pipe.recv())
        except (EOFError, OSError):
            self._heard(pipe, None)
        finally:
            with suppress(OSError):
                pipe.close()
            process.wait()

    @abstractmethod
    def _heard(self, pipe: Connection, message: Any) -> None:
        """Take a message, None at the end of the process, in a separate thread.

        pipe: that it came by; another one than `_pipe` is that of a process that was stopped.
        """
