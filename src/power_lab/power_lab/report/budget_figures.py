"""Pictures of an energy budget: bars, flows, efficiency over torque and speed, gait cycle."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline
from numpy.typing import NDArray
from power_estimator.effects.signals.prepared import WHOLE
from power_estimator.effects.signals.reducer import REDUCED_RATE
from wattwalk_core.arrays import Floats
from wattwalk_core.figures import save_figure, style

from power_lab.budget.account import Account
from power_lab.budget.budget import Budget
from power_lab.budget.families import FAMILIES, family_of

_METERED: Final = '#4D4D4D'
_BINS: Final = 24  # of a gait cycle: strides of half a second have 25 rows
_CYCLES: Final = (0.2, 3.0)  # s, that a stride lasts
_LEAST_CYCLES: Final = 5
_GRID: Final = 60
_STATES: Final = 1500  # visited states that are drawn


def drawn(budget: Budget) -> Iterator[tuple[str, str, Figure]]:
    """Name, caption and figure of each picture that the recordings allow, within a plot style."""
    yield 'flow', 'From the supply to where the power ends, W', flow(budget.account)
    yield 'bars', 'Mean power by drive, W; the mark is what was metered', bars(budget.account)
    for name, figure in efficiency_maps(budget).items():
        caption = f'Efficiency of {name} by its model, and states visited'
        yield f'efficiency_{name}', caption, figure
    gait = gait_cycle(budget)
    if gait is not None:
        caption = 'Power of one leg from touch-down to touch-down, mean over legs and strides, W'
        yield 'gait', caption, gait


def write_figures(folder: Path, budget: Budget) -> None:
    """Write all pictures into a folder, as svg and png."""
    folder.mkdir(parents=True, exist_ok=True)
    with style(dark=False):
        for name, _, figure in drawn(budget):
            for suffix in ('.svg', '.png'):
                save_figure(figure, folder / f'{name}{suffix}')


def bars(account: Account) -> Figure:
    """Stacked bars of each drive or type of drives: losses to the right, what came back left."""
    members = [name for name in account.tallies if name != WHOLE] or [account.first]
    if WHOLE in account.tallies and len(members) > 4:
        members = [n for n in members if account.tallies[n].drives > 1] or members
    figure = Figure(figsize=(9, 1.6 + 0.5 * len(members)), layout='constrained')
    axes = figure.subplots()
    ends = {-1.0: np.zeros(len(members)), 1.0: np.zeros(len(members))}
    watts = [_by_family(account, member) for member in members]
    for family in FAMILIES:
        own = np.array([values.get(family, 0.0) for values in watts])
        for sign, left in ends.items():
            part = np.where(np.sign(own) == sign, own, 0.0)
            if np.abs(part).max() > 1e-3:
                _bar(axes, family, members, part, left)
                left += part
    for place, member in enumerate(members):
        mean = float(account.tallies[member].means[0, 0, -1])
        axes.plot([mean, mean], [place - 0.42, place + 0.42], color='black', lw=2.2, zorder=3)
    axes.axvline(0.0, color='black', lw=0.8)
    axes.set_yticks(range(len(members)), members)
    axes.invert_yaxis()
    axes.grid(visible=False, axis='y')
    axes.set_xlabel('mean power [W]')
    _legend(figure)
    return figure


def flow(account: Account) -> Figure:
    """Flows from the supply, and from braking joints, to where the power ends."""
    watts = _by_family(account, account.first)
    metered, _ = account.power()
    sources = {'metered': metered}
    sources |= {name: -value for name, value in watts.items() if value < 0.0}
    sinks = {name: value for name, value in watts.items() if value > 0.0}
    total = max(sum(sinks.values()), 1e-9)
    figure = Figure(figsize=(9, 5.2), layout='constrained')
    axes = figure.subplots()
    axes.axis('off')
    trunk, gap = 1.0, 0.03 * total
    for side, flows in ((-1.0, sources), (1.0, sinks)):
        level, at = 0.0, -0.5 * gap * (len(flows) - 1)
        for name, value in flows.items():
            words, colour, _ = FAMILIES.get(name, ('metered at the supply', _METERED, ()))
            far = side * 3.0
            _ribbon(axes, (side * trunk * 0.25, level), (far, at), value, colour)
            share = f'{value:.1f} W' + (
                f', {100.0 * value / metered:.0f} %' if metered > 0 else ''
            )
            _label(axes, far + 0.06 * side, at + 0.5 * value, side, f'{words}\n{share}')
            level, at = level + value, at + value + gap
    axes.add_patch(Rectangle((-0.25, 0.0), 0.5, total, color=_METERED, alpha=0.85, lw=0))
    axes.set_xlim(-5.2, 5.2)
    axes.set_ylim(total + 0.6 * gap * len(sinks), -0.6 * gap * len(sinks))
    return figure


def efficiency_maps(budget: Budget) -> dict[str, Figure]:
    """Efficiency of each type of drives over torque and speed in steady motion."""
    found = {}
    for name, steady in budget.steady.items():
        drive = steady.drive
        state = budget.pictured.state
        torque, speed = state['torque'][:, drive], state['velocity'][:, drive]
        along = torque * np.sign(speed)
        limits = np.quantile(np.abs(speed), 0.998), np.quantile(along, [0.002, 0.998])
        x = np.linspace(0.0, float(limits[0]), _GRID + 1)[1:]
        y = np.linspace(float(limits[1][0]), float(limits[1][1]), _GRID)
        power = steady.power(*(values.ravel() for values in np.meshgrid(x, y)))
        shaft = (x[None] * y[:, None]).ravel()
        with np.errstate(divide='ignore', invalid='ignore'):
            ratio = np.where(shaft >= 0.0, shaft / power, power / shaft)
        values = 100.0 * np.clip(ratio, 0.0, 1.0).reshape(_GRID, _GRID)
        figure = Figure(figsize=(7, 4.2), layout='constrained')
        axes = figure.subplots()
        shown = axes.contourf(x, y, values, levels=np.arange(0, 101, 10), cmap='cividis')
        every = slice(None, None, max(1, len(along) // _STATES))
        axes.plot(np.abs(speed)[every], along[every], '.', ms=2.2, color='white', alpha=0.55)
        axes.axhline(0.0, color='white', lw=0.8)
        axes.set_xlim(float(x[0]), float(x[-1]))
        axes.set_ylim(float(y[0]), float(y[-1]))
        axes.set_xlabel('speed [rad/s]')
        axes.set_ylabel('torque along the motion [N·m]')
        axes.set_title(f'{name}: driving above 0, braking below; dots: visited', fontsize=10)
        axes.grid(visible=False)
        figure.colorbar(shown, ax=axes, label='efficiency [%]')
        found[name] = figure
    return found


def gait_cycle(budget: Budget) -> Figure | None:
    """Power of a leg over its cycle by family; None where no feet were recorded."""
    rows = budget.pictured
    if 'stance' not in rows.masks or rows.metered.shape[1] != len(rows.names):
        return None
    legs = {name.split('_')[0] for name in rows.names}
    sums: dict[str, Floats] = {}
    metered, duty = np.zeros(_BINS), []
    for drive in range(len(rows.names)):
        phase = _phases(rows.masks['stance'][:, drive], rows.stretches)
        known = np.isfinite(phase) & np.isfinite(rows.metered[:, drive])
        if phase[known].size < _LEAST_CYCLES * _BINS / 2:
            return None
        place = np.minimum((phase[known] * _BINS).astype(int), _BINS - 1)
        count = np.maximum(np.bincount(place, minlength=_BINS), 1) * len(legs)
        mean = np.bincount(place, rows.metered[known, drive], _BINS) / count
        metered += mean
        left = mean.copy()
        for part, values in zip(rows.parts, rows.power[known, drive].T, strict=True):
            own = np.bincount(place, values, _BINS) / count
            family = family_of(part)
            sums[family] = sums.get(family, np.zeros(_BINS)) + own
            left -= own
        sums['unexplained'] = sums.get('unexplained', np.zeros(_BINS)) + left
        duty.append(float(np.mean(rows.masks['stance'][known, drive])))
    figure = Figure(figsize=(9, 4.6), layout='constrained')
    axes = figure.subplots()
    x = (np.arange(_BINS) + 0.5) * 100.0 / _BINS
    ends = {-1.0: np.zeros(_BINS), 1.0: np.zeros(_BINS)}
    for family, (words, colour, _) in FAMILIES.items():
        if family in sums:
            label, looks = words, _looks(colour)
            for sign, begin in ends.items():
                band = np.where(np.sign(sums[family]) == sign, sums[family], 0.0)
                if np.abs(band).max() > 0.05:
                    axes.fill_between(
                        x, begin, begin + band, facecolor=colour, lw=0, label=label, **looks
                    )
                    label = '_nolegend_'
                    begin += band
    axes.plot(x, metered, color='black', lw=2.0, label='metered')
    stance = 100.0 * float(np.mean(duty))
    axes.axvspan(0.0, stance, ymax=0.03, color='#1a1a1a', lw=0)
    place = axes.get_xaxis_transform()
    axes.text(stance + 1.0, 0.005, 'foot on the ground until here', transform=place, fontsize=9)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel('gait cycle [%]')
    axes.set_ylabel('power of one leg [W]')
    _legend(figure)
    return figure


def _phases(stands: NDArray[np.bool_], stretches: Sequence[slice]) -> Floats:
    """Phase from touch-down to touch-down, 0 to 1 [N]; NaN outside whole strides."""
    phase = np.full(len(stands), np.nan)
    for part in stretches:
        landings = part.start + 1 + np.flatnonzero(stands[part][1:] & ~stands[part][:-1])
        for start, stop in pairwise(landings.tolist()):
            if _CYCLES[0] <= (stop - start) / REDUCED_RATE <= _CYCLES[1]:
                phase[start:stop] = np.arange(stop - start) / (stop - start)
    return phase


def _by_family(account: Account, member: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for share in account.shares(member):
        if share.effect != 'electronics' or member == WHOLE:
            family = family_of(share.effect)
            found[family] = found.get(family, 0.0) + share.mean_w
    return found


def _bar(axes: Axes, family: str, members: Sequence[str], part: Floats, left: Floats) -> None:
    words, colour, _ = FAMILIES[family]
    looks = _looks(colour)
    axes.barh(range(len(members)), part, left=left, height=0.7, color=colour, label=words, **looks)


def _looks(colour: str) -> dict[str, Any]:
    """Hatching of what has no colour."""
    return {'hatch': '////', 'edgecolor': '#808080'} if colour == 'none' else {}


def _legend(figure: Figure) -> None:
    handles, labels = figure.axes[0].get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(
        once.values(), once.keys(), loc='outside upper left', ncols=4, frameon=False, fontsize=9
    )


def _ribbon(
    axes: Axes, near: tuple[float, float], far: tuple[float, float], height: float, colour: str
) -> None:
    (x0, y0), (x1, y1) = near, far
    middle = 0.5 * (x0 + x1)
    points = [
        *((x0, y0), (middle, y0), (middle, y1), (x1, y1)),
        *((x1, y1 + height), (middle, y1 + height), (middle, y0 + height), (x0, y0 + height)),
        (x0, y0),
    ]
    curve = [Outline.CURVE4] * 3
    codes = [Outline.MOVETO, *curve, Outline.LINETO, *curve, Outline.CLOSEPOLY]
    looks = {'edgecolor': 'none', **_looks(colour)}
    axes.add_patch(PathPatch(Outline(points, codes), facecolor=colour, alpha=0.85, lw=0, **looks))


def _label(axes: Axes, x: float, y: float, side: float, text: str) -> None:
    axes.text(x, y, text, ha='left' if side > 0 else 'right', va='center', fontsize=9)
