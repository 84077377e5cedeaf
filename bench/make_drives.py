"""The library of identified drives, made again from the public logs (drive_logs.LOGS).

What is said of a drive is written by hand in its `drive.yaml`; numbers, findings, model and
picture are made here.

    python bench/make_drives.py [NAME…] [-o FOLDER]
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from drive_logs import imported
from matplotlib.figure import Figure
from power_estimator.effects.fit.design import Structure
from power_estimator.scores import score
from power_lab.compare.both_sides import both_sides
from power_lab.drives.library import FOLDER
from power_lab.session import Session
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError
from wattwalk_core.figures import OTHERS, save_figure, style
from wattwalk_core.files import write_whole
from wattwalk_core.yaml_file import dump_yaml, read_yaml

_SPEEDS = 5  # ranges of speed, of which the highest torque is kept
_MOST = 2000  # points of a picture
_LEVELS = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.92, 0.94, 0.96, 1.0)


@dataclass(frozen=True)
class Recipe:
    """Import and fit of a drive, whose `drive.yaml` names the logs."""

    map: str  # in log_maps
    effects: str
    sides: str = ''  # map with both sides of the gear
    behind_inverter: str = ''  # map with the power between inverter and motor
    how: tuple[tuple[str, Any], ...] = ()  # of reading


_WITH_FIELD = 'shaft copper_loss inverter_loss iron_loss field_weakening idle'
RECIPES: Mapping[str, Recipe] = {
    'hopper_leg_motor': Recipe(
        'hopper.yaml', 'shaft copper_loss idle', how=(('drives', ('MOTOR_0',)),)
    ),
    'mn8014_sspg_7': Recipe(
        'compact_motor.yaml', 'shaft copper_loss inverter_loss iron_loss idle', 'compact_sspg.yaml'
    ),
    'moteus_actuator': Recipe('moteus_dyno.yaml', 'shaft copper_loss idle', 'moteus_sensor.yaml'),
    'ev_pmsm_335v': Recipe('ev_motor.yaml', _WITH_FIELD, 'ev_motor.yaml', 'ev_ac.yaml'),
    't7056_propeller': Recipe(
        'thrust_t7056.yaml', 'shaft copper_loss iron_loss idle', how=(('slow', True),)
    ),
}


def make(name: str, folder: Path) -> Session:
    """Fit a drive of RECIPES, write its folder in `folder` and return the fitted session."""
    recipe = RECIPES[name]
    card: dict[str, Any] = read_yaml(FOLDER / name / 'drive.yaml', 'drive')
    with tempfile.TemporaryDirectory(prefix='wattwalk') as temporary:
        bags = imported(card['logs'], recipe.map, Path(temporary))
        lab = Session.open(*bags, **dict(recipe.how))
        lab = lab.fit(recipe.effects, name=name)
        beside = lab
        if recipe.sides not in ('', recipe.map):
            bags = imported(card['logs'], recipe.sides, Path(temporary))
            beside = Session.open(*bags, **dict(recipe.how))
        found = list(both_sides(beside.judge).values())
        findings = [line for one in found for line in one.lines()]
        if recipe.behind_inverter:
            (bag,) = imported(card['logs'], recipe.behind_inverter, Path(temporary))
            findings.append(of_inverter(lab, Session.open(bag)))
    own = folder / name
    own.mkdir(parents=True, exist_ok=True)
    lab.save(own / 'model.yaml')
    judged = lab.score.total or next(iter(lab.score.drives.values()))
    drag = found[0].drag if found else None
    card |= {
        'extent': lab.judge.prepared.extent,
        'r2': float(f'{judged.r2:.4g}'),
        'rmse_w': float(f'{judged.rmse_w:.4g}'),
        'torque_over_speed': envelope(lab),
        'findings': findings,
    }
    if drag is not None:
        card |= {'frictionloss': drag[0], 'damping': drag[1]}
    write_whole(own / 'drive.yaml', dump_yaml(card))
    save_figure(picture(lab, card['torque']), own / 'drive.png')
    return lab


def of_inverter(lab: Session, behind: Session) -> str:
    """Return a sentence on modelled and metered inverter loss; behind: metered at the motor."""
    data, model = lab.recordings.data, lab.effects
    own = tuple(one for one in model.structure.actives if one.name == 'inverter_loss')
    by_model = replace(model, structure=Structure(own)).predict(data)[:, 0]
    metered = data.power[:, 0] - behind.recordings.data.power[:, 0]
    found = score(metered, by_model, data.rate)
    return (
        f'inverter loss by the model, which saw the direct current alone, against the metered '
        f'{np.median(metered):.0f} W in the median: R² {found.r2:.2f}, bias {found.bias_w:.0f} W'
    )


def envelope(lab: Session) -> list[list[float]]:
    """Return [end of a range of speed, rad/s; 99th percentile of torque in it, N·m] rows."""
    signals = lab.judge.prepared.signals
    speed, torque = np.abs(signals.velocity).ravel(), np.abs(signals.torque).ravel()
    ends = np.linspace(0.0, np.quantile(speed, 0.99), _SPEEDS + 1)[1:]
    rows = []
    for low, high in zip([0.0, *ends[:-1]], ends, strict=True):
        own = torque[(low <= speed) & (speed <= high)]
        if own.size:
            rows.append([float(f'{high:.4g}'), float(f'{np.quantile(own, 0.99):.4g}')])
    return rows


def picture(lab: Session, side: str) -> Figure:
    """Draw held-out measured against modelled power, and efficiency; side: joint or motor."""
    prepared, judged = lab.judge.prepared, lab.score
    known = judged.rows.any(axis=1)
    measured = judged.measured[known]
    chosen = np.random.default_rng(0).permutation(len(measured))[:_MOST]
    with style(dark=False) as ink:
        figure = Figure(figsize=(9.0, 3.8), layout='constrained')
        left, right = figure.subplots(1, 2)
        for column, (name, colour) in enumerate(zip(prepared.names, (ink, *OTHERS), strict=False)):
            both = (
                values[known][chosen, column] for values in (judged.estimated, judged.measured)
            )
            left.plot(*both, '.', ms=3, alpha=0.4, color=colour, label=name)
        span = [float(np.nanmin(measured)), float(np.nanmax(measured))]
        left.plot(span, span, color=OTHERS[3], lw=1)
        left.set(xlabel='model, held out (W)', ylabel='measured (W)')
        left.legend(frameon=False)
        left.locator_params(nbins=6)
        _efficiency(right, lab, side)
        return figure


def _efficiency(axes: Any, lab: Session, side: str) -> None:
    """Share of the drawn power that arrives, by the model, with the points that were measured."""
    signals = lab.judge.prepared.signals
    torque, speed = np.abs(signals.torque[:, 0]), np.abs(signals.velocity[:, 0])
    x = np.linspace(0.0, np.quantile(speed, 0.995), 60)
    y = np.linspace(0.0, np.quantile(torque, 0.995), 60)
    seen = np.random.default_rng(0).permutation(len(torque))[:_MOST]
    axes.plot(speed[seen], torque[seen], 'k.', ms=2, alpha=0.4, label='measured')
    axes.set_xlim(0.0, max(1.0, 1.05 * float(np.quantile(speed, 0.995))))
    axes.set(xlabel='speed (rad/s)', ylabel=f'torque at the {side} (N·m)')
    if lab.judge.prepared.whole or np.quantile(speed, 0.99) < 1.0:
        return
    across, up = (grid.ravel() for grid in np.meshgrid(x, y))
    data = AlignedDataset.blank(
        400.0, signals.names[:1], np.arange(len(up)) / 400.0, 'map',
        torque=up[:, None], velocity=across[:, None], voltage=float(np.median(signals.voltage)),
    )  # fmt: skip
    data = replace(data, steady=True, segment=np.arange(len(up), dtype=np.int32))
    drawn = lab.effects.predict(data)[:, 0]
    share = np.where(drawn > 0.0, across * up / np.maximum(drawn, 1e-9), np.nan).reshape(60, 60)
    shown = axes.contourf(x, y, share, levels=_LEVELS, cmap='viridis', zorder=0)
    axes.figure.colorbar(shown, ax=axes, label='efficiency by the model')


def main() -> int:
    """Make the drives that are named, or all; those whose logs are absent are left as they are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', metavar='NAME', help=', '.join(RECIPES))
    parser.add_argument('-o', '--output', type=Path, default=FOLDER, help='folder of the library')
    options = parser.parse_args()
    for name in options.names or RECIPES:
        try:
            lab = make(name, options.output)
        except InputError as error:
            print(f'{name}: {error}', file=sys.stderr)
            continue
        print(name, {drive: round(score.r2, 4) for drive, score in lab.score.drives.items()})
    return 0


if __name__ == '__main__':
    sys.exit(main())
