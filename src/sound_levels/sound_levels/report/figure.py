"""Figure of level over time by policy, after Figure 7 of the paper, with spectra."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from wattwalk_core.figures import OTHERS, save_figure, style

from sound_levels.levels.analysis import Analysis, Take
from sound_levels.levels.statistics import Levels, decibels

Floats = NDArray[np.float64]

COLOURS = ('#0072B2', *OTHERS)
DASHES = ('-', (0, (5, 1.5)), (0, (1.5, 1)), '-.')
_SHOWN = 30.0  # s
_POINTS = 20.0  # Hz


def draw_sound(path: Path, analysis: Analysis) -> None:
    """Draw the level of each policy over time and third-octave spectra (PNG, SVG, PDF)."""
    with style(False):
        figure = Figure(figsize=(9, 6.4), layout='constrained')
        above, below = figure.subplots(2, 1, height_ratios=(3, 2))
        for index, name in enumerate(analysis.policies):
            colour = COLOURS[index % len(COLOURS)]
            found = analysis.levels(name)
            _curve(above, analysis, analysis.of(name)[0], index, found)
            bands = analysis.bands(name)
            if bands:
                below.plot(
                    np.arange(len(bands)),
                    list(bands.values()),
                    color=colour,
                    ls=DASHES[index % len(DASHES)],
                    marker='os^D'[index % 4],
                    ms=3,
                    label=name,
                )
        settings = analysis.settings
        above.set_xlabel(f'time since {_since(analysis)} [s]')
        above.set_ylabel(f'{settings.time} level [{analysis.unit}]')
        above.set_title(
            f'Sound level over time: {settings.time} (thin), mean of a second (thick)',
            loc='left',
            fontsize=11,
        )
        low, high = above.get_ylim()
        above.set_ylim(low, high + 0.2 * (high - low))
        above.legend(loc='upper right', ncols=2, frameon=False, fontsize=8)
        _spectrum_axis(below, analysis)
        save_figure(figure, path)


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


def _curve(axis: Axes, analysis: Analysis, take: Take, index: int, found: Levels) -> None:
    time, level, mean = curve(analysis, take)
    shown = time <= _SHOWN
    colour = COLOURS[index % len(COLOURS)]
    axis.plot(time[shown], level[shown], color=colour, lw=0.8, alpha=0.45)
    axis.plot(
        time[shown],
        mean[shown],
        color=colour,
        ls=DASHES[index % len(DASHES)],
        lw=2.2,
        label=f'{take.policy}: Leq {found.leq:.1f}, L10 {found.l10:.1f}, L90 {found.l90:.1f}',
    )


def _since(analysis: Analysis) -> str:
    aligned = all(take.alignment is not None for take in analysis.takes)
    return 'the first landing of a foot' if aligned else 'the start of the evaluated part'


def _spectrum_axis(axis: Axes, analysis: Analysis) -> None:
    bands = max((list(analysis.bands(name)) for name in analysis.policies), key=len)
    ticks = [i for i, band in enumerate(bands) if i % 3 == 0]
    axis.set_xticks(ticks, [_hertz(bands[i]) for i in ticks])
    axis.set_xlabel('third-octave band [Hz]')
    letter = analysis.settings.weighting
    axis.set_ylabel(f'level [{analysis.unit.replace(f"({letter})", "")}]')
    axis.set_title('Spectrum, unweighted', loc='left', fontsize=11)
    axis.legend(loc='lower center', frameon=False, fontsize=8, ncols=4)


def _hertz(frequency: float) -> str:
    return f'{frequency / 1e3:g}k' if frequency >= 1e3 else f'{frequency:g}'
