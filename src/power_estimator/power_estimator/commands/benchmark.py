"""`ros2 run power_estimator benchmark`: models side by side on recordings."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command, command_parser
from wattwalk_core.console import PICTURES, check_suffix, progress, write_json
from wattwalk_core.files import together

from power_estimator.proxies import PROXIES


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)
    check_suffix(options.picture, '--picture', PICTURES)

    from power_recordings.reading.bag_folder import check_recordings

    check_recordings(options.bags)

    from power_estimator.evaluation import benchmark, figure
    from power_estimator.evaluation.tables import print_scores

    with progress('reading, aligning and estimating'):
        found = benchmark.run(options.bags, options.models, options.drives)
    title = f'{found.seconds:.0f} s held out ({"; ".join(found.held_out)})'
    print_scores(found.table, title)
    with together():
        if options.json:
            write_json(options.json, found.table)
        if options.picture:
            bars = options.picture.with_stem(options.picture.stem + '_r2')
            figure.draw_traces(options.picture, found.traces, dark=options.dark)
            figure.draw_bars(bars, found.table, title=title, dark=options.dark)
    if options.picture:
        print(f'pictures: {options.picture}, {bars}')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        'power_estimator benchmark',
        'Compare power models on recordings: R², errors in W and in energy, all on samples that '
        'they were not fitted to. Proxies are ' + ', '.join(PROXIES) + '.',
        'example: ros2 run power_estimator benchmark bags/walk --models ppn:runs/first '
        'torque_squared mechanical_power --json benchmark.json',
    )
    add = parser.add_argument
    add('bags', nargs='+', type=Path, metavar='BAG', help='recordings with measured drives')
    add(
        '--models',
        nargs='+',
        required=True,
        metavar='MODEL',
        help='ppn:RUN, model.yaml, proxy, plain (shaft + copper loss + idle), or recorded '
        '(the live estimate in the recording)',
    )
    add('--drives', nargs='+', default=[], metavar='NAME', help='names or patterns, as *_KFE')
    add('--json', type=Path, metavar='FILE', help='write the table there')
    add('--picture', type=Path, metavar='PNG', help='draw the estimates and the R² there')
    add('--dark', action='store_true', help='pictures on a dark ground')
    return parser
