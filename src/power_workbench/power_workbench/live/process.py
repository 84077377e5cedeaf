"""The process of the live view: a node whose news go to the server over a pipe."""

import os
import sys
from contextlib import suppress
from multiprocessing.connection import Connection

_NICER = 5  # than the nodes that are followed


def main(descriptor: int) -> int:
    """Run the live view on a pipe, by its descriptor, until that ends; return the exit code."""
    os.nice(_NICER)
    pipe = Connection(descriptor)
    try:
        from wattwalk_core.nodes.running import run_node  # ROS 2 may be absent

        from power_workbench.live.node import LiveViewNode
    except ImportError as error:
        with suppress(OSError):
            pipe.send({'failed': f'the live view needs ROS 2: {error}; source it, then open anew'})
        return 1
    return run_node(lambda: LiveViewNode(pipe), [])


if __name__ == '__main__':
    sys.exit(main(int(sys.argv[1])))
