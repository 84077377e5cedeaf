"""Report of a sound analysis as one page that needs no network."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from wattwalk_core.figures import BLUE, OTHERS, embedded, style
from wattwalk_core.pages.page import Page

from sound_levels.levels.analysis import Analysis, Take
from sound_levels.levels.statistics import decibels
from sound_levels.levels.summary import LEVEL_COLUMNS, level_rows, sentences

COLOURS = {dark: (blue, *OTHERS) for dark, blue in BLUE.items()}
DASHES = ('-', (0, (5, 1.5)), (0, (1.5, 1)), '-.')
_SHOWN = 30.0  # s
_CLOSE_UP = 3.0  # s shown of an alignment
_POINTS = 20.0  # Hz


def draw_sound(analysis: Analysis, dark: bool = False) -> Figure:
    """Draw the level of each policy over time, and third-octave spectra."""
    with style(dark) as ink:
        figure = Figure(figsize=(9, 6.4), layout='constrained')
        above, below = figure.subplots(2, 1, height_ratios=(3, 2))
        for index, name in enumerate(analysis.policies):
            color = COLOURS[dark][index % len(COLOURS[dark])]
            line = {'color': color, 'ls': DASHES[index % len(DASHES)]}
            _curve(above, analysis, name, line)
            if levels := [*analysis.bands(name).values()]:
                below.plot(levels, marker='os^D'[index % 4], ms=3, label=name, **line)
        settings = analysis.settings
        aligned = all(take.alignment is not None for take in analysis.takes)
        since = 'the first landing of a foot' if aligned else 'the start of the evaluated part'
        above.set_xlabel(f'time since {since} [s]')
        above.set_ylabel(f'{settings.time} level [{analysis.unit}]')
        title = f'Sound level over time: {settings.time} (thin), mean of a second (thick)'
        above.set_title(title, loc='left', fontsize=11)
        low, high = above.get_ylim()
        above.set_ylim(low, high + 0.2 * (high - low))
        above.legend(loc='upper right', ncols=2, frameon=False, fontsize=8, labelcolor=ink)
        _spectrum_axis(below, analysis, ink)
    return figure


def draw_alignment(analysis: Analysis, take: Take, dark: bool = False) -> Figure:
    """Draw 3 s of a take's level with landings as lines; ValueError for one without alignment."""
    if take.alignment is None or take.events is None:
        raise ValueError('a take without alignment')
    time = take.alignment.of(take.sound.time)
    landings = take.events.landings
    landings = landings[(landings > time[0]) & (landings < time[-1])]
    start = float(landings[len(landings) // 2]) - 0.1 if len(landings) else float(time[0])
    shown = (time >= start) & (time < start + _CLOSE_UP)
    with style(dark):
        figure = Figure(figsize=(9, 2.6), layout='constrained')
        axis = figure.subplots()
        level = decibels(take.sound.energy[shown]) + analysis.shift
        axis.plot(time[shown] - start, level, color=COLOURS[dark][0], lw=1.0)
        for landing in landings[(landings >= start) & (landings < start + _CLOSE_UP)]:
            axis.axvline(landing - start, color=COLOURS[dark][1], lw=1.0)
        axis.set_xlabel(f'time [s], from {start:.1f} s of the recording')
        axis.set_ylabel(f'5 ms level [{analysis.unit}]')
    return figure


def _curve(axis: Axes, analysis: Analysis, name: str, line: dict[str, Any]) -> None:
    """Draw the first take's evaluated part at 20 Hz: its level, and its mean over one second."""
    takes = analysis.of(name)
    sound, rows = takes[0].sound, np.flatnonzero(takes[0].counted)
    span = slice(rows[0], rows[-1] + 1, max(1, round(1.0 / (_POINTS * sound.step))))
    width = min(max(1, round(1.0 / sound.step)), len(sound.energy))
    mean = np.convolve(sound.energy, np.ones(width) / width, mode='same')
    time = sound.time[span] - sound.time[rows[0]]
    shown = time <= _SHOWN
    level, smooth = (decibels(v[span][shown]) + analysis.shift for v in (sound.detector, mean))
    axis.plot(time[shown], level, lw=0.8, alpha=0.45, **{**line, 'ls': '-'})
    found = analysis.levels(takes)
    label = f'{name}: Leq {found.leq:.1f}, L10 {found.l10:.1f}, L90 {found.l90:.1f}'
    axis.plot(time[shown], smooth, lw=2.2, label=label, **line)


def _spectrum_axis(axis: Axes, analysis: Analysis, ink: str) -> None:
    bands = max((list(analysis.bands(name)) for name in analysis.policies), key=len)
    ticks = [i for i, band in enumerate(bands) if i % 3 == 0]
    labels = [f'{b / 1e3:g}k' if b >= 1e3 else f'{b:g}' for b in (bands[i] for i in ticks)]
    axis.set_xticks(ticks, labels)
    axis.set_xlabel('third-octave band [Hz]')
    letter = analysis.settings.weighting
    axis.set_ylabel(f'level [{analysis.unit.replace(f"({letter})", "")}]')
    axis.set_title('Spectrum, unweighted', loc='left', fontsize=11)
    axis.legend(loc='lower center', frameon=False, fontsize=8, ncols=4, labelcolor=ink)


def write_sound_report(path: Path, analysis: Analysis) -> None:
    """Write an HTML page with differences, levels over time, spectra, alignment and warnings."""
    settings = analysis.settings
    page = Page('Sound levels by policy')
    page.add('<h1>Sound levels by policy</h1>')
    for sentence in sentences(analysis):
        page.text(sentence)
    tone = analysis.tone
    page.facts(
        {
            'Levels': f'{analysis.unit}, {settings.time} time weighting',
            'Calibration': 'none: levels are relative to full scale (a sine at full scale is 0)'
            if tone is None
            else f'{tone.level:g} dB SPL at {tone.frequency:.0f} Hz, steady to '
            f'{tone.spread:.2f} dB for {tone.seconds:g} s',
        }
    )
    page.heading('Level over time, and third-octave spectrum')
    words = 'level over time and third-octave spectrum by policy'
    page.add(embedded(partial(draw_sound, analysis), words))
    page.heading('Levels')
    page.table(LEVEL_COLUMNS, level_rows(analysis), numbers=range(1, 8))
    page.text(
        f'In {analysis.unit}. Leq is the mean by energy; L10, L50 and L90 are exceeded for 10, 50 '
        'and 90 % of the time.',
        faint=True,
    )
    louder = analysis.differences()
    if louder:
        page.heading('Difference from ' + analysis.policies[0])
        page.table(
            ('policy', 'figure', 'dB louder', '95 % interval', 'block s'),
            [
                (
                    *(name, key.title(), f'{d.value:+.2f}'),
                    f'{d.interval[0]:+.2f} … {d.interval[1]:+.2f}',
                    'by files' if block is None else f'{block:.2f}',
                )
                for name, (figures, block) in louder.items()
                for key, d in figures.items()
            ],
            numbers=(2, 3, 4),
        )
        page.text(
            "With at least two files of both policies, intervals are Welch's t on the files' mean "
            'levels. With a single file, they are those of a block bootstrap whose blocks are as '
            'long as the level correlates, and do not include differences between set-ups, such '
            'as the position of the microphone: record each policy several times.',
            faint=True,
        )
    _alignments(page, analysis)
    page.heading('Files')
    page.table(
        ('file', 'policy', 'rate Hz', 's', 'evaluated', 'remarks'),
        [
            (
                *(take.path.name, take.policy, f'{take.sound.rate:.0f}'),
                *(f'{take.sound.seconds:.1f}', take.why, '; '.join(take.warnings) or 'none'),
            )
            for take in analysis.takes
        ],
        numbers=(2, 3),
    )
    for warning in analysis.warnings:
        page.text(warning)
    page.write(path)


def _alignments(page: Page, analysis: Analysis) -> None:
    found = [(take, take.alignment) for take in analysis.takes if take.alignment is not None]
    if not found:
        return
    page.heading('Alignment with recordings')
    page.table(
        ('file', 'recording', 'by', 'offset s', 'drift ppm', 'correlation', 'rival'),
        [
            (
                *(take.path.name, take.recording, own.method, f'{own.offset:+.3f}'),
                *(f'{own.drift:+.0f}', f'{own.correlation:.2f}', f'{own.rival:.2f}'),
            )
            for take, own in found
        ],
        numbers=(3, 4, 5, 6),
    )
    words = 'level, landings'
    tabs = {t.path.name: embedded(partial(draw_alignment, analysis, t), words) for t, _ in found}
    page.tabs(tabs)
    page.text('Three seconds; vertical lines are landings of a foot by foot_force.', faint=True)
