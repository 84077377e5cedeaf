"""`ros2 run power_lab compare`: models against measurements, and where they fail."""

import argparse

from power_estimator.effects import load_catalogue
from power_recordings.reading.bag_folder import check_recordings
from wattwalk_core.console import progress, write_json
from wattwalk_core.engine.options import Workplace
from wattwalk_core.files import together

from power_lab.commands import options as common
from power_lab.report.page import closest, write_comparison
from power_lab.report.tables import print_comparison
from power_lab.session import Session


def run(options: argparse.Namespace) -> int:
    check_recordings(options.bags)
    catalogue = load_catalogue(options.effects_path)
    common.check_models(options.models, catalogue)
    with progress('reading') as show:
        with common.reading_engine(Workplace.of(options), options.bags) as engine:
            how = {'engine': engine, 'show': show, **common.reading_of(options)}
            lab = Session.open(*options.bags, catalogue=catalogue, **how)
        show('comparing')
        comparison = lab.compare(*options.models)
        content = comparison.json()
    print_comparison(common.console(), content)
    print(closest(content['models']))
    with together():
        if options.json is not None:
            write_json(options.json, content)
        if options.report:
            write_comparison(options.report, comparison)
    if options.report:
        print(f'report: {options.report}')
    return 0
