"""Recorder process of `run --record`."""

import signal
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from wattwalk_core.processes import ChildProcess

NAME: Final = 'bench_recorder'
_RUN: Final = (
    'import sys; from power_daq.commands.arguments import record as main; sys.exit(main())'
)
_PATIENCE: Final = 30.0  # s to close a bag


class RecorderProcess:
    """
    Child process of `ros2 run power_daq record`, in a session without the terminal's Ctrl-C.

    The drives have to be damped first, so the recorder is ended by `stop` only, or by itself
    after `longest` s in case that this process is killed.
    """

    def __init__(
        self, bag: Path, card: Mapping[str, str], longest: float, ros: Sequence[str] = ()
    ) -> None:
        self.bag = bag
        self._folder = tempfile.TemporaryDirectory()
        words = [f'{key}={value}' for key, value in card.items()]
        command = [sys.executable, '-c', _RUN, '-o', str(bag), '--duration', f'{longest:.0f}']
        command += ['--card', *words, '--ros-args', *ros, '-r', f'__node:={NAME}']
        self._process = ChildProcess(command, Path(self._folder.name) / 'recorder.log')
        self.pid: Final = self._process.pid

    @property
    def ended(self) -> str:
        """Reason for its end, or '' while it runs."""
        code = self._process.returncode
        if code is None:
            return ''
        if code < 0:
            return f'the recorder was ended by {signal.Signals(-code).name}'
        return f'the recorder ended: {self._last_line()}'

    def stop(self) -> tuple[str, ...]:
        """End it in good order and return the lines of its summary."""
        place = len(self._process.output)
        self._process.end(_PATIENCE, [signal.SIGINT])
        lines = self._process.output[place:].splitlines()
        return tuple(line for line in lines if line.strip())

    def _last_line(self) -> str:
        last = self._process.last_line
        return last.partition('record: ')[2] or last
