"""`ros2 run power_workbench open`: the workbench, a page on this machine."""

import argparse

from power_estimator.effects import load_catalogue
from power_lab.commands import options as common

from power_workbench.server.serving import serve


def run(options: argparse.Namespace) -> int:
    catalogue = load_catalogue(options.effects_path)
    if options.model:
        common.check_models([options.model], catalogue)
    return serve(options)
