"""`ros2 run sound_levels sound`: sound levels by policy from sound files, after Figure 7."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from power_recordings.reading.bag_folder import check_recordings
from wattwalk_core.console import output, print_table, progress, write_json
from wattwalk_core.errors import InputError
from wattwalk_core.figures import save_figure
from wattwalk_core.files import together

from sound_levels.levels.analysis import Analysis, analyse
from sound_levels.levels.settings import Entry, Settings
from sound_levels.levels.sound_file import SoundFile
from sound_levels.levels.summary import LEVEL_COLUMNS, level_rows, sentences, summary
from sound_levels.report.page import draw_sound, write_sound_report


def entries_of(
    files: Sequence[Path], policies: Sequence[str], recordings: Sequence[Path]
) -> list[Entry]:
    """Return the files to analyse, in the order given.

    policies: `NAME=WAV,WAV` each. recordings: none, or one per sound file; else InputError.
    """
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
    bags: Sequence[Path | None] = recordings or [None] * len(found)
    return [replace(entry, recording=bag) for entry, bag in zip(found, bags, strict=True)]


def run(options: argparse.Namespace) -> None:
    """Measure sound files, compare policies and report; InputError for bad input."""
    entries = entries_of(options.files, options.policy, options.recording)
    settings = Settings(**{name: getattr(options, name) for name in Settings.__annotations__})
    check_recordings(options.recording)
    for entry in entries:
        SoundFile(entry.path)
    with progress('measuring') as show:
        analysis = analyse(
            entries, settings, options.calibration, lambda name: show(f'measuring {name}')
        )
        show('comparing')
        result = summary(analysis)
    with together():
        write_json(options.json, result)
        if options.picture is not None:
            save_figure(draw_sound(analysis), options.picture)
        if options.report is not None:
            write_sound_report(options.report, analysis)
    _print(analysis)
    for path in (options.json, options.picture, options.report):
        if path is not None:
            print(path)
    if analysis.tone is None:
        print('next: record a calibrator at the same gain and give it as --calibration TONE.wav')
    elif not options.recording:
        print('next: --recording BAG… aligns sound and power, and evaluates walking only')
    elif options.report is None:
        print('next: --report sound.html shows levels, spectra and the alignment')


def _print(analysis: Analysis) -> None:
    console = output()
    title = f'{analysis.unit}, {analysis.settings.time}'
    print_table(console, LEVEL_COLUMNS, level_rows(analysis), title)
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
