"""`ros2 run power_workbench open`: the workbench, a page on this machine."""

import argparse

from power_estimator.effects import load_catalogue
from power_lab.commands import options as common

from power_workbench.server.serving import Opening, serve


def run(options: argparse.Namespace) -> int:
    catalogue = load_catalogue(options.effects_path)
    if options.model:
        common.check_models([options.model], catalogue)

    return serve(
        Opening(
            bags=tuple(options.bags),
            model=options.model or '',
            drives=tuple(options.drives),
            slow=options.slow,
            anyway=options.anyway,
            effect_files=tuple(map(str, options.effects_path)),
            folder=options.folder,
            host=options.host or '',
            port=options.port,
            token=options.token or '',
            browser=not options.no_browser,
        )
    )
