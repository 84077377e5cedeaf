"""Start a program that is sent SIGINT when the process that started it is gone, killed included.

SIGINT waits until the program unblocks it, as nodes do once they can end soundly; `ros2` has it
at once.

    python tether.py PID PROGRAM [ARGUMENT ...]

PID: that process. Only Linux has the signal; elsewhere the program is started without it.
"""

import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main(parent: int, *program: str) -> None:
    """Replace this process by the program, unless its parent is gone already."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    if sys.platform == 'linux':
        import ctypes  # once SIGINT is held back

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT, 0, 0, 0)
        if os.getppid() != parent:
            sys.exit(f'process {parent} is gone')
    if os.path.basename(program[0]) == 'ros2':
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    os.execv(program[0], program)


if __name__ == '__main__':
    main(int(sys.argv[1]), *sys.argv[2:])
