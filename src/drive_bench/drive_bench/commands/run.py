"""`ros2 run drive_bench run`: execute a motion of single drives, optionally recorded."""

import sys
from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import entry_point, own_arguments

from drive_bench.motion.file import MotionFile
from drive_bench.run.options import RunOptions, check_new, parse


@entry_point('drive_bench.nodes.motion:run')
def main(args: Sequence[str] | None = None) -> tuple[RunOptions, MotionFile, Sequence[str]]:
    """Options, the motion, and the arguments for ROS."""
    options = parse(own_arguments(args))
    motion = options.read_motion()
    if options.record:
        check_new(Path(options.record))
    return options, motion, sys.argv[1:] if args is None else args
