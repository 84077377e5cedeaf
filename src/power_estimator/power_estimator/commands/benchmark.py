"""`ros2 run power_estimator benchmark`: models side by side on recordings."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from wattwalk_core.command import command
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from power_estimator.evaluation import benchmark, figure
from power_estimator.evaluation.tables import print_table, terminal
from power_estimator.proxies import PROXIES


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(args)
    if options.picture and options.picture.suffix not in ('.png', '.svg', '.pdf'):
        raise InputError(f'--picture {str(options.picture)!r}: end it in .png, .svg or .pdf')
    with Console(stderr=True).status('reading, aligning and estimating'):
        found = benchmark.run(options.bags, options.models, options.drives)
    if options.json:
        write_whole(options.json, json.dumps(found.table, indent=1, allow_nan=False) + '\n')
    title = f'{found.seconds:.0f} s ' + (
        'held out when the network was trained'
        if found.held_out
        else 'of recordings no model was trained on'
    )
    print_table(terminal(), found.table, title)
    if options.picture:
        figure.draw_traces(options.picture, found.traces, dark=options.dark)
        bars = options.picture.with_stem(options.picture.stem + '_r2')
        figure.draw_bars(bars, found.table, title=title, dark=options.dark)
        print(f'pictures: {options.picture}, {bars}')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='benchmark',
        description='Compare power models on recordings: R², errors in W and in energy. Networks '
        'are judged on what they were not trained on. Proxies are ' + ', '.join(PROXIES) + '.',
        epilog='example: ros2 run power_estimator benchmark bags/walk --models ppn:runs/first '
        'torque_squared mechanical_power --json benchmark.json',
    )
    add = parser.add_argument
    add('bags', nargs='+', type=Path, metavar='BAG', help='recordings with measured drives')
    add(
        '--models',
        nargs='+',
        required=True,
        metavar='MODEL',
        help='ppn:RUN, model.yaml, proxy, plain (shaft + copper loss + idle, fitted), or recorded '
        '(the live estimate in the recording)',
    )
    add('--drives', nargs='+', default=[], metavar='NAME', help='names or patterns, as *_KFE')
    add('--json', type=Path, metavar='FILE', help='write the table there')
    add('--picture', type=Path, metavar='PNG', help='draw the estimates and the R² there')
    add('--dark', action='store_true', help='pictures on a dark ground')
    return parser
