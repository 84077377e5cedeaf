"""The evaluation's plots as plotly figures, after Figures 5 and 6 of the paper."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from policy_training.evaluation.gait_cycle import Cycle

Figure = dict[str, Any]

PARTS: Final = ('electronics', 'idle', 'HAA', 'HFE', 'KFE')
_PART_COLORS: Final = ('#8a949e', '#bcc4cc', '#56b4e9', '#009e73', '#d55e00')
COLORS: Final = ('#d55e00', '#0072b2', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
_SIGNALS: Final = {
    'torque': 'torque N·m',
    'velocity': 'speed rad/s',
    'position_error': 'error rad',
    'power': 'power W',
    'foot_force': 'foot force N',
}


def power_bars(entries: Sequence[Mapping[str, Any]]) -> Figure:
    """Measured power by where it goes, a bar for each policy on each task; the estimate beside."""
    shown = [entry for entry in entries if entry['power_w']]
    axis = [[entry['task'] for entry in shown], [entry['name'] for entry in shown]]
    figure = go.Figure()
    for part, color in zip(PARTS, _PART_COLORS, strict=True):
        figure.add_bar(
            x=axis,
            y=[round(entry['power_w'][part], 1) for entry in shown],
            name=part,
            marker_color=color,
        )
    if any(entry['estimated_w'] is not None for entry in shown):
        figure.add_scatter(
            x=axis,
            y=[entry['estimated_w'] for entry in shown],
            name='estimated',
            mode='markers',
            marker={'symbol': 'line-ew-open', 'size': 26, 'line': {'width': 3}},
            marker_color='#888888',
        )
    figure.update_layout(barmode='relative')
    figure.update_yaxes(title_text='power in W')
    return _finished(figure, below=125)


def gait_cycles(cycles: Mapping[str, Cycle]) -> Figure:
    """One drive over the mean gait cycle of each policy; what is shaded stands on the ground."""
    names = list(cycles)
    figure = make_subplots(
        rows=len(_SIGNALS),
        cols=len(names),
        shared_xaxes=True,
        shared_yaxes='rows',  # type: ignore[arg-type]
        column_titles=names,
        vertical_spacing=0.02,
        horizontal_spacing=0.03,
    )
    for column, (name, cycle) in enumerate(cycles.items(), start=1):
        color = COLORS[(column - 1) % len(COLORS)]
        for row, (key, title) in enumerate(_SIGNALS.items(), start=1):
            band = [*cycle.high[key].tolist(), *cycle.low[key][::-1].tolist()]
            figure.add_trace(
                go.Scatter(
                    x=[*cycle.phase.tolist(), *cycle.phase[::-1].tolist()],
                    y=[round(value, 3) for value in band],
                    fill='toself',
                    line_width=0,
                    fillcolor=color,
                    opacity=0.25,
                    hoverinfo='skip',
                    showlegend=False,
                ),
                row=row,
                col=column,
            )
            figure.add_trace(
                go.Scatter(
                    x=cycle.phase.tolist(),
                    y=np.round(cycle.mean[key], 3).tolist(),
                    name=name,
                    line={'color': color, 'width': 2},
                    showlegend=False,
                ),
                row=row,
                col=column,
            )
            figure.add_vrect(
                x0=0.0,
                x1=cycle.stance,
                row=row,
                col=column,
                fillcolor='#888888',
                opacity=0.15,
                line_width=0,
            )
            if column == 1:
                figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text='gait cycle', row=len(_SIGNALS))
    return _finished(figure)


def front(entries: Sequence[Mapping[str, Any]]) -> Figure:
    """Supply power against tracking error, a point for each policy on each task."""
    figure = go.Figure()
    tasks = list(dict.fromkeys(entry['task'] for entry in entries))
    for task, color in zip(tasks, COLORS, strict=False):
        rows = [e for e in entries if e['task'] == task and e['power_w']]
        figure.add_scatter(
            x=[round(_error(entry), 3) for entry in rows],
            y=[round(entry['power_w']['supply'], 1) for entry in rows],
            text=[entry['name'] for entry in rows],
            name=task,
            mode='markers+text',
            textposition='top center',
            marker={'size': 10, 'color': color},
        )
    figure.update_xaxes(title_text='tracking error in m/s and rad/s', rangemode='tozero')
    figure.update_yaxes(title_text='supply power in W')
    return _finished(figure)


def learning_curves(runs: Mapping[str, Sequence[Mapping[str, float]]]) -> Figure:
    """Tracking errors and predicted power over training, a line for each run."""
    keys = {
        'error/velocity': 'off by m/s',
        'error/yaw': 'off by rad/s',
        'power/watts': 'predicted W',
    }
    figure = make_subplots(rows=len(keys), cols=1, shared_xaxes=True, vertical_spacing=0.04)
    for (name, rows), color in zip(runs.items(), COLORS * 8, strict=False):
        for index, key in enumerate(keys, start=1):
            found = [row for row in rows if key in row]
            figure.add_trace(
                go.Scatter(
                    x=[row['steps'] / 1e6 for row in found],
                    y=_rolling(np.array([row[key] for row in found])).tolist(),
                    name=name,
                    legendgroup=name,
                    showlegend=index == 1,
                    line={'color': color, 'width': 1.8},
                ),
                row=index,
                col=1,
            )
    for index, title in enumerate(keys.values(), start=1):
        figure.update_yaxes(title_text=title, row=index, col=1)
    figure.update_xaxes(title_text='million policy steps', row=len(keys), col=1)
    return _finished(figure)


def _error(entry: Mapping[str, Any]) -> float:
    return float(np.linalg.norm([entry['tracking'][name] for name in ('vx', 'vy', 'yaw')]))


def _rolling(values: NDArray[np.float64], width: int = 9) -> NDArray[np.float64]:
    if len(values) < width:
        return values
    padded = np.pad(values, width // 2, mode='edge')
    return np.round(np.convolve(padded, np.ones(width) / width, mode='valid'), 4)


def _finished(figure: go.Figure, below: int = 45) -> Figure:
    figure.update_layout(
        margin={'l': 60, 'r': 10, 't': 30, 'b': below},
        paper_bgcolor='rgba(0,0,0,0)',
        plot_bgcolor='rgba(0,0,0,0)',
        legend={'orientation': 'h', 'y': 1.08},
        font={'color': '#808890', 'size': 12},
    )
    for update in (figure.update_xaxes, figure.update_yaxes):
        update(gridcolor='rgba(128,136,144,0.25)', zerolinecolor='rgba(128,136,144,0.6)')
    content: Figure = figure.to_plotly_json()
    content['layout'].pop('template', None)
    return content
