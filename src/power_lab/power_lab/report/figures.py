"""Plots of the report as plotly figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike, NDArray
from plotly.subplots import make_subplots
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel, over_meters
from wattwalk_core.arrays import Floats
from wattwalk_core.pages.page import COLORS, Figure, finished, short

from power_lab.compare.regimes import UNITS, bins, worst_stretch

LINES = (COLORS['base'], COLORS['better'], COLORS['third'])
_MAP_BINS = 22
_LETTER = 7  # px


def traces(
    time: Floats,
    measured: Floats,
    residuals: Mapping[str, Floats],
    floor: float,
    gap_free: Sequence[slice] = (),
    axis: str = 'time in s',
) -> Figure:
    """Plot measured and estimated power, W [N], where the first residual is largest.

    time: s [N]; residuals: measured − estimated by model [N]; floor: half width of the noise band,
    W; gap_free: slices without gaps.
    """
    part = worst_stretch(next(iter(residuals.values())), gap_free)
    t = time[part] - time[0]
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.66, 0.34], vertical_spacing=0.04
    )
    shown = line(t, measured[part], 'measured', COLORS['measured'], width=2.6)
    figure.add_trace(shown, row=1, col=1)
    for (name, residual), color in zip(residuals.items(), LINES, strict=False):
        estimated = measured[part] - residual[part]
        figure.add_trace(line(t, estimated, name, color), row=1, col=1)
        error = line(t, -residual[part], f'error of {name}', color, showlegend=False)
        figure.add_trace(error, row=2, col=1)
    figure.add_hrect(
        y0=-floor, y1=floor, row=2, col=1, line_width=0, fillcolor=COLORS['grid'], layer='below'
    )
    figure.update_yaxes(title_text='power in W', row=1, col=1)
    figure.update_yaxes(title_text='error in W', row=2, col=1)
    figure.update_xaxes(title_text=axis, row=2, col=1)
    return finished(figure, legend=True)


def torque_speed_map(torque: Floats, velocity: Floats, residual: Floats, limit: float) -> Figure:
    """Map of the mean error over torque and speed [N], W; red: too high; limit: end of colours."""
    good = np.isfinite(residual)
    x, y, z = velocity[good], torque[good], -residual[good]
    ends = (np.quantile(values, [0.003, 0.997]).tolist() for values in (y, x))
    edges = [np.linspace(low, high + 1e-9, _MAP_BINS + 1) for low, high in ends]
    sums, *_ = np.histogram2d(y, x, bins=edges, weights=z)
    rows, *_ = np.histogram2d(y, x, bins=edges)
    torques, speeds = (short(0.5 * (own[1:] + own[:-1])) for own in edges)
    with np.errstate(invalid='ignore'):
        mean = np.where(rows >= 5, sums / rows, np.nan)
    figure = go.Figure(
        go.Heatmap(
            x=speeds,
            y=torques,
            z=short(mean),
            zmin=-limit,
            zmax=limit,
            colorscale=_DIVERGING,
            colorbar={'title': {'text': 'W'}, 'thickness': 12, 'len': 0.95},
            hovertemplate='%{x} rad/s, %{y} N·m: %{z} W<extra></extra>',
        )
    )
    figure.update_xaxes(title_text='speed in rad/s')
    figure.update_yaxes(title_text='torque in N·m')
    return finished(figure)


def error_over(key: str, values: Floats, residuals: Mapping[str, Floats]) -> Figure | None:
    """Plot the mean error over a quantity, W, one line a model; None where it does not vary.

    key: name of the quantity; values: [N]; residuals: measured − estimated by model, W [N].
    """
    figure = go.Figure()
    for (name, residual), color in zip(residuals.items(), LINES, strict=False):
        found = bins(values, residual)
        if len(found) < 3:
            return None
        middles, means = [0.5 * (b.low + b.high) for b in found], [b.mean for b in found]
        looks = {'mode': 'lines+markers', 'marker': {'size': 5}}
        figure.add_trace(line(middles, means, name, color, '%{x}: %{y} W', width=2, **looks))
    figure.add_hline(y=0.0, line_width=1, line_color=COLORS['line'])
    figure.update_xaxes(title_text=f'{key.replace("_", " ")} in {UNITS.get(key, "")}')
    figure.update_yaxes(title_text='mean error in W')
    return finished(figure)


def error_by(groups: Mapping[str, NDArray[np.bool_]], residuals: Mapping[str, Floats]) -> Figure:
    """Bars of each model's rms error, W, in named groups of samples (masks [N])."""
    figure = go.Figure()
    for (name, residual), color in zip(residuals.items(), LINES, strict=False):
        values = []
        for mask in groups.values():
            own = residual[mask & np.isfinite(residual)]
            values.append(float(np.sqrt(np.mean(np.square(own)))) if own.size else 0.0)
        figure.add_trace(
            go.Bar(x=list(groups), y=short(values), name=name, marker={'color': color})
        )
    figure.update_yaxes(title_text='RMS error in W', rangemode='tozero')
    figure.update_layout(barmode='group')
    return finished(figure)


def candidates(names: Sequence[str], watts: Sequence[float], chosen: Sequence[bool]) -> Figure:
    """Bars of the power in W that each effect explains, the first on top; chosen: coloured."""
    colors = [COLORS['better'] if own else COLORS['line'] for own in chosen]
    figure = go.Figure(
        go.Bar(
            y=list(names)[::-1],
            x=short(list(watts)[::-1]),
            orientation='h',
            marker={'color': colors[::-1]},
            hovertemplate='%{y}: %{x} W<extra></extra>',
        )
    )
    figure.update_xaxes(title_text='explains, W', rangemode='tozero')
    figure.update_yaxes(automargin=True, ticksuffix='  ')
    return finished(figure)


_DIVERGING = ['#2166ac', '#67a9cf', '#f2f2f2', '#ef8a62', '#b2182b']


def line(
    x: ArrayLike,
    y: ArrayLike,
    name: str,
    color: str,
    told: str = '%{x} s: %{y} W',
    *,
    width: float = 1.4,
    **looks: Any,
) -> go.Scatter:
    """Line of y over x [N]; told: what a place on it says; looks: as plotly has them."""
    return go.Scatter(
        x=short(x),
        y=short(y),
        name=name,
        line={'color': color, 'width': width},
        hovertemplate=f'{told}<extra>{name}</extra>',
        **{'mode': 'lines', **looks},
    )


def told_bars(names: Sequence[str], watts: Sequence[float], **looks: Any) -> go.Bar:
    """Bars of errors in W, each with its value above it; looks: as plotly has them."""
    return go.Bar(
        x=list(names),
        y=short(watts),
        text=[f'{value:.2f} W' for value in watts],
        textposition='outside',
        cliponaxis=False,
        **looks,
    )


def noise_w(noise: Floats) -> float:
    """Rms noise of all meters, W, from that of each, W [M]; unknown ones count as 0."""
    return float(np.sqrt(np.nan_to_num(np.square(noise)).mean()))


@dataclass(frozen=True)
class Stairs:
    """Comparable held-out errors on the same recordings, step by step."""

    steps: tuple[str, ...]
    errors: tuple[float, ...]  # W, over the meters
    noise: float  # W, of the sensors

    @classmethod
    def of(
        cls,
        history: Sequence[Mapping[str, Any]],
        judged: Sequence[JudgedModel],
        loaded: Loaded,
        noise: NDArray[np.float64],
    ) -> 'Stairs':
        """Make a staircase of a model's history and of models as they are judged now.

        The first of these is the model, whose errors the history ends with. Steps whose errors are
        of other recordings or meters, or were held out in another way, are left out. noise: of the
        meters, W [M].
        """
        former = [entry for entry in history[:-1] if _comparable(entry, judged[0], loaded)]
        last = [entry for entry in history[-1:] if _comparable(entry, judged[0], loaded)]
        names = [
            ', '.join(entry.get('added', ())) or str(entry.get('step'))
            for entry in (*former, *last)
        ]
        errors = [over_meters(entry['rmse_w'].values()) for entry in former]
        return cls(
            (*names, *(one.name for one in judged[len(last) :])),
            (*errors, *(one.rms_w for one in judged)),
            noise_w(noise),
        )

    def __str__(self) -> str:
        return '\n'.join(
            f'{error:8.2f} W  {step}' for step, error in zip(self.steps, self.errors, strict=True)
        )

    def figure(self, lines: Mapping[str, float] | None = None) -> Figure:
        """Draw the errors as bars; lines: errors of other models to draw across, W by name."""
        across = {'sensor noise': self.noise, **(lines or {})}
        colors = [COLORS['base']] + [COLORS['better']] * (len(self.steps) - 1)
        looks = {'marker': {'color': colors}, 'hovertemplate': '%{x}: %{y} W<extra></extra>'}
        figure = go.Figure(told_bars(self.steps, self.errors, **looks))
        dashes = ('dash', 'dot', 'dashdot') * 3
        labels = [f'{name} {level:.2f} W' for name, level in across.items()]
        for label, level, dash in zip(labels, across.values(), dashes, strict=False):
            color = COLORS['third'] if dash == 'dash' else COLORS['faint']
            figure.add_hline(
                y=level,
                line={'color': color, 'dash': dash},
                annotation={'text': label, 'xanchor': 'left', 'yanchor': 'middle'},
                annotation_position='right',
            )
        figure.update_layout(bargap=0.55)
        top = max([*self.errors, *across.values()])
        figure.update_yaxes(title_text='held-out error in W', range=[0.0, 1.18 * top])
        figure.update_xaxes(automargin=True)
        return finished(figure, right=_LETTER * max(map(len, labels)))


def _comparable(entry: Mapping[str, Any], judged: JudgedModel, loaded: Loaded) -> bool:
    return (
        entry.get('held_out') == judged.held_out
        and all(entry.get(key) == own for key, own in loaded.judged_on.items())
        and {*entry.get('rmse_w', ())} == {*judged.rmse}
    )
