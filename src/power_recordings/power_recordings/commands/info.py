"""`ros2 run power_recordings info`: content and quality of a recording."""

import argparse
from dataclasses import asdict

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from wattwalk_core.console import finite, write_json
from wattwalk_core.errors import printable

from power_recordings.index.kept_quality import Checked, checked
from power_recordings.index.store import RecordingIndex, usual_path

_WIDTH = 130
_FINDING = 1000  # characters
_UNITS = {'power': 'W', 'voltage': 'V', 'current': 'A'}  # of a supply


def run(options: argparse.Namespace) -> None:
    """Check recordings (or take their results from the index) and print their quality."""
    with RecordingIndex(usual_path()) as index:
        found = [checked(path, index) for path in options.bags]
    write_json(options.json, finite({str(one.path): asdict(one.quality) for one in found}))
    for one in found:
        print_quality(one)


def print_quality(checked: Checked) -> None:
    """Print a recording's card, topic timing, a table by drive and its findings."""
    console = Console(highlight=False, soft_wrap=True)
    console.width = max(console.width, _WIDTH)
    card, quality = checked.card, checked.quality
    about = ', '.join(text for text in (card.robot, card.unit, card.controller) if text)
    console.print(
        f'[bold]{_plain(str(checked.path))}[/]  {quality.seconds:.1f} s  {_plain(about)}'
    )
    for name, timing in quality.topics.items() if not card.steady else ():
        many = 'gap' if timing.gaps == 1 else 'gaps'
        gaps = (
            f', {timing.gaps} {many} of {timing.gap_seconds:.2f} s in all' if timing.gaps else ''
        )
        console.print(
            f'  {name}: {timing.samples} samples at {timing.rate:.4g} Hz, '
            f'jitter ±{100 * timing.jitter:.1f} %{gaps}'
        )
    if card.steady:
        points = max((timing.samples for timing in quality.topics.values()), default=0)
        console.print(f'  {points} operating points, of which none follows on another')
    caption = '1 % of samples are below each range, 1 % above'
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, caption=caption, caption_justify='left')
    units = dict.fromkeys(card.torque_unit.get(name, 'N*m') for name in quality.drives)
    torque = f'torque {" or ".join(units)}'.replace('*', '·')
    checks = ('drive', 'torque', 'updates', 'dP/d(τω)', 'of var P', 'ω/(dq/dt)')
    for head in (*checks, torque, 'speed rad/s', 'power W', 'τ–ω seen'):
        table.add_column(head, justify='left' if head in ('drive', 'torque') else 'right')
    for name, drive in quality.drives.items():
        ranges = (drive.torque_range, drive.velocity_range, drive.power_range)
        table.add_row(
            _plain(name),
            ' '.join((quality.torque_at.get(name, ''), card.torque_unit.get(name, ''))).strip(),
            _figure(drive.updates_hz, '{:.0f} Hz'),
            _figure(drive.power_slope, '{:.2f}'),
            _figure(drive.power_share, '{:.0%}'),
            _figure(drive.velocity_slope, '{:.2f}'),
            *map(_span, ranges),
            f'{100 * drive.cells:.0f} %',
        )
    console.print(table)
    if (supply := quality.supply) is not None:
        signals = (
            f'{name} {_span(ends)} {_UNITS[name]} ({supply.updates_hz[name]:.0f} Hz)'
            for name, ends in supply.ranges.items()
        )
        console.print(f'  supply: {", ".join(signals)}')
        if supply.slope == supply.slope:
            line = f'{supply.slope:.2f} × sum of its drives {supply.offset:+.1f} W'
            console.print(f'  robot = {line} (R² {supply.r2:.2f})')
    if quality.robot is not None:
        console.print(f'  power of the robot: {quality.robot}')
    if card.derived_velocity:
        drives = _plain(', '.join(card.derived_velocity))
        console.print(f'  note: velocity is the rate of the position, not measured: {drives}')
    for mark in card.marks:
        console.print(f'  noted {_plain(mark.time)}: {_plain(mark.text)}')
    for problem in checked.problems:
        console.print(f'  note: {_plain(problem)}')
    for finding in quality.findings:
        console.print(f'  {finding.severity}: {_plain(str(finding), _FINDING)}')


def _plain(text: str, longest: int = 200) -> str:
    """A text of a file or a user as rich prints it: no markup, no control characters."""
    return escape(printable(text, longest))


def _span(ends: tuple[float, float]) -> str:
    return '…'.join(dict.fromkeys(_figure(x, '{:z.3g}') for x in ends))


def _figure(value: float, form: str) -> str:
    return '–' if value != value else form.format(value)
