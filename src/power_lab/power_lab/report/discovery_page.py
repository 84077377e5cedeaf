"""The page of a discovery: shapes, formulas, where they act, and another recording."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from wattwalk_core.arrays import Floats
from wattwalk_core.pages.page import COLORS, Figure, Page, escape, finished, short

from power_lab.discover.found import Found
from power_lab.discover.outcome import DiscoveryOutcome, Transfer
from power_lab.report import figures
from power_lab.structure.shapes import LearnedShape


def write_discovery(path: Path, outcome: DiscoveryOutcome) -> None:
    """Write the HTML page of a discovery."""
    prepared = outcome.own.prepared
    title = 'Discovered' if outcome.written else 'Nothing of the drives'
    page = Page(f'{title}: {outcome.model.name}')
    page.add(f'<p class="kind {"named" if outcome.written else "no_evidence"}">{title}</p>')
    page.add(f'<h1 id="verdict">{escape(outcome.sentence)}</h1>')
    facts = {
        'Model': outcome.model.name,
        'Active effects': ', '.join(outcome.model.effects) or 'none',
        'Learned from': ', '.join(entry['name'] for entry in outcome.loaded.identities),
        'Tested on': ', '.join(outcome.tested_on) or 'no other recording',
        'Drives': ', '.join(prepared.names),
        'Length': f'{prepared.seconds:.0f} s without gaps',
    }
    page.facts(facts)
    for one, transfer in zip(outcome.discovery.found, outcome.transfers, strict=True):
        page.heading(one.name.replace('_', ' '))
        page.text(outcome.told(one, transfer))
        _section_shapes(page, outcome, one)
        _section_places(page, outcome, one)
        if transfer is not None:
            _section_transfer(page, transfer)
    _section_errors(page, outcome)
    page.heading('How to read this')
    page.text(
        'The grey band is two standard errors of the learned shape, from fits that leave out a '
        'fifth of the recording each; a constant of a shape is that of the model beside it, so '
        'that only its course counts. The formula is the smallest of a fixed grammar that keeps '
        'what the shape explains on data that neither was fitted to. It is a hypothesis: the '
        'excitation in the file says how to confirm it.',
        faint=True,
    )
    page.write(path)


def formula_over_shape(one: Found, drive: int) -> tuple[Floats, tuple[str, str]]:
    """Formula at the nodes of a drive's learned shape [K], and the titles of both axes."""
    formula = one.formula
    assert formula is not None
    assert one.shapes is not None
    assert one.coefficients is not None
    shape = one.shapes[drive]
    core = formula.primitive.columns(shape.nodes, dict(formula.places[drive].parameters))
    drawn = core @ np.array(one.coefficients[drive])
    drawn = drawn - float((drawn - shape.values) @ shape.share / shape.share.sum())
    driver, factor = shape.family.driver, formula.family.factor.symbol
    unit = {'torque': 'N·m on the motor', 'power': 'W'}[formula.family.acts_on]
    across = f'{driver.symbol} in {driver.unit}' if driver.unit else driver.symbol
    return drawn, (across, f'{unit} per {factor}' if factor else unit)


def _section_shapes(page: Page, outcome: DiscoveryOutcome, one: Found) -> None:
    formula = one.formula
    if formula is None or one.shapes is None or one.coefficients is None:
        return
    names = outcome.own.prepared.names
    panels = {}
    for drive in formula.places:
        shape = one.shapes[drive]
        drawn, axes = formula_over_shape(one, drive)
        figure = shape_and_formula(shape, drawn, axes)
        text = f'<p>{escape(formula.text(drive))}</p>'
        panels[names[drive]] = text + page.figure(figure, f'Shape on {names[drive]}')
    page.tabs(panels)
    rows = []
    for drive, values in one.coefficients.items():
        each = zip(values, (one.coefficient_intervals or {})[drive], strict=True)
        told = [f'{v:.3g} ({low:.3g} … {high:.3g}) {formula.unit}' for v, (low, high) in each]
        watts = f'{np.sqrt(max(one.gain[drive], 0.0)):.2f} W'
        rows.append([names[drive], formula.text(drive), ', '.join(told), watts])
    page.table(['drive', 'formula', 'coefficient (95 %)', 'explains'], rows, numbers=(3,))
    if one.rivals:
        others = '; '.join(f'{text} ({watts:.2f} W more)' for text, watts in one.rivals)
        page.text(f'Other explanations leave more: {others}.', faint=True)


def standard_error(shape: LearnedShape) -> Floats:
    """Standard error of a shape at its nodes [K], by a jackknife over the folds."""
    count = len(shape.nodes)
    folds = shape.by_fold[:-1, -count:]
    weights = shape.share / shape.share.sum()
    centred = folds - (folds @ weights)[:, None]
    spread = centred - centred.mean(axis=0)
    return np.sqrt((len(folds) - 1) / len(folds) * np.square(spread).sum(axis=0))


def _section_places(page: Page, outcome: DiscoveryOutcome, one: Found) -> None:
    fit = outcome.discovery.best.fit
    columns = fit.structure.columns_of(one.name)
    if not columns:
        return
    power = np.einsum('ndk,dk->nd', fit.design.columns[..., columns], fit.coefficients[:, columns])
    blocks = outcome.discoverer.fitter.blocks
    rms = np.sqrt(np.square(power[blocks.rows]).mean(axis=1))
    names = outcome.own.prepared.names
    page.text('Where in the recording it acts:', faint=True)
    figure = acts_when(blocks.time - blocks.time[0], {names[d]: rms[:, d] for d in one.drives[:4]})
    page.add(page.figure(figure, f'Where {one.name} acts', size='low'))


def _section_transfer(page: Page, transfer: Transfer) -> None:
    page.text(f'On another recording: {transfer.reason}.')
    if not transfer.drives:
        return
    figure = before_and_after(transfer.drives, transfer.before, transfer.after)
    page.add(page.figure(figure, 'Error on another recording', size='low'))
    panels = {}
    for column, name in enumerate(transfer.drives):
        without, with_ = (values[:, column] for values in transfer.residuals)
        known = np.isfinite(without) & np.isfinite(with_)
        figure = figures.traces(
            transfer.time[known],
            transfer.measured[known, column],
            {'without': without[known], 'with it': with_[known]},
            floor=0.15,
        )
        panels[name] = page.figure(figure, f'{name} on another recording', size='tall')
    page.tabs(panels)


def _section_errors(page: Page, outcome: DiscoveryOutcome) -> None:
    discovery, names = outcome.discovery, outcome.own.prepared.names
    page.heading('Error on held-out data of the same recording')
    before = [outcome.before.drives[name].rmse_w for name in names]
    after = [outcome.after.drives[name].rmse_w for name in names]
    figure = before_and_after(names, before, after)
    page.add(page.figure(figure, 'Held-out error', size='low'))
    if discovery.nothing:
        page.text(f'After that: {discovery.nothing}.', faint=True)


_BAND = 'rgba(128,128,128,0.25)'


def shape_and_formula(learned: LearnedShape, formula: Floats, axes: tuple[str, str]) -> Figure:
    """Free shape with its band of two standard errors, the formula over it, and the samples below.

    formula: values at the shape's nodes [K]; axes: their titles.
    """
    nodes, shape, share = learned.nodes, learned.values, learned.share
    band = 2 * standard_error(learned)
    bars = share / max(float(share.max()), 1e-12)
    low = float(min((shape - band).min(), formula.min()))
    high = float(max((shape + band).max(), formula.max()))
    room = max(high - low, 1e-9)
    figure = go.Figure(
        go.Bar(
            x=short(nodes),
            y=short(0.15 * room * bars),
            base=low - 0.2 * room,
            name='samples',
            marker={'color': COLORS['grid']},
            hoverinfo='skip',
        )
    )
    edge = np.concatenate([shape + band, (shape - band)[::-1]])
    figure.add_trace(
        go.Scatter(
            x=short(np.concatenate([nodes, nodes[::-1]])),
            y=short(edge),
            fill='toself',
            fillcolor=_BAND,
            line={'width': 0},
            name='two standard errors',
            hoverinfo='skip',
        )
    )
    for name, values, color in (
        ('learned shape', shape, COLORS['base']),
        ('formula', formula, COLORS['better']),
    ):
        figure.add_trace(figures.line(nodes, values, name, color, '%{x}: %{y}', width=2.2))
    figure.update_layout(bargap=0.0)
    figure.update_xaxes(title_text=axes[0])
    figure.update_yaxes(title_text=axes[1])
    return finished(figure, legend=True)


def acts_when(seconds: Floats, watts: Mapping[str, Floats]) -> Figure:
    """Plot the rms power of an effect, W, over time in s, a line for each of 4 drives; all [B]."""
    figure = go.Figure()
    colors = (COLORS['better'], COLORS['base'], COLORS['third'], COLORS['measured'])
    for color, (name, values) in zip(colors, watts.items(), strict=False):
        figure.add_trace(figures.line(seconds, values, name, color))
    figure.update_xaxes(title_text='time in s')
    figure.update_yaxes(title_text='effect in W rms', rangemode='tozero')
    return finished(figure, legend=True)


def before_and_after(
    drives: Sequence[str], before: Sequence[float], after: Sequence[float]
) -> Figure:
    """Bars of the rms error of each drive without and with the effect, W."""
    figure = go.Figure()
    for name, values, color in (
        ('without', before, COLORS['base']),
        ('with', after, COLORS['better']),
    ):
        figure.add_trace(figures.told_bars(drives, values, name=name, marker={'color': color}))
    top = max([*before, *after, 1e-9])
    figure.update_yaxes(title_text='RMS error in W', range=[0.0, 1.18 * top])
    figure.update_layout(barmode='group')
    return finished(figure, legend=True)
