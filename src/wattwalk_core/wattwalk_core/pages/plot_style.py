"""Plot style of a page; colours are placeholders for those of the page's style sheet."""

from typing import Any

import numpy as np
import plotly.graph_objects as go

Figure = dict[str, Any]

COLORS = {
    name: f'#00000{digit}'
    for digit, name in enumerate(
        ('measured', 'base', 'better', 'third', 'text', 'faint', 'line', 'grid', 'ground'), start=1
    )
}
"""Placeholders that the page replaces by its colours, light or dark."""


def finished(figure: go.Figure, *, legend: bool = False) -> Figure:
    """Return the figure as a plain mapping in the common plot style."""
    axis = {
        'gridcolor': COLORS['grid'],
        'zerolinecolor': COLORS['line'],
        'linecolor': COLORS['line'],
        'tickfont': {'size': 12},
        'title': {'font': {'size': 13}, 'standoff': 8},
    }
    figure.update_xaxes(axis)
    figure.update_yaxes(axis)
    figure.update_layout(
        template='none',
        paper_bgcolor='rgba(0,0,0,0)',
        plot_bgcolor='rgba(0,0,0,0)',
        font={'color': COLORS['text'], 'family': 'system-ui, "DejaVu Sans", sans-serif'},
        margin={'l': 56, 'r': 14, 't': 30 if legend else 12, 'b': 46},
        showlegend=legend,
        legend={'orientation': 'h', 'x': 0, 'y': 1.0, 'yanchor': 'bottom'},
        hovermode='closest',
        dragmode='zoom',
        hoverlabel={'font': {'size': 12}},
        modebar={'bgcolor': 'rgba(0,0,0,0)', 'color': COLORS['faint']},
    )
    plain: Figure = figure.to_plotly_json()
    return {'data': list(plain['data']), 'layout': plain['layout']}


def short(values: Any) -> Any:
    """Round to four digits; None for values that are not finite."""
    if isinstance(values, np.ndarray) and values.ndim == 2:
        return [short(row) for row in values]
    return [float(f'{v:.4g}') if np.isfinite(v) else None for v in np.asarray(values).tolist()]
