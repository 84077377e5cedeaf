"""A system clock that can be stepped, for one process tree and without touching the machine's.

It stands in for `time.time` and `time.time_ns` before anything else is imported: what they show
is the machine's clock plus an offset in a file that other processes share. The steady clock is
left alone, as NTP leaves it.

    python bench/stepped_clock.py OFFSET_FILE MODULE:FUNCTION [ARGUMENT…]     runs a command
"""

import mmap
import struct
import sys
import time
from pathlib import Path
from pkgutil import resolve_name

_OFFSET = struct.Struct('<q')
_time_ns = time.time_ns


class ClockFile:
    """The offset of a clock, ns, in a file of eight bytes."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(_OFFSET.pack(0))
        with path.open('r+b') as file:
            self._map = mmap.mmap(file.fileno(), _OFFSET.size)

    @property
    def offset(self) -> int:
        """Shown time minus the machine's time, ns."""
        return int(_OFFSET.unpack_from(self._map)[0])

    def step(self, seconds: float) -> None:
        """Step the clock of all processes that use the file."""
        _OFFSET.pack_into(self._map, 0, self.offset + round(1e9 * seconds))

    def install(self) -> None:
        """Replace `time.time` and `time.time_ns` of this process by the stepped clock."""
        time.time_ns = lambda: _time_ns() + self.offset  # type: ignore[assignment]
        time.time = lambda: 1e-9 * (_time_ns() + self.offset)  # type: ignore[assignment]


def main() -> int:
    """Run a command with the clock of the file."""
    path, function, *arguments = sys.argv[1:]
    ClockFile(Path(path)).install()
    sys.argv = [function, *arguments]
    return int(resolve_name(function)(arguments) or 0)


if __name__ == '__main__':
    raise SystemExit(main())
