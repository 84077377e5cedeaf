"""`ros2 run power_daq sound`: how loud policies are, from sound files; after Figure 7."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rclpy.utilities import remove_ros_args
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from wattwalk_core.command import command
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from sound_levels.levels.alignment import METHODS
from sound_levels.levels.analysis import (
    Analysis,
    Entry,
    Settings,
    analyse,
    sentences,
    summary,
)
from sound_levels.levels.meter import TIMES
from sound_levels.levels.weighting import WEIGHTINGS

_EPILOG = """\
Without --calibration levels are relative to full scale, and only differences mean anything.

examples:
  ros2 run power_daq sound walk.wav
  ros2 run power_daq sound --policy baseline=b1.wav,b2.wav --policy pmp=p1.wav,p2.wav \\
      --calibration tone.wav --report sound.html
  ros2 run power_daq sound b.wav p.wav --recording bags/b bags/p --calibration tone.wav \\
      --picture fig7.png
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='ros2 run power_daq sound',
        description='Sound levels over time (IEC 61672-1) of sound files, by policy, in dB SPL '
        'with a calibrator; statistics, differences with intervals, third-octave spectra.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add('files', nargs='*', type=Path, metavar='WAV', help='wav, flac, …; 8 to 192 kHz')
    add(
        '--policy',
        action='append',
        default=[],
        metavar='NAME=WAV,WAV',
        help='files of one policy; the first policy is what the others are compared with',
    )
    add(
        '--recording',
        nargs='+',
        default=[],
        type=Path,
        metavar='BAG',
        help='made at the same time: one for each file, in the order of the files',
    )
    add('--calibration', type=Path, metavar='WAV', help='of an acoustic calibrator, same gain')
    add('--level', type=float, default=94.0, metavar='DB', help='of the calibrator (94 dB SPL)')
    add('--tone', type=float, default=1000.0, metavar='HZ', help='of the calibrator (1000)')
    add('--weighting', choices=WEIGHTINGS, default='A')
    add('--time', choices=tuple(TIMES), default='fast', help='weighting: 125 ms or 1 s')
    add('--channel', type=int, metavar='N', help='from 1; without, the mean of all by energy')
    add('--align', choices=METHODS, default='auto', help='how sound and recording are laid on')
    add('--clap-at', type=float, metavar='S', help='of the recording, where its IMU felt none')
    add('--from', dest='start', type=float, metavar='S', help='what counts of each file')
    add('--to', dest='stop', type=float, metavar='S')
    add('--json', type=Path, metavar='F', help='the figures')
    add('--report', type=Path, metavar='F.html', help='one page, without network')
    add('--picture', type=Path, metavar='F.png', help='level over time, as Figure 7')
    return parser


def entries_of(
    files: Sequence[Path], policies: Sequence[str], recordings: Sequence[Path]
) -> list[Entry]:
    """Files and their policies in the order given; InputError for what does not add up."""
    found = [Entry(path) for path in files]
    for text in policies:
        name, equals, paths = text.partition('=')
        given = [part for part in paths.split(',') if part]
        if not (name and equals and given):
            raise InputError(f'--policy {text!r}: expected NAME=WAV,WAV')
        found += [Entry(Path(path), name) for path in given]
    if not found:
        raise InputError('no sound file given; expected WAV… or --policy NAME=WAV,WAV')
    if recordings and len(recordings) != len(found):
        raise InputError(
            f'{len(recordings)} recordings for {len(found)} sound files; give one for each'
        )
    if not recordings:
        return found
    pairs = zip(found, recordings, strict=True)
    return [Entry(entry.path, entry.policy, bag) for entry, bag in pairs]


@command
def main(args: Sequence[str] | None = None) -> int:
    """Measure, compare and report; 2 for bad input."""
    given = list(sys.argv if args is None else ['sound', *args])
    options = _parser().parse_args(remove_ros_args(given)[1:])
    entries = entries_of(options.files, options.policy, options.recording)
    settings = Settings(
        weighting=options.weighting,
        time=options.time,
        channel=options.channel,
        align=options.align,
        clap_at=options.clap_at,
        start=options.start,
        stop=options.stop,
        level=options.level,
        tone=options.tone,
    )
    columns = (SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task('listening')
        analysis = analyse(
            entries,
            settings,
            options.calibration,
            lambda name: progress.update(task, description=f'listening to {name}'),
        )
        progress.update(task, description='comparing')
        result = summary(analysis)
    _show(analysis)
    if options.json is not None:
        write_whole(options.json, json.dumps(result, indent=1, allow_nan=False) + '\n')
    if options.picture is not None:
        from sound_levels.report.figure import draw_sound

        draw_sound(options.picture, analysis)
    if options.report is not None:
        from sound_levels.report.page import write_report

        write_report(options.report, analysis)
    _say_next(options, analysis)
    return 0


def _show(analysis: Analysis) -> None:
    console = Console(width=None if sys.stdout.isatty() else 100)
    title = f'{analysis.unit}, {analysis.settings.time}'
    table = Table(title=title, title_justify='left', box=SIMPLE_HEAD)
    table.add_column('policy', overflow='fold')
    for name in ('files', 'counted s', 'Leq', 'L10', 'L50', 'L90', 'max'):
        table.add_column(name, justify='right', no_wrap=True)
    for name in analysis.policies:
        found = analysis.levels(name)
        figures = (found.leq, found.l10, found.l50, found.l90, found.max)
        table.add_row(
            name,
            str(len(analysis.of(name))),
            f'{found.seconds:.0f}',
            *(f'{value:.1f}' for value in figures),
        )
    console.print(table)
    for sentence in sentences(analysis):
        console.print(sentence)
    for take in analysis.takes:
        found = take.alignment
        if found is not None:
            console.print(
                f'{take.path.name} starts at {found.offset:+.3f} s of {take.recording} '
                f'(by {found.method}; correlation {found.correlation:.2f}, '
                f'drift {found.drift:+.0f} ppm)',
                soft_wrap=True,
                highlight=False,
            )
        for warning in take.warnings:
            console.print(f'{take.path.name}: {warning}', style='yellow', soft_wrap=True)
    for warning in analysis.warnings:
        console.print(warning, style='yellow', soft_wrap=True)


def _say_next(options: argparse.Namespace, analysis: Analysis) -> None:
    for path in (options.json, options.picture, options.report):
        if path is not None:
            print(path)
    if analysis.tone is None:
        print('next: record a calibrator at the same gain and give it as --calibration TONE.wav')
    elif not options.recording:
        print('next: --recording BAG… lays sound and power on one time, and counts walking only')
    elif options.report is None:
        print('next: --report sound.html shows curves, spectra and how well the times agree')
