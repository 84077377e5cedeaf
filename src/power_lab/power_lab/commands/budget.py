"""`ros2 run power_lab budget`: where the metered power goes, and what would change it."""

import argparse

from power_estimator.effects import load_catalogue
from power_recordings.reading.bag_folder import check_recordings
from wattwalk_core.console import progress, write_json
from wattwalk_core.engine.options import Workplace
from wattwalk_core.files import together

from power_lab.budget.levers import parse_changes
from power_lab.commands import options as common
from power_lab.compare.notes import notes
from power_lab.report.budget_figures import write_figures
from power_lab.report.budget_page import write_budget
from power_lab.session import Session


def run(options: argparse.Namespace) -> int:
    check_recordings(options.bags)
    changes = parse_changes(options.change)
    catalogue = load_catalogue(options.effects_path)
    if options.model is not None:
        common.check_models([options.model], catalogue)
    with progress('reading') as show:
        with common.reading_engine(Workplace.of(options), options.bags) as engine:
            how = {'engine': engine, 'show': show, **common.reading_of(options)}
            lab = Session.open(*options.bags, catalogue=catalogue, **how)
        if options.model is not None:
            lab = lab.load(options.model)
        show('accounting' if options.model else 'choosing a model and accounting')
        found = lab.budget(changes, options.battery, options.seed)
    print(found.table())
    for note in notes(lab.judge.prepared):
        print(note)
    with together():
        if options.json is not None:
            write_json(options.json, found.json())
        if options.figures is not None:
            write_figures(options.figures, found)
        if options.report is not None:
            write_budget(options.report, found)
    for path in filter(None, (options.report, options.figures)):
        print(f'wrote {path}')
    return 0
