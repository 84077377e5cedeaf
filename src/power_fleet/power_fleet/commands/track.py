"""`ros2 run power_fleet track`: which effect of which drive changes over many recordings."""

import argparse

from power_estimator.effects import load_catalogue
from power_estimator.loader import load_model
from power_lab.commands import options as common
from power_recordings.index.store import RecordingIndex, usual_path
from power_recordings.reading.bag_folder import check_recordings
from threadpoolctl import threadpool_limits
from wattwalk_core.console import progress, write_json
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.files import together

from power_fleet.report.page import print_tracked, write_tracked
from power_fleet.track.outcome import model_of, track
from power_fleet.track.reading import Request
from power_fleet.track.recording_fit import key_of


def run(options: argparse.Namespace) -> None:
    check_recordings([path for path in options.bags if not path.exists()])
    catalogue = load_catalogue(options.effects_path)
    common.check_models([options.model], catalogue)
    model = model_of(load_model(options.model, catalogue), options.model)
    how = (options.drives, options.slow, options.anyway)
    key = key_of(model, options.model, options.effects_path, how)
    request = Request(model, catalogue, options.model, *how, key)
    with progress('reading') as show, threadpool_limits(limits=1):
        with RecordingIndex(usual_path()) as index, TaskEngine(Workplace.of(options)) as engine:
            found = track(options.bags, request, index, engine, show)
        content = found.json()
    with together():
        write_json(options.json, content)
        if options.report:
            write_tracked(options.report, found)
    print_tracked(common.console(), found)
    if options.report:
        print(f'report: {options.report}')
    print(f'next: {found.next_command(options.model)}')
