"""`ros2 run power_lab fit`: coefficients of named effects from recordings."""

import argparse
from dataclasses import asdict

from power_estimator.effects import load_catalogue
from power_estimator.posterior.priors import LEAST_TO_JUDGE
from power_recordings.reading.bag_folder import check_recordings
from wattwalk_core.console import progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from power_lab.commands import options as common
from power_lab.compare.both_sides import both_sides
from power_lab.compare.fitting import named_effects
from power_lab.compare.notes import notes
from power_lab.drives.library import load_drive
from power_lab.report.tables import balance_lines, balances_json, power_balances, print_model
from power_lab.session import Session


def run(options: argparse.Namespace) -> None:
    check_recordings(options.bags)
    catalogue = load_catalogue(options.effects_path)
    effects = named_effects(options.effects, catalogue)
    prior = load_drive(options.prior).model.as_prior() if options.prior else None
    if prior is not None and not {effect.name for effect in effects} & {*prior}:
        raise InputError(f'--prior {options.prior}: it has {", ".join(prior)}, none of --effects')
    with progress('reading and fitting'):
        lab = Session.open(*options.bags, catalogue=catalogue, **common.reading_of(options)).fit(
            options.effects,
            name=options.output.stem,
            base=options.base,
            per=options.per,
            seed=options.seed,
            prior=prior,
        )
    model, loaded, prepared = lab.effects, lab.recordings, lab.judge.prepared
    (entry,) = model.history
    balances = power_balances(loaded.data)
    both = both_sides(lab.judge, options.seed)
    content = {
        'model': str(options.output),
        **entry,
        'at_bound': list(model.at_bound),
        'measurement': {
            group.type.name: {
                name: {**asdict(value), 'at_bound': value.at_bound or None}
                for name, value in group.measurement.items()
            }
            for group in model.groups
        },
        'power_balance': balances_json(balances),
        'both_sides': {name: one.json() for name, one in both.items()},
    }
    with together():
        lab.save(options.output)
        write_json(options.json, content)
    for line in balance_lines(loaded.data, balances):
        print(line)
    print_model(common.console(), model)
    for one in both.values():
        print('\n'.join(one.lines()))
    for note in notes(prepared):
        print(note)
    errors = ', '.join(f'{drive} {value:.2f} W' for drive, value in entry['rmse_w'].items())
    print(f'wrote {options.output}; held-out error: {errors}')
    if prepared.steady or prepared.seconds >= LEAST_TO_JUDGE:
        print(common.next_command('diagnose', options, '--model', options.output))
    else:
        print(f'next: record {10 * LEAST_TO_JUDGE:.0f} s or more, and fit that')
