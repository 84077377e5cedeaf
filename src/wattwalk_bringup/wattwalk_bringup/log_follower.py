"""New lines of a growing log file."""

import re
from pathlib import Path
from typing import Final

_LOGGED: Final = re.compile(r'^\[(\w+)\] \[[\d.]+\] \[[\w.]+\]: ')
_ESCAPES: Final = re.compile(r'\x1b\[[0-9;]*[A-Za-z]')
_MOST: Final = 1 << 16  # bytes at once


class LogFollower:
    """Reads what a process has added to its log since the last time."""

    def __init__(self, path: Path) -> None:
        self.last = ''
        self._path, self._place, self._rest = path, 0, b''

    def new_lines(self) -> list[str]:
        """
        Return new lines that are not empty, without time and name of ROS's log.

        The newest one stays in `last`.
        """
        with self._path.open('rb') as log:
            log.seek(self._place)
            data = log.read(_MOST)
        self._place += len(data)
        *whole, self._rest = (self._rest + data).replace(b'\r', b'\n').split(b'\n')
        self._rest = self._rest[-_MOST:]
        lines = [line for part in whole if (line := _plain(part))]
        self.last = lines[-1] if lines else self.last
        return lines

    def rest(self) -> list[str]:
        """Return all lines up to the end of a log that grows no more."""
        lines: list[str] = []
        while True:
            place = self._place
            lines += self.new_lines()
            if self._place == place:
                break
        if line := _plain(self._rest):
            self._rest, self.last = b'', line
            lines.append(line)
        return lines


def _plain(line: bytes) -> str:
    text = _ESCAPES.sub('', line.decode(errors='replace')).strip()
    found = _LOGGED.match(text)
    if found is None:
        return text
    level = '' if found[1] == 'INFO' else f'{found[1].lower()}: '
    return f'{level}{text[found.end() :]}'
