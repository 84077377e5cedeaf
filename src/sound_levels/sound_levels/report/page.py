"""Report of a sound analysis as one page that needs no network."""

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from wattwalk_core.pages.page import Page
from wattwalk_core.pages.plot_style import COLORS, Figure, finished, short

from sound_levels.levels.analysis import Analysis, Take
from sound_levels.levels.summary import LEVEL_COLUMNS, level_cells, sentences
from sound_levels.report.figure import curve

_LINES = (COLORS['better'], COLORS['base'], COLORS['third'], COLORS['faint'])
_DASHES = ('solid', 'dash', 'dot', 'dashdot')
_CLOSE_UP = 3.0  # s shown of an alignment


def write_sound_report(path: Path, analysis: Analysis) -> None:
    """Write differences, levels over time, spectra, alignment and warnings."""
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
    page.heading('Level over time')
    page.add(page.figure(_over_time(analysis), 'level over time by policy', size='tall'))
    page.text(f'Thin: {settings.time} time weighting; thick: mean over one second.', faint=True)
    page.heading('Levels')
    rows = []
    for name in analysis.policies:
        found = analysis.levels(name)
        rows.append((name, f'{found.seconds:.0f}', *level_cells(found)))
    page.table(('policy', 'counted s', *LEVEL_COLUMNS), rows, numbers=range(1, 7))
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
                    *(name, key.title(), f'{d.value:+.2f}', _span(d.interval)),
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
    page.heading('Third-octave spectrum')
    page.add(page.figure(_spectra(analysis), 'third-octave spectrum by policy'))
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
    takes = [take for take in analysis.takes if take.alignment is not None]
    if not takes:
        return
    page.heading('Alignment with recordings')
    page.table(
        ('file', 'recording', 'by', 'offset s', 'drift ppm', 'correlation', 'rival'),
        [
            (
                *(take.path.name, take.recording, take.alignment.method),
                *(f'{take.alignment.offset:+.3f}', f'{take.alignment.drift:+.0f}'),
                *(f'{take.alignment.correlation:.2f}', f'{take.alignment.rival:.2f}'),
            )
            for take in takes
            if take.alignment is not None
        ],
        numbers=(3, 4, 5, 6),
    )
    panels = {
        take.path.name: page.figure(_close_up(analysis, take), 'level and landings', size='low')
        for take in takes
    }
    page.tabs(panels)
    page.text('Three seconds; vertical lines are landings of a foot by foot_force.', faint=True)


def _over_time(analysis: Analysis) -> Figure:
    figure = go.Figure()
    for index, name in enumerate(analysis.policies):
        for number, take in enumerate(analysis.of(name)):
            time, level, mean = curve(analysis, take)
            colour = _LINES[index % len(_LINES)]
            thin = {'color': colour, 'width': 0.7}
            thick = {'color': colour, 'width': 2.4, 'dash': _DASHES[index % len(_DASHES)]}
            for values, line, label in ((level, thin, ''), (mean, thick, name)):
                figure.add_trace(
                    go.Scatter(
                        x=short(time),
                        y=short(values),
                        name=label or f'{name}, {analysis.settings.time}',
                        showlegend=number == 0 and bool(label),
                        legendgroup=name,
                        mode='lines',
                        opacity=1.0 if label else 0.5,
                        line=line,
                    )
                )
    figure.update_xaxes(title_text='time in s')
    figure.update_yaxes(title_text=f'level in {analysis.unit}')
    return finished(figure, legend=True)


def _spectra(analysis: Analysis) -> Figure:
    figure = go.Figure()
    for index, name in enumerate(analysis.policies):
        bands = analysis.bands(name)
        figure.add_trace(
            go.Scatter(
                x=[f'{band:g}' for band in bands],
                y=short(np.array(list(bands.values()))),
                name=name,
                mode='lines+markers',
                line={
                    'color': _LINES[index % len(_LINES)],
                    'dash': _DASHES[index % len(_DASHES)],
                },
            )
        )
    letter = analysis.settings.weighting
    figure.update_xaxes(title_text='band in Hz', type='category')
    figure.update_yaxes(title_text=f'level in {analysis.unit.replace(f"({letter})", "")}')
    return finished(figure, legend=True)


def _close_up(analysis: Analysis, take: Take) -> Figure:
    alignment, events = take.alignment, take.events
    if alignment is None or events is None:
        raise ValueError('a take without alignment')
    time = alignment.of(take.sound.time)
    landings = events.landings[(events.landings > time[0]) & (events.landings < time[-1])]
    start = float(landings[len(landings) // 2]) - 0.1 if len(landings) else float(time[0])
    shown = (time >= start) & (time < start + _CLOSE_UP)
    figure = go.Figure(
        go.Scatter(
            x=short(time[shown] - start),
            y=short(10.0 * np.log10(take.sound.energy[shown] + 1e-30) + analysis.shift),
            mode='lines',
            line={'color': COLORS['better'], 'width': 1.2},
        )
    )
    for landing in landings[(landings >= start) & (landings < start + _CLOSE_UP)].tolist():
        figure.add_vline(x=landing - start, line={'color': COLORS['base'], 'width': 1.2})
    figure.update_xaxes(title_text=f'time in s, from {start:.1f} s of the recording')
    figure.update_yaxes(title_text=f'5 ms level in {analysis.unit}')
    return finished(figure)


def _span(interval: tuple[float, float]) -> str:
    return f'{interval[0]:+.2f} … {interval[1]:+.2f}'
