"""`ros2 run power_lab discover`: an effect that no catalogue has, learned and written down."""

import argparse

from power_estimator.effects import load_catalogue
from power_estimator.judge.recordings import load
from power_recordings.reading.bag_folder import check_recordings
from wattwalk_core.console import progress, write_json
from wattwalk_core.files import together, write_whole

from power_lab.commands import options as common
from power_lab.discover.outcome import split
from power_lab.report.discovery_page import write_discovery
from power_lab.report.tables import print_discovery
from power_lab.session import Session


def run(options: argparse.Namespace) -> None:
    check_recordings([*options.bags, *options.test])
    catalogue = load_catalogue(options.effects_path)
    common.check_models([options.model], catalogue)
    how = common.reading_of(options)
    bags, tests = split(options.bags, options.test)
    with progress('reading') as show:
        lab = Session.open(*bags, catalogue=catalogue, **how).load(options.model)
        outcome = lab.discover(load(tests, **how) if tests else None, show, options.seed)
        content = outcome.json()
    with together():
        if outcome.written:
            write_whole(options.output, outcome.source())
        write_json(options.json, content)
        if options.report:
            write_discovery(options.report, outcome)
    print_discovery(common.console(), outcome)
    names = [one.name for one in outcome.discovery.named]
    names += [one.name for one in outcome.written]
    own = f' --effects-path {options.output}' if outcome.written else ''
    told = f'wrote {options.output}'
    if not outcome.written:
        told = f'{options.output} is not written: there is no effect of the drives to write down'
    if names:
        add = f'add {" ".join(names)} --to {options.model} --bag {options.bags[0]}'
        told += f'; to add what is missing: ros2 run power_lab {add} -o better.yaml{own}'
    print(told)
    if options.report:
        print(f'report: {options.report}')
