"""`ros2 run power_recordings example`: a recording to try the other commands with."""

import argparse
import shutil
from pathlib import Path
from typing import Final

from wattwalk_core.files import check_room

from power_recordings.writing.writer import make_way

WALK: Final = Path(__file__).parents[1] / 'example' / 'walk_small'


def run(options: argparse.Namespace) -> None:
    """Copy the installed example to `options.output`; InputError if that path exists."""
    make_way(options.output, overwrite=None)
    check_room(options.output)
    shutil.copytree(WALK, options.output)
    print(f'{options.output}: 25 s of a simulated walk, its 12 drives metered')
    fit = f'power_lab fit {options.output} --effects shaft,copper_loss,idle -o base.yaml'
    print(f'next: ros2 run {fit}')
