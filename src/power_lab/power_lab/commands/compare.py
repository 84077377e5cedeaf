"""`ros2 run power_lab compare`: models against measurements, and where they fail."""

import argparse

from wattwalk_core.console import write_json
from wattwalk_core.files import together

from power_lab.commands import options as common
from power_lab.report.page import closest, write_comparison
from power_lab.report.tables import print_comparison


def run(options: argparse.Namespace) -> None:
    with common.opened(options, options.models) as (lab, show):
        show('comparing')
        comparison = lab.compare(*options.models)
        content = comparison.json()
    with together():
        write_json(options.json, content)
        if options.report:
            write_comparison(options.report, comparison)
    print_comparison(common.console(), content)
    print(closest(content['models']))
    if options.report:
        print(f'report: {options.report}')
