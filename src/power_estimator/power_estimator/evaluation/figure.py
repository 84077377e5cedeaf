"""Figures of measured and estimated power, after Figures 3 and 4 of the paper."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from wattwalk_core.figures import BLUE, OTHERS, save_figure, style

from power_estimator.evaluation.traces import Traces

LABELS = {
    'ppn': 'PPN',
    'torque_squared': 'torque²',
    'torque_abs': '|torque|',
    'mechanical_power': '|mechanical power|',
    'mechanical_power_positive': 'positive mechanical power',
    'acceleration_squared': 'acceleration²',
    'plain': 'shaft + copper\nloss + idle',
}


def draw_traces(path: Path, traces: Traces, *, dark: bool = False) -> None:
    """Draw proxies, network and, where it was measured, the whole robot into a picture at path."""
    with style(dark) as ink:
        blue = BLUE[dark]
        whole = traces.supply
        figure = Figure(figsize=(9, 8 if whole else 5.6), layout='constrained')
        axes = figure.subplots(3 if whole else 2, 1, sharex=True)
        time = traces.time - traces.time[0]
        top, middle = axes[0], axes[1]
        for colour, (name, values) in zip(OTHERS, traces.proxies.items(), strict=False):
            top.plot(
                time, values, color=colour, lw=1.3, label=f'{LABELS.get(name, name)} (scaled)'
            )
        top.plot(time, traces.measured, color=ink, lw=1.8, label='measured')
        _panel(top, f'{traces.drive}: signals used in place of power')
        middle.plot(time, traces.measured, color=ink, lw=1.8, label='measured')
        middle.plot(time, traces.estimated, color=blue, lw=1.8, ls=(0, (4, 1)), label='PPN')
        _panel(middle, f'{traces.drive}: Power Prediction Network, R² = {traces.r2:.3f}')
        if whole:
            bottom = axes[2]
            bottom.plot(time, whole.measured, color=ink, lw=1.8, label='measured at the supply')
            label = f'sum of {whole.drives} PPN + {whole.electronics:.0f} W electronics'
            bottom.plot(time, whole.estimated, color=blue, lw=1.8, ls=(0, (4, 1)), label=label)
            _panel(bottom, f'whole robot, R² = {whole.score.r2:.3f}')
        axes[-1].set_xlabel('time [s]')
        axes[-1].set_xlim(0, float(time[-1]))
        save_figure(figure, path)


def draw_bars(
    path: Path, table: Mapping[str, Any], *, title: str = '', dark: bool = False
) -> None:
    """Draw R² of each model of a `table` by drive type, with its spread, as in Fig. 4."""
    models = table['models']
    types = list(dict.fromkeys(key for model in models for key in model['types']))
    with style(dark) as ink:
        blue = BLUE[dark]
        figure = Figure(figsize=(max(9, 1.5 * len(models)), 4.4), layout='constrained')
        axis = figure.subplots()
        width = 0.8 / max(1, len(types))
        lowest = 0.0
        for index, kind in enumerate(types):
            scores = [model['types'].get(kind) or {} for model in models]
            r2 = np.array([np.nan if s.get('r2') is None else s['r2'] for s in scores], float)
            spread = np.array([s.get('r2_std') or 0.0 for s in scores])
            lowest = min(lowest, float(np.nanmin(r2 - spread, initial=0.0)))
            x = np.arange(len(models)) + (index - (len(types) - 1) / 2) * width
            colour = (blue, *OTHERS)[index % (len(OTHERS) + 1)]
            bars = axis.bar(x, r2, width * 0.92, color=colour, label=kind)
            lines = np.where(spread > 0, spread, np.nan)
            axis.errorbar(x, r2, lines, fmt='none', ecolor=ink, elinewidth=1, capsize=2)
            for bar, value, std in zip(bars, r2, spread, strict=True):
                if np.isfinite(value):
                    place = (bar.get_x() + bar.get_width() / 2, max(value + std, 0) + 0.02)
                    text = f'{value:.3f}' if 0.99 < value < 1 else f'{value:.2f}'
                    axis.annotate(text, place, ha='center', va='bottom', fontsize=6, color=ink)
        axis.axhline(0, color=ink, lw=0.8)
        labels = [LABELS.get(model['name'], model['name']) for model in models]
        broken = [re.sub(r'(positive|mechanical) ', r'\1\n', label) for label in labels]
        axis.set_xticks(np.arange(len(models)), broken)
        axis.set_ylim(max(lowest * 1.1, -1.5), 1.12)
        axis.set_ylabel('R² on held-out data')
        axis.legend(ncols=len(types), loc='lower right', bbox_to_anchor=(1, 1), frameon=False)
        axis.set_title(title, loc='left', fontsize=10)
        save_figure(figure, path)


def _panel(axis: Axes, title: str) -> None:
    axis.set_title(title, loc='left', fontsize=11)
    axis.set_ylabel('power [W]')
    axis.legend(loc='upper right', ncols=4, frameon=False, fontsize=8)
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + 0.18 * (high - low))
