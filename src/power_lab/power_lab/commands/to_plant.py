"""`ros2 run power_lab to_plant`: switch on in the simulator what was found on the robot."""

import argparse

from power_estimator.effects import load_catalogue
from power_estimator.effects.model_file.yaml_file import read_model
from sim_bridge.plant.parameters import Plant
from wattwalk_core.console import write_json
from wattwalk_core.files import together

from power_lab.challenge.plant_export import to_plant


def run(options: argparse.Namespace) -> None:
    model = read_model(options.model, load_catalogue(options.effects_path))
    plant, strengths = to_plant(model, Plant.load(options.plant))
    with together():
        plant.save(options.output)
        write_json(options.json, {'plant': str(options.output), 'strengths': strengths})
    for name, value in strengths.items():
        print(f'{name:24} {value:.3g} times that of {options.plant}')
    print(f'wrote {options.output}')
