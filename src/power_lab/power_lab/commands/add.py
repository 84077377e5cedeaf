"""`ros2 run power_lab add`: put an effect into a model, refit all, keep the history."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.fit.training import Material, fit_model, material
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import read_model, write_model
from wattwalk_core.command import command
from wattwalk_core.errors import InputError

from power_lab.commands import options as common
from power_lab.compare.evidence import Examiner
from power_lab.recordings import base_power, load
from power_lab.report.tables import print_model


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'add',
        'Add an effect to a model: all coefficients are fitted anew, the history is kept.',
        'example: ros2 run power_lab add load_friction --to base.yaml --bag bags/walk '
        '-o better.yaml',
    )
    add = parser.add_argument
    add('effects', nargs='+', metavar='EFFECT', help='what to add')
    add('--to', required=True, type=Path, metavar='MODEL.yaml', help='the model as it is')
    add('--bag', required=True, nargs='+', type=Path, metavar='BAG', help='recordings to fit on')
    add('--drives', nargs='+', default=[], metavar='NAME', help='only these')
    add('-o', '--output', type=Path, required=True, metavar='MODEL.yaml', help='file to write')
    add('--per', choices=('type', 'drive'), default='type', help='who shares coefficients')
    add('--seed', type=int, default=0, help='of the bootstrap')
    common.add_outputs(parser, report=False)
    options = parser.parse_args(args)
    common.require_suffix(options.output, '.yaml', '-o')
    catalogue = common.catalogue_of(options)
    model = read_model(options.to, catalogue)
    new = common.parse_effects(options.effects, catalogue)
    for active in new:
        if active.name in model.effects:
            raise InputError(f'{active.name!r} is active in {options.to} already')
    with common.waiting() as progress:
        progress.add_task('reading and fitting')
        loaded = load(options.bag, options.drives)
        base = None
        if model.base:
            base = base_power(loaded, model.base).power
        own = material(loaded.data, per=options.per, base=base, catalogue=catalogue)
        better, _ = add_effects(
            model, new, own, catalogue, options.output.stem, loaded.identities, options.seed
        )
    write_model(better, options.output)
    print_model(common.console(), better)
    _print_staircase(better)
    print(f'wrote {options.output}')
    content = {'model': str(options.output), 'history': [dict(e) for e in better.history]}
    common.write_json(options.json, content)
    return 0


def add_effects(
    model: EffectModel,
    new: Sequence[Active],
    own: Material,
    catalogue: Catalogue,
    name: str,
    identities: Sequence[Any],
    seed: int = 0,
) -> tuple[EffectModel, dict[str, Any]]:
    """The model with more effects, fitted to the material, and the new entry of its history."""
    better, _ = fit_model(
        name,
        own,
        [*model.structure.actives, *new],
        catalogue,
        base=model.base,
        fitted_on=identities,
        seed=seed,
    )
    entry = {
        'step': 'add',
        'added': [active.name for active in new],
        'effects': list(better.effects),
        'recordings': [entry['name'] for entry in identities],
        'rmse_before_w': held_out_errors(own, model, catalogue),
        'rmse_w': held_out_errors(own, better, catalogue),
    }
    return better.with_history(*model.history, entry), entry


def held_out_errors(own: Material, model: EffectModel, catalogue: Catalogue) -> dict[str, float]:
    """Cross-validated error of a model's structure on the material, W by drive."""
    terms = measurement_terms(catalogue, shaft='shaft' in model.effects)
    examiner = Examiner(own.fitter())
    evidence = examiner.examine(examiner.fitter.fit(model.structure.plus(*terms), iterations=4))
    return {
        drive: float(f'{value:.4g}')
        for drive, value in zip(own.prepared.names, evidence.rmse, strict=True)
    }


def _print_staircase(model: EffectModel) -> None:
    print('held-out error over the drives, on the recordings of each step:')
    for entry in model.history:
        label = ', '.join(entry.get('added', entry.get('effects', [])))
        before = entry.get('rmse_before_w')
        start = f'{_mean(before):.3f} → ' if before else ''
        after = f'{_mean(entry.get("rmse_w", {})):.3f} W'
        print(f'{entry.get("step", "?"):>4}  {start}{after}  {label}')


def _mean(errors: Mapping[str, float]) -> float:
    return float(np.sqrt(np.mean(np.square(list(errors.values()) or [0.0]))))
