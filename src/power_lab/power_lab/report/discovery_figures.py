"""Plots of a discovery as plotly figures."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from wattwalk_core.arrays import Floats
from wattwalk_core.pages.plot_style import COLORS, Figure, finished, short

_BAND = 'rgba(128,128,128,0.25)'


def shape_and_formula(
    nodes: Floats,
    shape: Floats,
    error: Floats,
    formula: Floats,
    share: Floats,
    axes: tuple[str, str],
) -> Figure:
    """Free shape with its band of two standard errors, the formula over it, and the samples below.

    nodes, shape, error, formula, share: [K].
    """
    figure = go.Figure()
    bars = share / max(float(share.max()), 1e-12)
    low = float(min((shape - 2 * error).min(), formula.min()))
    high = float(max((shape + 2 * error).max(), formula.max()))
    room = max(high - low, 1e-9)
    figure.add_trace(
        go.Bar(
            x=short(nodes),
            y=short(0.15 * room * bars),
            base=low - 0.2 * room,
            name='samples',
            marker={'color': COLORS['grid']},
            hoverinfo='skip',
        )
    )
    edge = np.concatenate([shape + 2 * error, (shape - 2 * error)[::-1]])
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
        figure.add_trace(
            go.Scatter(
                x=short(nodes),
                y=short(values),
                name=name,
                mode='lines',
                line={'color': color, 'width': 2.2},
                hovertemplate='%{x}: %{y}<extra>' + name + '</extra>',
            )
        )
    figure.update_layout(bargap=0.0)
    figure.update_xaxes(title_text=axes[0])
    figure.update_yaxes(title_text=axes[1])
    return finished(figure, legend=True)


def acts_when(seconds: Floats, watts: Mapping[str, Floats]) -> Figure:
    """W rms in each second of the recording, by drive."""
    figure = go.Figure()
    colors = (COLORS['better'], COLORS['base'], COLORS['third'], COLORS['measured'])
    for place, (name, values) in enumerate(watts.items()):
        figure.add_trace(
            go.Scatter(
                x=short(seconds),
                y=short(values),
                name=name,
                mode='lines',
                line={'color': colors[place % len(colors)], 'width': 1.4},
                hovertemplate='%{x} s: %{y} W<extra></extra>',
            )
        )
    figure.update_xaxes(title_text='time in s')
    figure.update_yaxes(title_text='effect in W rms', rangemode='tozero')
    return finished(figure, legend=True)


def before_and_after(
    drives: Sequence[str], before: Sequence[float], after: Sequence[float]
) -> Figure:
    """Error of each drive without and with the effect, W."""
    figure = go.Figure()
    for name, values, color in (
        ('without', before, COLORS['base']),
        ('with', after, COLORS['better']),
    ):
        figure.add_trace(
            go.Bar(
                x=list(drives),
                y=short(values),
                name=name,
                text=[f'{value:.2f} W' for value in values],
                textposition='outside',
                cliponaxis=False,
                marker={'color': color},
            )
        )
    top = max([*before, *after, 1e-9])
    figure.update_yaxes(title_text='RMS error in W', range=[0.0, 1.18 * top])
    figure.update_layout(barmode='group')
    return finished(figure, legend=True)
