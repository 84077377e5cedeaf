"""`ros2 run drive_bench run`: execute a motion of single drives, optionally recorded."""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import Arguments, entry_point, own_arguments

from drive_bench.motion.file import MotionFile
from drive_bench.run.options import EPILOG, RunOptions, check_new, parse


@entry_point(
    'drive_bench.nodes.motion:run',
    'Put drives through a motion, safely; with --record, record, file and check it, too.',
    EPILOG,
    name='run',
)
def main(parser: ArgumentParser, args: Arguments) -> tuple[RunOptions, MotionFile, Sequence[str]]:
    options = parse(parser, own_arguments(args))
    motion = options.read_motion()
    if options.record:
        check_new(Path(options.record))
    return options, motion, sys.argv[1:] if args is None else args
