"""Plots of tracking as plotly figures."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
import plotly.graph_objects as go
from wattwalk_core.pages.plot_style import COLORS, Figure, finished, short

from power_fleet.track.change_test import Change
from power_fleet.track.outcome import Tracked


def series(found: Tracked, drive: int, column: int, changes: Sequence[Change]) -> Figure:
    """Estimates of one coefficient with intervals, and its level before and after changes."""
    history, points = found.histories[drive], found.points[drive]
    name, _ = history.labels[column]
    dates = [_date(time) for time in history.time]
    values, errors = points.values[:, column], 1.96 * points.errors[:, column]
    figure = go.Figure()
    figure.add_trace(
        go.Scatter(
            x=dates,
            y=short(values),
            error_y={
                'type': 'data',
                'array': short(errors),
                'color': COLORS['faint'],
                'thickness': 1.2,
                'width': 0,
            },
            mode='markers',
            name='recording',
            text=list(history.recordings),
            marker={'color': COLORS['measured'], 'size': 6},
            hovertemplate='%{text}: %{y}<extra></extra>',
        )
    )
    time = found.result.models[drive].time
    level = points.level[column] + sum(
        (change.size * change.profile.over(time) for change in changes), np.zeros(len(time))
    )
    figure.add_trace(
        go.Scatter(
            x=dates,
            y=short(level),
            mode='lines',
            name='level',
            line={'color': COLORS['better' if changes else 'base'], 'width': 2.2},
            hoverinfo='skip',
        )
    )
    for change in changes:
        profile = change.profile
        begin = profile.end if profile.step else profile.begin
        figure.add_shape(
            type='line',
            x0=dates[begin],
            x1=dates[begin],
            y0=0,
            y1=1,
            yref='paper',
            line={'color': COLORS['better'], 'width': 1.5, 'dash': 'dash'},
        )
        figure.add_annotation(
            x=dates[begin],
            y=1.0,
            yref='paper',
            xanchor='left',
            yanchor='top',
            showarrow=False,
            text=' step' if profile.step else ' drift begins',
            font={'color': COLORS['text'], 'size': 12},
        )
    unit = found.unit(name)
    figure.update_yaxes(title_text=f'in {unit}' if unit else 'share', automargin=True)
    return finished(figure, legend=True)


def _date(time: float) -> str:
    return datetime.fromtimestamp(float(time), UTC).strftime('%Y-%m-%d %H:%M:%S')
