"""`ros2 run power_lab to_plant`: switch on in the simulator what was found on the robot."""

from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command
from wattwalk_core.console import check_suffix, write_json
from wattwalk_core.files import together

from power_lab.commands import options as common


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'to_plant',
        "Write a plant file for the simulator with a model's effects at their fitted strength.",
        'example: ros2 run power_lab to_plant better.yaml -o plant.yaml && '
        'ros2 run sim_bridge sim --offline --plant plant.yaml -o bags/like_the_robot',
    )
    add = parser.add_argument
    add('model', type=Path, metavar='MODEL.yaml', help='fitted model')
    add('--plant', default='anymal_c', metavar='FILE', help='plant to start from')
    add('-o', '--output', type=Path, required=True, metavar='PLANT.yaml', help='file to write')
    common.add_outputs(parser, report=False)
    options = parser.parse_args(args)
    check_suffix(options.output, '-o', ('.yaml',))

    from power_estimator.effects.model_file.yaml_file import read_model
    from sim_bridge.plant.parameters import Plant

    from power_lab.challenge.plant_export import to_plant

    model = read_model(options.model, common.catalogue_of(options))
    plant, strengths = to_plant(model, Plant.load(options.plant))
    with together():
        plant.save(options.output)
        if options.json is not None:
            write_json(options.json, {'plant': str(options.output), 'strengths': strengths})
    for name, value in strengths.items():
        print(f'{name:24} {value:.3g} times that of {options.plant}')
    print(f'wrote {options.output}')
    return 0
