"""`ros2 run drive_bench run`: execute a motion of single drives, optionally recorded."""

import sys
from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command, own_arguments

from drive_bench.run.options import check_new, parse


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run the node until the motion is over; return the exit code."""
    options = parse(own_arguments(args))
    motion = options.read_motion()
    if options.record:
        check_new(Path(options.record))

    from wattwalk_core.nodes.running import run_node

    from drive_bench.nodes.motion import MotionNode

    arguments = sys.argv[1:] if args is None else args
    return run_node(lambda: MotionNode(options, motion), arguments)
