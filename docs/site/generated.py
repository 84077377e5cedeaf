"""Parts of the site that the code knows: commands, messages, effects (a hook of MkDocs)."""

import base64
import importlib
import io
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
WIDTH = 88
"""Columns of a help text, which fit beside the navigation."""
MARKER = re.compile(r'^<!-- (\w+)(?:: (\w+))? -->$', re.MULTILINE)


@contextmanager
def _terminal() -> Iterator[None]:
    """Set a terminal of fixed width and without colour."""
    before = dict(os.environ)
    os.environ.update(COLUMNS=str(WIDTH), NO_COLOR='1')
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def commands_of(package: str) -> dict[str, tuple[str, str]]:
    """Return module and function of each command of a package, as its setup.cfg has them."""
    sys.path.insert(0, str(ROOT / 'bench'))
    try:
        known = importlib.import_module('commands_start').entry_points()
    finally:
        sys.path.pop(0)
    return {name: target for (owner, name), target in known.items() if owner == package}


def help_of(module: str, function: str) -> str:
    """Return what a command prints with --help."""
    shown = io.StringIO()
    with _terminal(), redirect_stdout(shown), suppress(SystemExit):
        getattr(importlib.import_module(module), function)(['--help'])
    return shown.getvalue().rstrip()


def commands(package: str) -> str:
    """Return a section with the help text of each command of a package."""
    parts = []
    for name, target in sorted(commands_of(package).items()):
        parts.append(f'## {name}\n\n```text\n{help_of(*target)}\n```\n')
    if not parts:
        raise ValueError(f'{package} has no commands')
    return '\n'.join(parts)


def message(name: str) -> str:
    """Return the definition of a message."""
    file = ROOT / 'src' / 'drive_power_msgs' / 'msg' / f'{name}.msg'
    return f'```text\n{file.read_text(encoding="utf-8").rstrip()}\n```'


def _bound(value: float) -> str:
    return {float('inf'): '∞', float('-inf'): '−∞'}.get(value, f'{value:g}'.replace('-', '−'))


def _names(names: tuple[str, ...], known: dict[str, Any]) -> str:
    if not names:
        return '–'
    return ', '.join(f'[`{name}`](#{name})' if name in known else f'`{name}`' for name in names)


def effects(kind: str) -> str:
    """Return a section for each effect of a kind: physics or measurement."""
    from power_estimator.effects import builtin_catalogue

    acts_on = {'power': 'the power, W', 'torque': "the motor's torque, N·m",
               'speed': "the motor's speed, rad/s"}  # fmt: skip
    catalogue = builtin_catalogue()
    known = {name: catalogue[name] for name in catalogue}
    parts = []
    for name, effect in known.items():
        if effect.kind != kind:
            continue
        terms = ', '.join(
            f'`{term.symbol}` [{term.unit}] {_bound(term.lower)} … {_bound(term.upper)}'
            for term in effect.terms
        )
        if effect.fixed is not None:
            terms += f', fixed at {effect.fixed:g}'
        shapes = '; '.join(
            ', '.join(f'{key} = {value:g}' for key, value in shape.items())
            for shape in effect.shapes
            if shape
        )
        rows = {
            'Formula': f'`{effect.formula}`',
            'Coefficients: symbol, unit, bounds': terms,
            'Acts on': acts_on[effect.acts_on],
            'Shapes that are tried': shapes or '–',
            'Needs the torque at the joint': 'yes' if effect.needs_joint_torque else 'no',
            'Ties: no recording tells it from': _names(effect.ties, known),
            'Near: only its excitation tells it from': _names(effect.near, known),
            'Excitation that separates it': effect.excitation.text,
        }
        table = '\n'.join(f'| {key} | {value} |' for key, value in rows.items())
        physics = effect.physics[0].upper() + effect.physics[1:]
        parts.append(f'### {name}\n\n{physics}.\n\n| | |\n|---|---|\n{table}\n')
    return '\n'.join(parts)


def drives(_: str) -> str:
    """Return a section with picture for each drive of the library."""
    from power_lab.drives.library import load_drive, names

    parts = []
    for name in names():
        drive = load_drive(name)
        card, group = drive.card, drive.model.groups[0]
        rows = {'Recorded': card.recorded, 'Source': f'{card.source} ({card.licence})',
                'Held out': f'R² {card.r2:.4f}, {card.rmse_w:.3g} W over {card.extent}',
                'Torque': f'at the {card.torque}'}  # fmt: skip
        for active in drive.model.structure.free:
            values = zip(active.effect.terms, group.coefficients[active.name], strict=True)
            for term, own in values:
                low, high = own.interval
                at_bound = ', at its bound' if own.at_bound else ''
                text = f'{own.value:.3g} ({low:.3g} … {high:.3g}) {term.unit}{at_bound}'
                rows[f'`{active.name}` {term.symbol}'] = text
        table = '\n'.join(f'| {key} | {value} |' for key, value in rows.items())
        told = '\n'.join(f'- {line}' for line in card.findings)
        lacking = '\n'.join(f'- {line}' for line in card.does_not_determine)
        image = base64.b64encode(drive.picture.read_bytes()).decode()
        parts.append(
            f'## {name}\n\n{card.title[0].upper() + card.title[1:]}.\n\n'
            f'| | |\n|---|---|\n{table}\n\n'
            f'![{name}: measured against model, efficiency](data:image/png;base64,{image})\n\n'
            + (f'{told}\n\n' if told else '')
            + f'Not determined:\n\n{lacking}\n'
        )
    return '\n'.join(parts)


SOURCES: dict[str, Callable[[str], str]] = {
    'commands': commands,
    'message': message,
    'effects': effects,
    'drives': drives,
}


def filled(markdown: str) -> str:
    """Return a page in which each marker `<!-- source: name -->` is replaced by its part."""

    def part(found: re.Match[str]) -> str:
        source = SOURCES.get(found[1])
        return source(found[2]) if source else found[0]

    return MARKER.sub(part, markdown)


BLOCK = re.compile(r'\||[-*] |\d+\. ')
FENCE = re.compile(r' *(```|~~~)')


def separated(markdown: str) -> str:
    """Return a page with an empty line before tables and lists, which GitHub does without."""
    lines: list[str] = []
    fenced = False
    for line in markdown.split('\n'):
        start = None if fenced else BLOCK.match(line)
        before = lines[-1] if lines else ''
        same = BLOCK.match(before)
        begins = same is None or (start and (same[0] == '|') != (start[0] == '|'))
        if start and begins and before.strip() and not before.startswith(' '):
            lines.append('')
        if FENCE.match(line):
            fenced = not fenced
        lines.append(line)
    return '\n'.join(lines)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Complete the page, as MkDocs reads it."""
    return filled(separated(markdown))
