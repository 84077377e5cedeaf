"""Figures of levels over time, after Figure 7 of the paper, of spectra and of alignments."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from wattwalk_core.figures import OTHERS, style

from sound_levels.levels.analysis import Analysis, Take
from sound_levels.levels.statistics import decibels

Floats = NDArray[np.float64]

COLOURS = {False: ('#0072B2', *OTHERS), True: ('#56B4E9', *OTHERS)}
DASHES = ('-', (0, (5, 1.5)), (0, (1.5, 1)), '-.')
_SHOWN = 30.0  # s
_CLOSE_UP = 3.0  # s shown of an alignment
_POINTS = 20.0  # Hz


def draw_sound(analysis: Analysis, *, dark: bool = False) -> Figure:
    """Draw the level of each policy over time, and third-octave spectra."""
    with style(dark) as ink:
        figure = Figure(figsize=(9, 6.4), layout='constrained')
        above, below = figure.subplots(2, 1, height_ratios=(3, 2))
        for index, name in enumerate(analysis.policies):
            line = {'color': COLOURS[dark][index % len(COLOURS[dark])]}
            dashes = DASHES[index % len(DASHES)]
            _curve(above, analysis, name, {**line, 'ls': dashes})
            bands = analysis.bands(name)
            if bands:
                places, mark = np.arange(len(bands)), 'os^D'[index % 4]
                levels = list(bands.values())
                below.plot(places, levels, ls=dashes, marker=mark, ms=3, label=name, **line)
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


def draw_alignment(analysis: Analysis, take: Take, *, dark: bool = False) -> Figure:
    """Draw three seconds of the level in the recording's time, with landings as lines."""
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


def curve(analysis: Analysis, take: Take) -> tuple[Floats, Floats, Floats]:
    """
    Return the level over time of the evaluated part of a take, at 20 Hz.

    Time in s since its start, the level with the time weighting, and the mean over one second.
    """
    every = max(1, round(1.0 / (_POINTS * take.sound.step)))
    rows = np.flatnonzero(take.counted)
    span = slice(rows[0], rows[-1] + 1, every)
    time = take.sound.time[span]
    mean = decibels(take.mean_level[span]) + analysis.shift
    return time - time[0], analysis.trace(take)[span], mean


def _curve(axis: Axes, analysis: Analysis, name: str, line: dict[str, Any]) -> None:
    take, found = analysis.of(name)[0], analysis.levels(name)
    time, level, mean = curve(analysis, take)
    shown = time <= _SHOWN
    axis.plot(time[shown], level[shown], lw=0.8, alpha=0.45, **{**line, 'ls': '-'})
    label = f'{take.policy}: Leq {found.leq:.1f}, L10 {found.l10:.1f}, L90 {found.l90:.1f}'
    axis.plot(time[shown], mean[shown], lw=2.2, label=label, **line)


def _spectrum_axis(axis: Axes, analysis: Analysis, ink: str) -> None:
    bands = max((list(analysis.bands(name)) for name in analysis.policies), key=len)
    ticks = [i for i, band in enumerate(bands) if i % 3 == 0]
    axis.set_xticks(ticks, [_hertz(bands[i]) for i in ticks])
    axis.set_xlabel('third-octave band [Hz]')
    letter = analysis.settings.weighting
    axis.set_ylabel(f'level [{analysis.unit.replace(f"({letter})", "")}]')
    axis.set_title('Spectrum, unweighted', loc='left', fontsize=11)
    axis.legend(loc='lower center', frameon=False, fontsize=8, ncols=4, labelcolor=ink)


def _hertz(frequency: float) -> str:
    return f'{frequency / 1e3:g}k' if frequency >= 1e3 else f'{frequency:g}'
