"""`ros2 run power_lab drives`: the library of identified real drives."""

import argparse
from dataclasses import asdict

from rich import box
from rich.table import Table
from wattwalk_core.console import write_json

from power_lab.commands import options as common
from power_lab.drives.library import LibraryDrive, exported, load_drive, names
from power_lab.report.tables import print_model


def run(options: argparse.Namespace) -> None:
    found = [load_drive(name) for name in ([options.name] if options.name else names())]
    if options.json is not None:
        content = [
            {'name': drive.name, **asdict(drive.card), 'effects': list(drive.model.effects)}
            for drive in found
        ]
        write_json(options.json, {'drives': content})
    if options.export:
        print(exported(found[0], options.export), end='')
    elif options.name:
        _show(found[0])
    else:
        _list(found)


def _list(drives: list[LibraryDrive]) -> None:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ('drive', 'what', 'torque', 'R²', 'W', 'effects'):
        table.add_column(column, justify='right' if column in ('R²', 'W') else 'left')
    for drive in drives:
        card, effects = drive.card, ', '.join(drive.model.effects)
        scores = f'{card.r2:.3f}', f'{card.rmse_w:.3g}'
        table.add_row(drive.name, card.title, card.torque, *scores, effects)
    common.console().print(table)
    print('one of them: ros2 run power_lab drives NAME; to start from it: fit --prior drive:NAME')


def _show(drive: LibraryDrive) -> None:
    card = drive.card
    print(f'{drive.name}: {card.title}')
    print(f'recorded: {card.recorded}')
    print(f'source: {card.source} ({card.licence}), {card.logs}')
    print(f'held out: R² {card.r2:.4f}, {card.rmse_w:.3g} W, over {card.extent}')
    print_model(common.console(), drive.model)
    for line in card.findings:
        print(line)
    print('not determined:')
    for line in card.does_not_determine:
        print(f'  {line}')
    print(f'model and picture: {drive.picture.parent}')
