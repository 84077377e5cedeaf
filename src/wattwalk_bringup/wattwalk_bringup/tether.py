"""
Start a program that is sent SIGINT when the process that started it is gone, killed included.

    python tether.py PID PROGRAM [ARGUMENT ...]

PID: that process. Only Linux has the signal; elsewhere the program is started without it.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main(parent: int, *program: str) -> None:
    """Replace this process by the program, unless its parent is gone already."""
    if sys.platform == 'linux':
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT, 0, 0, 0)
        if os.getppid() != parent:
            sys.exit(f'process {parent} is gone')
    os.execv(program[0], program)


if __name__ == '__main__':
    main(int(sys.argv[1]), *sys.argv[2:])
