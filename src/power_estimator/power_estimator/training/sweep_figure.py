"""Figure of a sweep: R² and cost over hidden units and over history."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from wattwalk_core.figures import OTHERS, save_figure, style

from power_estimator.training.sweep import CHOSEN, Result


def draw_sweep(path: Path, results: Sequence[Result], *, dark: bool = False) -> None:
    """Draw R² above and µs per sample below, over units at left and history at right."""
    carried = sorted((r for r in results if r.point.history is None), key=lambda r: r.point.hidden)
    windows = sorted(
        (r for r in results if r.point.history is not None), key=lambda r: r.point.history or 0
    )
    units = [float(r.point.hidden) for r in carried]
    seconds = [(r.point.history or 0) / CHOSEN.rate for r in windows]
    with style(dark) as ink:
        figure = Figure(figsize=(9, 6), layout='constrained')
        axes = figure.subplots(2, 2, sharex='col', sharey='row', height_ratios=(3, 1.2))
        whole = next((r for r in carried if r.point.hidden == CHOSEN.hidden), None)
        for column, (x, found) in enumerate(((units, carried), (seconds, windows))):
            _scores(axes[0, column], x, found, whole if column else None)
            cost = [r.us_per_sample for r in found]
            axes[1, column].plot(x, cost, 'o-', color=ink, ms=4)
            axes[1, column].set_yscale('log')
            axes[1, column].set_xscale('log')
            axes[1, column].set_xticks(x, [f'{v:g}' for v in x])
            axes[1, column].minorticks_off()
        for row in range(2):
            axes[row, 0].axvline(CHOSEN.hidden, color=ink, lw=0.8, ls=(0, (4, 3)))
            axes[row, 1].axvline(CHOSEN.history / CHOSEN.rate, color=ink, lw=0.8, ls=(0, (4, 3)))
        axes[0, 0].set_title('carried state', loc='left', fontsize=11)
        axes[0, 1].set_title(f'windows of history, {CHOSEN.hidden} units', loc='left', fontsize=11)
        axes[1, 0].set_xlabel('hidden units')
        axes[1, 1].set_xlabel('history [s]')
        axes[0, 0].set_ylabel('R² on held-out data')
        axes[1, 0].set_ylabel('µs per sample\nof 12 drives')
        axes[0, 0].legend(loc='lower right', frameon=False)
        save_figure(figure, path)


def _scores(axis: Axes, x: Sequence[float], found: Sequence[Result], line: Result | None) -> None:
    kinds = list(dict.fromkeys(kind for result in found for kind in result.r2))
    lowest = 1.0
    for colour, kind in zip(OTHERS * (1 + len(kinds) // len(OTHERS)), kinds, strict=False):
        mean = np.array([r.r2.get(kind, (np.nan, 0))[0] for r in found])
        spread = np.array([r.r2.get(kind, (np.nan, 0))[1] for r in found])
        axis.errorbar(
            x,
            mean,
            np.where(spread > 0, spread, np.nan),
            fmt='o-',
            ms=4,
            capsize=2,
            color=colour,
            label=kind,
        )
        if line is not None and kind in line.r2:
            axis.axhline(line.r2[kind][0], color=colour, lw=1, ls=':')
        lowest = min(lowest, float(np.nanmin(mean - spread)))
    low, high = axis.get_ylim()
    axis.set_ylim(max(min(low, lowest), 0.0), max(high, 1.0))
