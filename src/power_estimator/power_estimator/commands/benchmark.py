"""`ros2 run power_estimator benchmark`: models side by side on recordings."""

import argparse

from power_recordings.reading.bag_folder import check_recordings
from wattwalk_core.console import progress, write_json
from wattwalk_core.files import together

from power_estimator.evaluation import benchmark, figure
from power_estimator.evaluation.benchmark import print_scores


def run(options: argparse.Namespace) -> None:
    check_recordings(options.bags)
    with progress('reading, aligning and estimating'):
        found = benchmark.run(
            options.bags, options.models, options.drives, slow=options.slow, anyway=options.anyway
        )
    title = f'{found.extent} held out ({"; ".join(found.held_out)})'
    with together():
        write_json(options.json, found.table)
        if options.picture:
            bars = options.picture.with_stem(options.picture.stem + '_r2')
            figure.draw_traces(options.picture, found.traces, dark=options.dark)
            figure.draw_bars(bars, found.table, title=title, dark=options.dark)
    print_scores(found.table, title)
    if options.picture:
        print(f'pictures: {options.picture}, {bars}')
