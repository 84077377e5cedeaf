"""`ros2 run power_lab budget`: where the metered power goes, and what would change it."""

import argparse

from wattwalk_core.console import write_json
from wattwalk_core.files import together

from power_lab.budget.levers import parse_changes
from power_lab.commands import options as common
from power_lab.compare.notes import notes


def run(options: argparse.Namespace) -> None:
    changes = parse_changes(options.change)
    models = [] if options.model is None else [options.model]
    with common.opened(options, models) as (lab, show):
        if options.model is not None:
            lab = lab.load(options.model)
        show('accounting' if options.model else 'choosing a model and accounting')
        found = lab.budget(changes, options.battery, options.seed)
    with together():
        write_json(options.json, found.json())
        if options.figures or options.report:
            from power_lab.report import budget_page  # matplotlib: 0.5 s, 20 MB
        if options.figures:
            budget_page.write_figures(options.figures, found)
        if options.report:
            budget_page.write_budget(options.report, found)
    print(found.table())
    for note in notes(lab.judge.prepared):
        print(note)
    for path in filter(None, (options.report, options.figures)):
        print(f'wrote {path}')
