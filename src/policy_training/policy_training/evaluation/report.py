"""Offline HTML page of an evaluation."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle as repeat
from math import hypot
from pathlib import Path
from typing import Any, Final

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots
from scipy.ndimage import uniform_filter1d
from wattwalk_core.anymal import JOINT_TYPES
from wattwalk_core.arrays import Floats
from wattwalk_core.pages.page import COLORS, Figure, Page, escape, finished, short

from policy_training.evaluation.gait_cycle import Cycle

PARTS: Final = ('electronics', 'idle', *JOINT_TYPES)
_PART_COLORS: Final = ('#8a949e', '#bcc4cc', '#c9b8e8', '#9a7fd1', '#6a4caf')
_POLICY_COLORS: Final = (
    *(COLORS['base'], COLORS['better'], COLORS['third'], '#cc79a7'),
    *('#e69f00', '#56b4e9', '#aa4455', '#999933'),
)
_SYMBOLS: Final = ('circle', 'square', 'diamond', 'triangle-up', 'cross', 'star')
_SIGNALS: Final = {
    'torque': 'torque N·m',
    'velocity': 'speed rad/s',
    'position_error': 'error rad',
    'power': 'power W',
    'foot_force': 'foot force N',
}
_CURVES: Final = {
    'error/velocity': 'velocity error m/s',
    'error/yaw': 'yaw rate error rad/s',
    'power/watts': 'predicted W',
    'power/drawn': 'drawn W',
}


def power_bars(entries: Sequence[Mapping[str, Any]]) -> Figure:
    """Measured power by parts, a bar for each policy and task, with the estimates."""
    shown = [entry for entry in entries if entry['power_w']]
    axis = [[entry['task'] for entry in shown], [entry['name'] for entry in shown]]
    figure = go.Figure()
    for part, color in zip(PARTS, _PART_COLORS, strict=True):
        watts = _numbers(entry['power_w'][part] for entry in shown)
        figure.add_bar(x=axis, y=watts, name=part, marker_color=color)
    if any(entry['estimated_w'] is not None for entry in shown):
        figure.add_scatter(
            x=axis,
            y=_numbers(entry['estimated_w'] for entry in shown),
            name='estimated',
            mode='markers',
            marker={'symbol': 'line-ew-open', 'size': 26, 'line': {'width': 3}},
            marker_color=COLORS['measured'],
        )
    figure.update_layout(barmode='relative')
    figure.update_yaxes(title_text='power in W')
    plain = finished(figure, legend=True)
    plain['layout']['margin']['b'] = 125
    return plain


def gait_cycles(cycles: Mapping[str, Cycle], color_of: Mapping[str, str]) -> Figure:
    """Mean gait cycle of one drive for each policy; stance is shaded."""
    figure = make_subplots(
        rows=len(_SIGNALS),
        cols=len(cycles),
        shared_xaxes=True,
        shared_yaxes='rows',  # type: ignore[arg-type]
        column_titles=list(cycles),
        vertical_spacing=0.02,
        horizontal_spacing=0.03,
    )
    for column, (name, cycle) in enumerate(cycles.items(), start=1):
        color = color_of[name]
        phase = cycle.phase.tolist()
        for row, key in enumerate(_SIGNALS, start=1):
            band = go.Scatter(
                x=[*phase, *phase[::-1]],
                y=short(np.concatenate([cycle.high[key], cycle.low[key][::-1]])),
                fill='toself',
                line_width=0,
                fillcolor=color,
                opacity=0.25,
                hoverinfo='skip',
            )
            mean = go.Scatter(x=phase, y=short(cycle.mean[key]), line={'color': color, 'width': 2})
            figure.add_traces([band, mean], rows=[row] * 2, cols=[column] * 2)
            shade = {'fillcolor': COLORS['grid'], 'layer': 'below', 'line_width': 0}
            figure.add_vrect(x0=0.0, x1=cycle.stance, **shade, row=row, col=column)
    for row, title in enumerate(_SIGNALS.values(), start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text='gait cycle', row=len(_SIGNALS))
    plain = finished(figure)
    plain['layout']['margin']['t'] = 34
    return plain


def pareto_front(entries: Sequence[Mapping[str, Any]], color_of: Mapping[str, str]) -> Figure:
    """Supply power against errors of speed and of yaw rate: a policy a colour, a task a symbol."""
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True, horizontal_spacing=0.04)
    tasks = list(dict.fromkeys(entry['task'] for entry in entries))
    for task, symbol in zip(tasks, repeat(_SYMBOLS)):
        rows = [entry for entry in entries if entry['task'] == task and entry['power_w']]
        off = [entry['tracking'] for entry in rows]
        errors = [hypot(one['vx'], one['vy']) for one in off], [abs(one['yaw']) for one in off]
        colors = [color_of[entry['name']] for entry in rows]
        for column, values in enumerate(errors, start=1):
            points = go.Scatter(
                x=_numbers(values),
                y=_numbers(entry['power_w']['supply'] for entry in rows),
                error_y={'type': 'data', 'array': [_half(entry) for entry in rows], 'width': 3},
                text=[entry['name'] for entry in rows],
                name=task,
                legendgroup=task,
                showlegend=column == 1,
                mode='markers',
                marker={'size': 11, 'symbol': symbol, 'color': colors},
                hovertemplate='%{text}: %{y:.0f} W<extra>' + task + '</extra>',
            )
            figure.add_trace(points, row=1, col=column)
    for name, color in color_of.items():
        figure.add_scatter(x=[None], y=[None], name=name, mode='lines', line={'color': color})
    figure.update_xaxes(title_text='error of the speed in m/s', rangemode='tozero', row=1, col=1)
    figure.update_xaxes(title_text='error of the yaw rate in rad/s', rangemode='tozero', col=2)
    figure.update_yaxes(title_text='supply power in W', col=1)
    return finished(figure, legend=True)


def _half(entry: Mapping[str, Any]) -> float:
    low, high = entry.get('power_interval_w', {}).get('supply', (0.0, 0.0))
    return round(0.5 * (high - low), 2)


def falls_front(
    entries: Sequence[Mapping[str, Any]],
    trials: Mapping[str, Mapping[str, Any]],
    color_of: Mapping[str, str],
) -> Figure:
    """Mean supply power over the tasks against the share of robots that fell, by policy."""
    figure = go.Figure()
    for name, trial in trials.items():
        own = (entry['power_w'] for entry in entries if entry['name'] == name)
        watts = [power['supply'] for power in own if power]
        figure.add_scatter(
            x=_numbers([100.0 * trial['falls'] / trial['robots']]),
            y=_numbers([float(np.mean(watts)) if watts else None]),
            text=[name],
            name=name,
            mode='markers+text',
            textposition='middle right',
            cliponaxis=False,
            marker={'size': 10, 'color': color_of[name]},
        )
    most = max((100.0 * t['falls'] / t['robots'] for t in trials.values()), default=0.0)
    figure.update_xaxes(title_text='robots that fell in %', range=[0.0, 1.25 * most or 1.0])
    figure.update_yaxes(title_text='mean supply power in W')
    return finished(figure)


def learning_curves(
    runs: Mapping[str, Sequence[Mapping[str, float]]], color_of: Mapping[str, str]
) -> Figure:
    """Tracking errors and predicted power over training, a line for each run."""
    figure = make_subplots(rows=len(_CURVES), cols=1, shared_xaxes=True, vertical_spacing=0.04)
    for name, rows in runs.items():
        for index, (key, title) in enumerate(_CURVES.items(), start=1):
            found = [row for row in rows if key in row]
            line = go.Scatter(
                x=[row['steps'] / 1e6 for row in found],
                y=_smooth(np.array([row[key] for row in found])),
                name=name,
                legendgroup=name,
                showlegend=index == 1,
                line={'color': color_of[name], 'width': 1.8},
            )
            figure.add_trace(line, row=index, col=1)
            figure.update_yaxes(title_text=title, row=index, col=1)
    figure.update_xaxes(title_text='million policy steps', row=len(_CURVES), col=1)
    return finished(figure, legend=True)


def _numbers(values: Iterable[float | None]) -> Any:
    return short(np.array(list(values), np.float64))


def _smooth(values: Floats) -> Any:
    return short(uniform_filter1d(values, 9, mode='nearest') if len(values) >= 9 else values)


_AXES: Final = {'vx': 'vx error m/s', 'vy': 'vy error m/s', 'yaw': 'yaw rate error rad/s'}


def write_report(
    path: Path,
    result: Mapping[str, Any],
    cycles: Mapping[str, Mapping[str, Cycle]],
    curves: Mapping[str, Sequence[Mapping[str, float]]],
) -> None:
    """Write the HTML page of an evaluation.

    result: as in its JSON. cycles: by task, then by policy. curves: of training, by policy.
    """
    entries = result['policies']
    policies = dict.fromkeys([*(e['name'] for e in entries), *result['trials'], *curves])
    color_of = dict(zip(policies, repeat(_POLICY_COLORS)))  # the same in all figures
    title = 'Power and gait of the policies'
    page = Page(title, [f'<h1>{escape(title)}</h1>'])
    for sentence in result['verdict']:
        page.text(sentence)
    page.heading('Power by parts')
    page.text(
        'Mean over steady walking. Supply is measured at the battery terminals. Electronics is '
        'the part of it that does not reach the drives, idle the power of the drives at rest, '
        'and each joint type the power of its four drives beyond that. The mark across a bar is '
        'the estimate. Intervals hold nine of ten, and are of the mean over this walk: another '
        'seed of the training differs more.'
    )
    page.add(page.figure(power_bars(entries), 'power of each policy and task, by parts'))
    _table(
        page,
        ('policy', 'task', 'supply W', *(f'{p} W' for p in PARTS), 'estimated W', 'CoT', 'falls'),
        [
            (
                *(e['name'], e['task'], e['power_w']['supply']),
                *(e['power_w'][part] for part in PARTS),
                *(e['estimated_w'], e['cost_of_transport'], e['falls']),
            )
            for e in entries
            if e['power_w']
        ],
    )
    page.heading('Tracking')
    _table(
        page,
        ('policy', 'task', *_AXES.values(), 'steady s'),
        [(e['name'], e['task'], *map(e['tracking'].get, _AXES), e['steady_s']) for e in entries],
    )
    front = pareto_front(entries, color_of)
    page.add(page.figure(front, 'supply power against errors of speed and of yaw rate'))
    if result['trials']:
        page.heading('Robustness on rough ground, with pushes and changing commands')
        _table(
            page,
            ('policy', 'follows', 'robots', 'fell', '95 %', *_AXES.values()),
            [
                (
                    *(name, 'yes' if t['following'] else 'no', t['robots'], t['falls']),
                    ' … '.join(f'{100 * share:.1f}' for share in t['fell_95']) + ' %',
                    *map(t['mean_error'].get, _AXES),
                )
                for name, t in result['trials'].items()
            ],
        )
        falls = falls_front(entries, result['trials'], color_of)
        page.add(page.figure(falls, 'mean supply power against robots that fell'))
    page.heading('Gait')
    _table(
        page,
        (
            *('policy', 'task', 'stride s', 'swing s', 'stance s', 'impact N', 'loudness dB'),
            *('torque RMS N·m', 'KFE speed RMS rad/s', 'KFE torque above 20 Hz'),
        ),
        [_gait_row(entry) for entry in entries if entry.get('gait')],
    )
    for task, found in cycles.items():
        page.text(f'Mean gait cycle of LF_KFE on {task}; stance is shaded.')
        label = f'gait cycle of LF_KFE on {task}'
        page.add(page.figure(gait_cycles(found, color_of), label, size='large'))
    if any(curves.values()):
        page.heading('Training')
        page.add(page.figure(learning_curves(curves, color_of), 'learning curves', size='tall'))
    page.write(path)


def _gait_row(entry: Mapping[str, Any]) -> tuple[object, ...]:
    gait, smooth = entry['gait'], entry['smoothness']
    return (
        *(entry['name'], entry['task'], gait['stride_s'], gait['swing_s'], gait['stance_s']),
        *(gait['impact_n'], gait['impact_rate_db'], smooth['torque_rms_nm']),
        *(smooth['kfe_velocity_rms'], smooth['kfe_torque_above_20_hz']),
    )


def _table(page: Page, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    texts = [[_text(cell) for cell in row] for row in rows]
    page.table(columns, texts, numbers=range(2, len(columns)))


def _text(cell: object) -> str:
    if cell is None:
        return '–'
    if isinstance(cell, float):
        return f'{cell:.0f}' if abs(cell) >= 100 else f'{cell:.2f}'
    return str(cell)
