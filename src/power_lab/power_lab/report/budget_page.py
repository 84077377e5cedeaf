"""The page of a budget."""

import io
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline
from power_estimator.effects.signals.prepared import WHOLE
from wattwalk_core.arrays import Floats
from wattwalk_core.figures import save_figure, style
from wattwalk_core.pages.page import Page, escape

from power_lab.budget.account import Account
from power_lab.budget.budget import Budget
from power_lab.budget.efficiency_map import EfficiencyMap, efficiency_maps
from power_lab.budget.families import FAMILIES
from power_lab.budget.gait_cycle import GaitCyclePower
from power_lab.budget.tables import by_family, headline, in_words, share_cells, signed_w


def write_budget(path: Path, budget: Budget) -> None:
    """Write the HTML page of a budget."""
    account = budget.account
    sentence = headline(account, budget.levers)
    page = Page(f'Energy budget: {", ".join(one.name for one in budget.accounts)}')
    page.add('<p class="kind no_evidence">Energy budget</p>')
    page.add(f'<h1 id="verdict">{escape(sentence[0].upper() + sentence[1:])}.</h1>')
    facts = {
        'Recordings': ', '.join(one.name for one in budget.accounts),
        'Metered': f'{account.energy_wh:.3g} Wh',
        'Model': budget.origin,
    }
    if budget.battery:
        hours = account.runtime(budget.battery).get('all')
        if hours is not None:
            facts['Battery'] = f'{budget.battery:g} Wh last {hours["hours"]:.2f} h'
    page.facts(facts)
    page.text(
        'The parts add up to what was metered; what no effect of the model explains is a part of '
        'its own. Intervals are meant to hold nine of ten: they allow for how well the '
        'recording tells the coefficients, for departures from the formulas, and for what changes '
        'from second to second.',
        faint=True,
    )
    with style(dark=False):
        shown = {name: (caption, _svg(figure)) for name, caption, figure in drawn(budget)}
    maps = [one for name, one in shown.items() if name.startswith('efficiency')]
    for caption, markup in (one for one in shown.values() if one not in maps):
        page.heading(caption)
        page.add(_picture(caption, markup))
    if maps:
        page.heading('Efficiency over torque and speed')
        page.add(f'<div class="pair">{"".join(_picture(*one) for one in maps)}</div>')
    page.heading('Parts')
    members = dict.fromkeys((account.first, *account.tallies))
    page.tabs({member: _table(account, member) for member in members})
    if budget.levers:
        page.heading('What would change it')
        page.text('Change of the mean power at the same motion of the joints; negative saves.')
        signed = [(in_words(one.change), *signed_w(one)) for one in budget.levers]
        rows = [[change, f'{watts} W', interval] for change, watts, interval in signed]
        page.table(['change', 'mean power', '90 % interval'], rows, numbers=(1, 2))
        for reason in budget.refused:
            page.text(f'Not carried over: {reason}.', faint=True)
    if len(budget.accounts) > 1:
        page.heading(f'Against {budget.accounts[0].name}')
        rows = [
            [one.recording, in_words(one.effect), *signed_w(one)]
            for one in budget.differences
            if one.drive == account.first and one.phase == 'all'
        ]
        page.table(['recording', 'part', 'W', '90 % interval'], rows, numbers=(2, 3))
    page.write(path)


def _picture(caption: str, markup: str) -> str:
    return f'<div role="img" aria-label="{escape(caption)}">{markup}</div>'


def _svg(figure: Figure) -> str:
    """A figure as markup in the colours of the page."""
    FigureCanvasAgg(figure)
    stream = io.StringIO()
    figure.savefig(stream, format='svg', transparent=True)
    text = stream.getvalue()
    for ink in ('#1a1a1a', '#000000'):
        text = text.replace(ink, 'currentColor')
    start = text.index('<svg')
    width = text.index('viewBox', start)
    return f'<svg style="width:100%;height:auto" {text[width:]}'


def _table(account: Account, member: str) -> str:
    page = Page('')
    rows: list[list[str]] = []
    for phase in account.phases:
        for place, share in enumerate(account.shares(member, phase)):
            cells = *share_cells(share), f'{share.energy_wh:.3g}'
            rows.append(['' if place else phase, in_words(share.effect), *cells])
    columns = ['phase', 'part', 'mean W', '90 % interval', 'share', 'Wh']
    page.table(columns, rows, numbers=(2, 3, 4, 5))
    return ''.join(page.parts)


_METERED: Final = '#4D4D4D'
_GAP, _LABEL = 0.03, 0.09  # of the trunk: between flows; two lines of text


def drawn(budget: Budget) -> Iterator[tuple[str, str, Figure]]:
    """Yield name, caption and figure of each picture the recordings allow; call within `style`."""
    yield 'flow', 'From the supply to where the power ends, W', flow(budget.account)
    caption = 'Mean power of drives, or of all of a type, W; parts add up to the mark, as metered'
    yield 'bars', caption, bars(budget.account)
    for one in efficiency_maps(budget):
        caption = f'Efficiency of {one.name} by its model, and states visited'
        yield f'efficiency_{one.name}', caption, efficiency(one)
    cycle = GaitCyclePower.of(budget.pictured)
    if cycle is not None:
        caption = 'Power of one leg from touch-down to touch-down, mean over legs and strides, W'
        yield 'gait', caption, gait(cycle)


def write_figures(folder: Path, budget: Budget) -> None:
    """Write all pictures into a folder, as svg and png."""
    folder.mkdir(parents=True, exist_ok=True)
    with style(dark=False):
        for name, _, figure in drawn(budget):
            for suffix in ('.svg', '.png'):
                save_figure(figure, folder / f'{name}{suffix}')


def bars(account: Account) -> Figure:
    """Stacked bars of power by drive or drive type: losses to the right, returned power left."""
    members = [name for name in account.tallies if name != WHOLE] or [account.first]
    if WHOLE in account.tallies and len(members) > 4:
        members = account.groups
    figure = Figure(figsize=(9, 1.6 + 0.5 * len(members)), layout='constrained')
    axes = figure.subplots()
    watts = [by_family(account, member) for member in members]
    families = {key: np.array([own.get(key, 0.0) for own in watts]) for key in FAMILIES}
    for part, left, colour, looks in _stacked(families, least=1e-3):
        axes.barh(range(len(members)), part, left=left, height=0.7, color=colour, **looks)
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
    watts = by_family(account, account.first)
    metered, _ = account.power()
    sources = {'metered': metered}
    sources |= {name: -value for name, value in watts.items() if value < 0.0}
    sinks = {name: value for name, value in watts.items() if value > 0.0}
    total = max(sum(sinks.values()), 1e-9)
    figure = Figure(figsize=(9, 5.2), layout='constrained')
    axes = figure.subplots()
    axes.axis('off')
    trunk, ends = 1.0, [0.0, total]
    for side, flows in ((-1.0, sources), (1.0, sinks)):
        level, places = 0.0, fanned(list(flows.values()), total)
        for (name, value), at in zip(flows.items(), places, strict=True):
            words, colour, _ = FAMILIES.get(name, ('metered at the supply', _METERED, ()))
            far = side * 3.0
            _ribbon(axes, (side * trunk * 0.25, level), (far, at), value, colour)
            share = f', {100.0 * value / metered:.0f} %' if metered > 0 else ''
            text, place = f'{words}\n{value:.1f} W{share}', (far + 0.06 * side, at + 0.5 * value)
            aligned = 'left' if side > 0 else 'right'
            axes.text(*place, text, ha=aligned, va='center', fontsize=9)
            half = 0.5 * max(value, _LABEL * total)
            level, ends = level + value, [*ends, place[1] - half, place[1] + half]
    axes.add_patch(Rectangle((-0.25, 0.0), 0.5, total, color=_METERED, alpha=0.85, lw=0))
    axes.set_xlim(-5.2, 5.2)
    axes.set_ylim(max(ends) + 0.02 * total, min(ends) - 0.02 * total)
    return figure


def fanned(values: list[float], total: float) -> list[float]:
    """Return where flows begin that fan out from a trunk, their labels apart from each other."""
    at = [0.0]
    for value, after in itertools.pairwise(values):
        apart = max(value + _GAP * total, _LABEL * total + 0.5 * (value - after))
        at.append(at[-1] + apart)
    middle = 0.5 * (at[-1] + values[-1]) if values else 0.0
    return [each - middle + 0.5 * total for each in at]


def efficiency(found: EfficiencyMap) -> Figure:
    """Efficiency over torque and speed in steady motion, with the states visited."""
    figure = Figure(figsize=(7, 4.2), layout='constrained')
    axes = figure.subplots()
    x, y = found.speed, found.torque
    shown = axes.contourf(x, y, found.percent, levels=np.arange(0, 101, 10), cmap='cividis')
    axes.plot(*found.states.T, '.', ms=2.2, color='white', alpha=0.55)
    axes.axhline(0.0, color='white', lw=0.8)
    axes.set_xlim(float(x[0]), float(x[-1]))
    axes.set_ylim(float(y[0]), float(y[-1]))
    axes.set_xlabel('speed [rad/s]')
    axes.set_ylabel('torque along the motion [N·m]')
    axes.set_title(f'{found.name}: driving above 0, braking below; dots: visited', fontsize=10)
    axes.grid(visible=False)
    figure.colorbar(shown, ax=axes, label='efficiency [%]')
    return figure


def gait(cycle: GaitCyclePower) -> Figure:
    """Stacked power of one leg over its gait cycle, by family of effects."""
    figure = Figure(figsize=(9, 4.6), layout='constrained')
    axes = figure.subplots()
    for band, begin, colour, looks in _stacked(cycle.families, least=0.05):
        axes.fill_between(cycle.percent, begin, begin + band, facecolor=colour, lw=0, **looks)
    axes.plot(cycle.percent, cycle.metered, color='black', lw=2.0, label='metered')
    axes.axvspan(0.0, cycle.stance, ymax=0.03, color='#1a1a1a', lw=0)
    place = axes.get_xaxis_transform()
    text = 'foot on the ground until here'
    axes.text(cycle.stance + 1.0, 0.015, text, transform=place, fontsize=9)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel('gait cycle [%]')
    axes.set_ylabel('power of one leg [W]')
    _legend(figure)
    return figure


def _stacked(
    families: Mapping[str, Floats], least: float
) -> Iterator[tuple[Floats, Floats, str, dict[str, Any]]]:
    """Yield each family's power above 0 and below it, where it begins, its colour and looks.

    families: W [n]; least: W, parts that nowhere have more are left out.
    """
    ends = [0.0 * next(iter(families.values())) for _ in range(2)]
    for family, (words, colour, _) in FAMILIES.items():
        own = families.get(family, 0.0 * ends[0])
        for place, part in enumerate((np.minimum(own, 0.0), np.maximum(own, 0.0))):
            if np.nanmax(np.abs(part)) > least:
                yield part, ends[place], colour, {'label': words, **_looks(colour)}
                ends[place] = ends[place] + part


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
    there = (x0, y0), (middle, y0), (middle, y1), (x1, y1)
    points = [*there, *((x, y + height) for x, y in reversed(there)), (x0, y0)]
    curve = [Outline.CURVE4] * 3
    codes = [Outline.MOVETO, *curve, Outline.LINETO, *curve, Outline.CLOSEPOLY]
    looks = {'edgecolor': 'none', **_looks(colour)}
    axes.add_patch(PathPatch(Outline(points, codes), facecolor=colour, alpha=0.85, lw=0, **looks))
