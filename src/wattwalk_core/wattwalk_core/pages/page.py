"""The bones of a page: sections, tables, tabs, and one file that needs no network."""

import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from wattwalk_core.files import write_whole

Figure = dict[str, Any]

_HERE = Path(__file__).parent
_STYLE = (_HERE / 'style.css').read_text(encoding='utf-8')
COLORS = dict(re.findall(r'--(\w+): (#\w{6})', _STYLE.partition('}')[0]))
"""Colours of figures by name: those of a light page, which a dark page replaces by its own."""


def finished(figure: go.Figure, *, legend: bool = False, right: int = 14) -> Figure:
    """Put a plotly figure into the house's style: {'data': …, 'layout': …}; right: margin, px."""
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
        margin={'l': 56, 'r': right, 't': 30 if legend else 12, 'b': 46},
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
    """Return values [N] or [N, M] as lists, to four significant digits; None for non-finite."""
    if isinstance(values, np.ndarray) and values.ndim == 2:
        return [short(row) for row in values]
    return [float(f'{v:.4g}') if np.isfinite(v) else None for v in np.asarray(values).tolist()]


_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    'img-src data: blob:; font-src data:'
)


def escape(text: object) -> str:
    """Return text with HTML's special characters escaped."""
    return html.escape(str(text))


@dataclass
class Page:
    """HTML page that grows from top to bottom: all methods but `figure` and `write` append."""

    title: str
    parts: list[str] = field(default_factory=list)
    figures: dict[str, Figure] = field(default_factory=dict)

    def add(self, markup: str) -> None:
        """Append markup, which is escaped already."""
        self.parts.append(markup)

    def heading(self, text: str) -> None:
        """Append the heading of a section."""
        self.add(f'<h2>{escape(text)}</h2>')

    def text(self, text: str, *, faint: bool = False) -> None:
        """Append a paragraph; faint: in a paler colour."""
        self.add(f'<p{" class=faint" if faint else ""}>{escape(text)}</p>')

    def figure(self, figure: Figure, label: str, *, size: str = 'mid') -> str:
        """Keep a figure made by `finished`, and return markup for its place in the page.

        label: alternative text; size: height, `large`, `tall`, `mid` or `low`.
        """
        name = f'figure{len(self.figures)}'
        self.figures[name] = figure
        words = f'role="img" aria-label="{escape(label)}"'
        return f'<div id="{name}" class="figure {size}" {words}></div>'

    def tabs(self, panels: Mapping[str, str]) -> None:
        """Append panels of markup, by label, with buttons to choose one; print shows all."""
        start = len(self.parts)
        buttons, bodies = [], []
        for index, (label, body) in enumerate(panels.items()):
            name = f'panel{start}_{index}'
            on, hidden = ('true', '') if index == 0 else ('false', ' hidden')
            buttons.append(
                f'<button type="button" role="tab" aria-selected="{on}" data-panel="{name}">'
                f'{escape(label)}</button>'
            )
            heading = f'<h3>{escape(label)}</h3>' if len(panels) > 1 else ''
            bodies.append(f'<div class="panel" id="{name}"{hidden}>{heading}{body}</div>')
        if len(panels) > 1:
            self.add(f'<div class="tabs" role="tablist">{"".join(buttons)}</div>')
        self.add(''.join(bodies))

    def table(
        self,
        columns: Sequence[str],
        rows: Sequence[Sequence[object]],
        *,
        numbers: Sequence[int] = (),
        bold: Sequence[int] = (),
    ) -> None:
        """Append a table; numbers: columns set to the right; bold: rows that stand out."""

        def cells(tag: str, row: Sequence[object]) -> str:
            return ''.join(
                f'<{tag}{" class=number" if i in numbers else ""}>{escape(cell)}</{tag}>'
                for i, cell in enumerate(row)
            )

        body = ''
        for index, row in enumerate(rows):
            body += f'<tr{" class=in" if index in bold else ""}>{cells("td", row)}</tr>'
        self.add(
            f'<div class="scroll"><table><thead><tr>{cells("th", columns)}</tr></thead>'
            f'<tbody>{body}</tbody></table></div>'
        )

    def facts(self, facts: Mapping[str, object]) -> None:
        """Append a list of names and values."""
        body = ''.join(f'<dt>{escape(k)}</dt><dd>{escape(v)}</dd>' for k, v in facts.items())
        self.add(f'<dl class="facts">{body}</dl>')

    def write(self, path: Path) -> None:
        """Write the page as one file, usable offline; RecordingError if it cannot be written."""
        colors = {color: name for name, color in COLORS.items()}
        content = {'figures': self.figures, 'colors': colors}
        data = json.dumps(content, ensure_ascii=False, allow_nan=False)
        plotly = f'<script>{get_plotlyjs()}</script>\n' if self.figures else ''
        script = (_HERE / 'script.js').read_text(encoding='utf-8')
        write_whole(
            path,
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            '<meta name="color-scheme" content="light dark">'
            f'<title>{escape(self.title)}</title><style>{_STYLE}</style></head>\n<body><main>'
            '<noscript><p>The plots need JavaScript; text and tables do not.</p></noscript>'
            + '\n'.join(self.parts)
            + '</main>\n<script type="application/json" id="figures">'
            + data.replace('</', '<\\/')
            + f'</script>\n{plotly}<script>{script}</script>'
            '</body></html>\n',
        )
