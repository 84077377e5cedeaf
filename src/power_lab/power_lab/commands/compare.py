"""`ros2 run power_lab compare`: models against measurements, and where they fail."""

from collections.abc import Sequence

from wattwalk_core.command import command
from wattwalk_core.console import check_suffix, progress, write_json
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from power_lab.commands import options as common


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'compare',
        'Compare power models with measurements on held-out data: error, bias, energy, and the '
        'regimes in which each model is worst.',
        'example: ros2 run power_lab compare bags/walk --models base.yaml better.yaml '
        'mechanical_power --report compare.html',
    )
    common.add_bags(parser)
    parser.add_argument(
        '--models',
        nargs='+',
        required=True,
        metavar='MODEL',
        help='model.yaml, ppn:RUN or a proxy',
    )
    add_workplace(parser, 'recordings read')
    common.add_outputs(parser)
    options = parser.parse_args(args)
    place = Workplace.of(options)
    check_suffix(options.report, '--report', ('.html',))
    if len(set(options.models)) < len(options.models):
        raise InputError(f'--models names a model twice: {", ".join(options.models)}')
    common.check_bags(options.bags)
    catalogue = common.catalogue_of(options)
    common.check_models(options.models, catalogue)

    from power_estimator.judge.recordings import load

    from power_lab.compare.comparison import compare
    from power_lab.report.page import closest, write_comparison
    from power_lab.report.tables import print_comparison

    with progress('reading') as show:
        with common.reading_engine(place, options.bags) as engine:
            doubts = {'slow': options.slow, 'anyway': options.anyway}
            loaded = load(options.bags, options.drives, **doubts, engine=engine, show=show)
        show('comparing')
        comparison = compare(loaded, options.models, catalogue)
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
