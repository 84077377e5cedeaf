"""What the sounds say as one page that needs no network."""

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from wattwalk_core.pages.page import Page
from wattwalk_core.pages.plot_style import COLORS, Figure, finished, short

from sound_levels.levels.analysis import Analysis, Take, sentences
from sound_levels.report.figure import curve

_LINES = (COLORS['better'], COLORS['base'], COLORS['third'], COLORS['faint'])
_DASHES = ('solid', 'dash', 'dot', 'dashdot')
_CLOSE = 3.0  # s shown of an alignment


def write_report(path: Path, analysis: Analysis) -> None:
    """The page: who is louder, levels, curves, spectra, alignment, and what to be wary of."""
    settings = analysis.settings
    page = Page('How loud the policies are')
    page.add('<h1>How loud the policies are</h1>')
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
    page.text(
        f'Thin: {settings.time} time weighting; thick: mean over the second around.', faint=True
    )
    page.heading('Levels')
    columns = ('policy', 'counted s', 'Leq', 'L10', 'L50', 'L90', 'max')
    rows = []
    for name in analysis.policies:
        found = analysis.levels(name)
        figures = (found.leq, found.l10, found.l50, found.l90, found.max)
        rows.append((name, f'{found.seconds:.0f}', *(f'{value:.1f}' for value in figures)))
    page.table(columns, rows, numbers=range(1, 7))
    page.text(
        f'In {analysis.unit}. Leq is the mean by energy; L10, L50 and L90 are exceeded for 10, 50 '
        'and 90 % of the time.',
        faint=True,
    )
    found = analysis.differences()
    if found:
        page.heading('Difference from ' + analysis.policies[0])
        page.table(
            ('policy', 'figure', 'dB louder', '95 % interval', 'block s'),
            [
                (
                    *(name, key.title(), f'{d.value:+.2f}', _span(d.interval)),
                    'by files' if block is None else f'{block:.2f}',
                )
                for name, (figures, block) in found.items()
                for key, d in figures.items()
            ],
            numbers=(2, 3, 4),
        )
        page.text(
            "Intervals of two files and more on both sides are Welch's t on the mean level of "
            'files. With a single file they are a block bootstrap, with blocks as long as a level '
            'says something of what follows, and know nothing of what differs between set-ups, '
            'such as where the microphone stood: record each policy several times for that.',
            faint=True,
        )
    page.heading('Third-octave spectrum')
    page.add(page.figure(_spectra(analysis), 'third-octave spectrum by policy'))
    _alignments(page, analysis)
    page.heading('Files')
    page.table(
        ('file', 'policy', 'rate Hz', 's', 'what counts', 'remarks'),
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
    page.heading('Sound and recording on one time')
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
    page.text('Three seconds of it; vertical lines: a foot lands by foot_force.', faint=True)


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
    shown = (time >= start) & (time < start + _CLOSE)
    figure = go.Figure(
        go.Scatter(
            x=short(time[shown] - start),
            y=short(10.0 * np.log10(take.sound.energy[shown] + 1e-30) + analysis.shift),
            mode='lines',
            line={'color': COLORS['better'], 'width': 1.2},
        )
    )
    for landing in landings[(landings >= start) & (landings < start + _CLOSE)].tolist():
        figure.add_vline(x=landing - start, line={'color': COLORS['base'], 'width': 1.2})
    figure.update_xaxes(title_text=f'time in s, from {start:.1f} s of the recording')
    figure.update_yaxes(title_text=f'5 ms level in {analysis.unit}')
    return finished(figure)


def _span(interval: tuple[float, float]) -> str:
    return f'{interval[0]:+.2f} … {interval[1]:+.2f}'
