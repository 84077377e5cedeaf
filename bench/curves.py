"""
Draws training curves: velocity error, falls and predicted power over policy steps.

Runs of one name are seeds: a line each, in one colour. A+B is a run B that went on from A.

    python bench/curves.py baseline=runs/first+runs/baseline pmp=runs/first+runs/pmp -o curves.png
"""

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from policy_training.config import TrainingConfig
from policy_training.learning.run_folder import read_curves
from wattwalk_core.figures import OTHERS

PANELS = (
    ('error/velocity', 'off by, m/s', 1.0),
    ('falls', 'falls per robot and minute', 60.0 / TrainingConfig().step_time),
    ('power/watts', 'predicted power, W', 1.0),
)
COLORS = ('#0072b2', *OTHERS)
SMOOTH = 12  # rounds


def smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Moving mean, shorter by what it takes."""
    return np.convolve(values, np.full(SMOOTH, 1.0 / SMOOTH), 'valid')


def draw(
    ax: plt.Axes, runs: list[Path], key: str, factor: float, color: str, label: str | None
) -> None:
    """Runs that went on from each other, as one line."""
    before, named = 0.0, False
    for run in runs:
        rows = read_curves(run)
        if not rows:
            sys.exit(f'curves: {run} holds no curves')
        steps = before + np.array([row['steps'] for row in rows]) / 1e6
        values = factor * np.array([row.get(key, np.nan) for row in rows], np.float64)
        if len(rows) >= SMOOTH and np.isfinite(values).any():
            shown = None if named else label
            ax.plot(smoothed(steps), smoothed(values), color=color, lw=1.2, label=shown)
            named = True
        before = steps[-1]


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('runs', nargs='+', metavar='NAME=RUN[+RUN]')
    parser.add_argument('-o', '--output', type=Path, required=True, help='PNG')
    options = parser.parse_args()
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.3), dpi=110)
    colors: dict[str, str] = {}
    for text in options.runs:
        name, equals, folders = text.partition('=')
        if not equals:
            sys.exit(f'curves: {text!r} is not NAME=RUN')
        first = name not in colors
        color = colors.setdefault(name, COLORS[len(colors) % len(COLORS)])
        runs = [Path(folder) for folder in folders.split('+')]
        for ax, (key, _, factor) in zip(axes, PANELS, strict=True):
            draw(ax, runs, key, factor, color, name if first else None)
    for ax, (key, title, _) in zip(axes, PANELS, strict=True):
        ax.set_title(title, loc='left', fontsize=9)
        ax.set_xlabel('policy steps, millions', fontsize=8)
        ax.tick_params(labelsize=8)
        ax.grid(alpha=0.3)
        if key != 'power/watts':
            ax.set_ylim(bottom=0.0)
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(options.output)
    return 0


if __name__ == '__main__':
    sys.exit(main())
