"""Child processes: start, wait for a line or for the end, interrupt, kill; all in bounded time."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, Self

PATIENCE: Final = 30.0  # s
_POLL: Final = 0.02  # s
_TICKS: Final = os.sysconf('SC_CLK_TCK')


class ProcessError(Exception):
    """Error of a child process that ended or timed out too early, with its last line."""


def find_program(name: str) -> str:
    """Return the path of a program, beside this Python or on PATH; ProcessError without it."""
    beside = Path(sys.executable).parent / name
    found = str(beside) if beside.is_file() else shutil.which(name)
    if found is None:
        raise ProcessError(f'no command {name}: run `make setup`, or source ROS 2')
    return found


def wait_until(condition: Callable[[], object], timeout: float = PATIENCE) -> bool:
    """Wait until a condition holds; return whether it did within timeout [s]."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(_POLL)
    return True


class ChildProcess:
    """A process in a separate session, unaffected by the terminal's Ctrl-C.

    log: file that its output, stderr included, is written to; its name without suffix stands for
    the process in errors. environment: added to that of this process. Signals go to the process
    and its children.
    """

    def __init__(
        self, command: Sequence[str], log: Path, environment: Mapping[str, str] | None = None
    ) -> None:
        self.command, self.log = list(command), log
        with log.open('wb') as out:
            self._process = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                env={**os.environ, 'PYTHONUNBUFFERED': '1', **(environment or {})},
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Id of the process and of its group."""
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """Exit code, minus the number of a signal that ended it, None while it runs."""
        return self._process.poll()

    @property
    def running(self) -> bool:
        """True until the process has ended."""
        return self.returncode is None

    @property
    def output(self) -> str:
        """Text that the process has written so far."""
        return self.log.read_text(errors='replace')

    @property
    def lines(self) -> list[str]:
        """Lines of the output; a last one without its end only once the process has ended."""
        ended = not self.running
        whole, _, rest = self.output.rpartition('\n')
        return [*(whole.split('\n') if whole else []), *([rest] if rest and ended else [])]

    @property
    def last_line(self) -> str:
        """Last line that is not empty, or 'no output'."""
        return next((line for line in reversed(self.output.split('\n')) if line), 'no output')

    def wait_for_line(self, pattern: str, timeout: float = PATIENCE) -> re.Match[str]:
        """Wait until a regular expression is found in a line of the output; return the match.

        Raises ProcessError where the process ends without it or timeout [s] is over.
        """

        def found() -> re.Match[str] | None:
            return next(filter(None, (re.search(pattern, line) for line in self.lines)), None)

        in_time = wait_until(lambda: not self.running or found(), timeout)
        if match := found():
            return match
        if in_time:
            raise self._error(f'ended with code {self.returncode} before it said {pattern!r}')
        raise self._error(f'did not say {pattern!r} within {timeout:g} s')

    def check(self) -> None:
        """Raise ProcessError if the process has ended."""
        if not self.running:
            raise self._error(f'ended with code {self.returncode}')

    def wait(self, timeout: float = PATIENCE) -> int:
        """Wait for the end; return the exit code. ProcessError after timeout [s]."""
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise self._error(f'did not end within {timeout:g} s') from None

    def succeed(self, timeout: float = PATIENCE) -> None:
        """Wait for the end; ProcessError after timeout [s] or for an exit code other than 0."""
        if self.wait(timeout) != 0:
            self.check()

    def send_signal(self, number: int) -> None:
        """Send a signal to the process and its children, unless it has ended."""
        if self.running:
            with suppress(ProcessLookupError):
                os.killpg(self.pid, number)

    def interrupt(self) -> None:
        """Send SIGINT, as Ctrl-C does."""
        self.send_signal(signal.SIGINT)

    def end(
        self, patience: float = PATIENCE, signals: Sequence[int] = (signal.SIGINT, signal.SIGTERM)
    ) -> int:
        """Send signals one after the other, each patience [s] after the one before, then SIGKILL.

        Children that outlive the process are killed. Returns the exit code.
        """
        if self.running:
            for number in signals:
                os.killpg(self.pid, number)
                if wait_until(self._has_ended, patience):
                    break
            # Until it is waited for, no other group can have its id.
            os.killpg(self.pid, signal.SIGKILL)
        return self._process.wait()

    def kill(self) -> int:
        """End the process and its children by SIGKILL; return the exit code."""
        return self.end(0.0, ())

    def cpu_seconds(self) -> float:
        """Return the CPU time that the process and its running children have used [s]."""
        total = 0.0
        for entry in Path('/proc').iterdir():
            if entry.name.isdigit():
                with suppress(OSError):
                    fields = (entry / 'stat').read_text().rpartition(')')[2].split()
                    if int(fields[2]) == self.pid:
                        total += (int(fields[11]) + int(fields[12])) / _TICKS
        return total

    def _error(self, text: str) -> ProcessError:
        return ProcessError(f'{self.log.stem} {text}: {self.last_line} ({self.log})')

    def _has_ended(self) -> bool:
        options = os.WEXITED | os.WNOWAIT | os.WNOHANG
        return os.waitid(os.P_PID, self.pid, options) is not None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
