"""The recorder as a process of its own, started, monitored and ended by `run --record`."""

import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

NAME: Final = 'bench_recorder'
_RUN: Final = 'import sys; from power_daq.nodes.recorder import main; sys.exit(main())'
_PATIENCE: Final = 30.0  # s to close a bag


class RecorderProcess:
    """
    `ros2 run power_daq record` under another name, in a session without the terminal's Ctrl-C.

    The drives have to be damped first, so the recorder is ended by `stop` only, or by itself
    after `longest` s in case that this process is killed.
    """

    def __init__(
        self, bag: Path, card: Mapping[str, str], longest: float, ros: Sequence[str] = ()
    ) -> None:
        self.bag = bag
        self._said = tempfile.TemporaryFile('w+')  # noqa: SIM115
        words = [f'{key}={value}' for key, value in card.items()]
        command = [sys.executable, '-c', _RUN, '-o', str(bag), '--duration', f'{longest:.0f}']
        command += ['--card', *words, '--ros-args', *ros, '-r', f'__node:={NAME}']
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=self._said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def ended(self) -> str:
        """The reason why it ended, or '' while it runs."""
        code = self._process.poll()
        if code is None:
            return ''
        if code < 0:
            return f'the recorder was ended by {signal.Signals(-code).name}'
        return f'the recorder ended: {self._last_line() or f"exit code {code}"}'

    def stop(self) -> tuple[str, ...]:
        """End it in good order and return the lines of its summary."""
        self._said.seek(0, 2)
        place = self._said.tell()
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._said.seek(place)
        lines = self._said.read().splitlines()
        return tuple(line for line in lines if line.strip())

    def _last_line(self) -> str:
        self._said.seek(0)
        lines = [line for line in self._said.read().splitlines() if line.strip()]
        return lines[-1].partition('record: ')[2] or lines[-1] if lines else ''
