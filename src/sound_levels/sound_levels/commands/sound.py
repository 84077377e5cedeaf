"""`ros2 run sound_levels sound`: sound levels by policy from sound files, after Figure 7."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wattwalk_core.command import command, command_parser, own_arguments
from wattwalk_core.console import output, print_table, progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.files import together

from sound_levels.levels.settings import METHODS, TIMES, WEIGHTINGS, Entry, Settings

if TYPE_CHECKING:
    from sound_levels.levels.analysis import Analysis

_EPILOG = """\
Without --calibration levels are relative to full scale, and only differences are meaningful.

examples:
  ros2 run sound_levels sound walk.wav
  ros2 run sound_levels sound --policy baseline=b1.wav,b2.wav --policy pmp=p1.wav,p2.wav \\
      --calibration tone.wav --report sound.html
  ros2 run sound_levels sound b.wav p.wav --recording bags/b bags/p --calibration tone.wav \\
      --picture fig7.png
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        'sound_levels sound',
        'Sound levels over time (IEC 61672-1) of sound files, by policy, in dB SPL '
        'with a calibrator; statistics, differences with intervals, third-octave spectra.',
        _EPILOG,
    )
    add = parser.add_argument
    add('files', nargs='*', type=Path, metavar='WAV', help='wav, flac, …; 8 to 192 kHz')
    add(
        '--policy',
        action='append',
        default=[],
        metavar='NAME=WAV,WAV',
        help='files of one policy; the others are compared with the first policy',
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
    add('--channel', type=int, metavar='N', help='from 1; default: the energy mean of all')
    add('--align', choices=METHODS, default='auto', help='alignment of sound and recording')
    add('--clap-at', type=float, metavar='S', help='of the recording, if its IMU has no jolt')
    add('--from', dest='start', type=float, metavar='S', help='start of the evaluated part')
    add('--to', dest='stop', type=float, metavar='S', help='its end')
    add('--json', type=Path, metavar='F', help='results as JSON')
    add('--report', type=Path, metavar='F.html', help='one page that needs no network')
    add('--picture', type=Path, metavar='F.png', help='level over time, as Figure 7')
    return parser


def entries_of(
    files: Sequence[Path], policies: Sequence[str], recordings: Sequence[Path]
) -> list[Entry]:
    """Return files with their policies in the order given; InputError for a wrong number."""
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
    options = _parser().parse_args(own_arguments(args))
    entries = entries_of(options.files, options.policy, options.recording)
    settings = Settings(**{name: getattr(options, name) for name in Settings.__annotations__})
    from power_recordings.reading.bag_folder import check_recordings

    from sound_levels.levels.sound_file import SoundFile

    check_recordings(options.recording)
    for entry in entries:
        SoundFile(entry.path)

    from sound_levels.levels.analysis import analyse
    from sound_levels.levels.summary import summary

    with progress('measuring') as show:
        analysis = analyse(
            entries, settings, options.calibration, lambda name: show(f'measuring {name}')
        )
        show('comparing')
        result = summary(analysis)
    _print(analysis)
    with together():
        if options.json is not None:
            write_json(options.json, result)
        if options.picture is not None:
            from sound_levels.report.figure import draw_sound

            draw_sound(options.picture, analysis)
        if options.report is not None:
            from sound_levels.report.page import write_report

            write_report(options.report, analysis)
    for path in (options.json, options.picture, options.report):
        if path is not None:
            print(path)
    if analysis.tone is None:
        print('next: record a calibrator at the same gain and give it as --calibration TONE.wav')
    elif not options.recording:
        print('next: --recording BAG… aligns sound and power, and evaluates walking only')
    elif options.report is None:
        print('next: --report sound.html shows levels, spectra and the alignment')
    return 0


def _print(analysis: 'Analysis') -> None:
    from sound_levels.levels.summary import LEVEL_COLUMNS, level_cells, sentences

    console = output()
    rows = []
    for name in analysis.policies:
        found = analysis.levels(name)
        files = str(len(analysis.of(name)))
        rows.append((name, files, f'{found.seconds:.0f}', *level_cells(found)))
    columns = ('policy', 'files', 'counted s', *LEVEL_COLUMNS)
    print_table(console, columns, rows, title=f'{analysis.unit}, {analysis.settings.time}')
    for sentence in sentences(analysis):
        console.print(sentence)
    for take in analysis.takes:
        alignment = take.alignment
        if alignment is not None:
            console.print(
                f'{take.path.name} starts at {alignment.offset:+.3f} s of {take.recording} '
                f'(by {alignment.method}; correlation {alignment.correlation:.2f}, '
                f'drift {alignment.drift:+.0f} ppm)',
                soft_wrap=True,
            )
        for warning in take.warnings:
            console.print(f'{take.path.name}: {warning}', style='yellow', soft_wrap=True)
    for warning in analysis.warnings:
        console.print(warning, style='yellow', soft_wrap=True)
