"""`ros2 run power_lab add`: put an effect into a model, refit all, keep the history."""

import argparse

from power_estimator.effects import load_catalogue
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import read_model
from power_estimator.judge.result import over_meters
from power_recordings.reading.bag_folder import check_recordings
from wattwalk_core.console import progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from power_lab.commands import options as common
from power_lab.compare.fitting import named_effects
from power_lab.report.tables import print_model
from power_lab.session import Session


def run(options: argparse.Namespace) -> None:
    check_recordings(options.bag)
    catalogue = load_catalogue(options.effects_path)
    model = read_model(options.to, catalogue)
    for active in named_effects(options.effects, catalogue):
        if active.name in model.effects:
            raise InputError(f'{active.name!r} is active in {options.to} already')
    with progress('reading and fitting'):
        lab = Session.open(*options.bag, catalogue=catalogue, **common.reading_of(options))
        lab = lab.load(str(options.to)).add(
            options.effects, name=options.output.stem, per=options.per, seed=options.seed
        )
    better = lab.effects
    content = {
        'model': str(options.output),
        'history': [dict(e) for e in better.history],
        'at_bound': list(better.at_bound),
    }
    with together():
        lab.save(options.output)
        write_json(options.json, content)
    print_model(common.console(), better)
    _print_staircase(better)
    print(f'wrote {options.output}')


def _print_staircase(model: EffectModel) -> None:
    print('held-out error over the drives, on the recordings of each step:')
    for entry in model.history:
        label = ', '.join(entry.get('added', entry.get('effects', [])))
        before, own = entry.get('rmse_before_w'), over_meters(entry.get('rmse_w', {}).values())
        after = f'{own:.3f} W'
        how = entry.get('held_out')
        if before and entry.get('held_out_before', how) == how:
            after = f'{over_meters(before.values()):.3f} → {after}'
        elif before:
            former = entry['held_out_before']
            after += f' ({how}); the model before: {over_meters(before.values()):.3f} W ({former})'
        print(f'{entry.get("step", "?"):>4}  {after}  {label}')
