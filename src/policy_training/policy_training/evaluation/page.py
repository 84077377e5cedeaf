"""The evaluation as one HTML file that needs no network."""

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from plotly.offline import get_plotlyjs
from plotly.utils import PlotlyJSONEncoder
from wattwalk_core.files import write_whole

from policy_training.evaluation import figures as pictures
from policy_training.evaluation.figures import PARTS, Figure
from policy_training.evaluation.gait_cycle import Cycle

_STYLE: Final = Path(__file__).parent / 'page.css'
_SECURITY: Final = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    'img-src data: blob:; font-src data:'
)
_SCRIPT: Final = """
for (const [id, figure] of Object.entries(JSON.parse(document.getElementById('data').textContent)))
  Plotly.newPlot(id, figure.data, figure.layout, {responsive: true, displayModeBar: false});
document.body.dataset.ready = 'yes';
"""


class Page:
    """Grows from top to bottom."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._parts = [f'<h1>{html.escape(title)}</h1>']
        self._figures: dict[str, Figure] = {}

    def heading(self, text: str) -> None:
        """A section begins."""
        self._parts.append(f'<h2>{html.escape(text)}</h2>')

    def text(self, text: str) -> None:
        """A paragraph."""
        self._parts.append(f'<p>{html.escape(text)}</p>')

    def figure(self, figure: Figure, label: str, height: int = 380) -> None:
        """A plot, with words for those who cannot see it."""
        name = f'figure{len(self._figures)}'
        self._figures[name] = figure
        self._parts.append(
            f'<div id="{name}" role="img" aria-label="{html.escape(label)}" '
            f'style="height:{height}px"></div>'
        )

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """A table; all but the first two columns hold numbers."""
        head = ''.join(f'<th>{html.escape(column)}</th>' for column in columns)
        body = ''.join(
            '<tr>' + ''.join(f'<td>{html.escape(_text(cell))}</td>' for cell in row) + '</tr>'
            for row in rows
        )
        self._parts.append(
            f'<div class="scroll"><table><thead><tr>{head}</tr></thead>'
            f'<tbody>{body}</tbody></table></div>'
        )

    def write(self, path: Path) -> None:
        """One file, whole or not at all."""
        data = json.dumps(self._figures, cls=PlotlyJSONEncoder, ensure_ascii=False)
        write_whole(
            path,
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta http-equiv="Content-Security-Policy" content="{_SECURITY}">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<title>{html.escape(self._title)}</title>'
            f'<style>{_STYLE.read_text(encoding="utf-8")}</style></head>\n<body><main>'
            '<noscript><p>The plots need JavaScript; text and tables do not.</p></noscript>'
            + '\n'.join(self._parts)
            + '</main>\n<script type="application/json" id="data">'
            + data.replace('</', '<\\/')
            + f'</script>\n<script>{get_plotlyjs()}</script><script>{_SCRIPT}</script>'
            '</body></html>\n',
        )


def write_page(
    path: Path,
    result: Mapping[str, Any],
    cycles: Mapping[str, Mapping[str, Cycle]],
    curves: Mapping[str, Sequence[Mapping[str, float]]],
) -> None:
    """
    Write the page of an evaluation.

    result: as in its JSON. cycles: by task, then by policy. curves: of training, by policy.
    """
    entries = result['policies']
    page = Page('What the policies draw')
    for sentence in result['verdict']:
        page.text(sentence)
    page.heading('Power by where it goes')
    page.text(
        'Mean over steady walking. Supply is measured where the battery would be; electronics is '
        'what of it does not reach the drives, idle what the drives draw at rest, and each joint '
        'type what its four drives draw beyond that. The bar across is the estimate.'
    )
    page.figure(pictures.power_bars(entries), 'power of each policy on each task, by parts')
    page.table(
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
    page.table(
        ('policy', 'task', 'vx off m/s', 'vy off m/s', 'yaw off rad/s', 'steady s'),
        [
            (e['name'], e['task'], *(e['tracking'][k] for k in ('vx', 'vy', 'yaw')), e['steady_s'])
            for e in entries
        ],
    )
    page.figure(pictures.front(entries), 'supply power against tracking error')
    if result['trials']:
        page.heading('Robots on rough ground, pushed, under changing commands')
        page.table(
            ('policy', 'robots', 'falls', 'vx off m/s', 'vy off m/s', 'yaw off rad/s', 'follows'),
            [
                (
                    *(name, t['robots'], t['falls']),
                    *(t['mean_error'][key] for key in ('vx', 'vy', 'yaw')),
                    'yes' if t['following'] else 'no',
                )
                for name, t in result['trials'].items()
            ],
        )
    page.heading('The gait')
    page.table(
        (
            *('policy', 'task', 'stride s', 'swing s', 'stance s', 'impact N', 'loudness dB'),
            *('torque rms N·m', 'KFE speed rms rad/s', 'KFE torque above 20 Hz'),
        ),
        [_gait_row(e) for e in entries if e.get('gait')],
    )
    for task, found in cycles.items():
        if found:
            page.text(f'Mean gait cycle of LF_KFE on {task}; shaded: the foot is on the ground.')
            label = f'gait cycle of LF_KFE on {task}'
            page.figure(pictures.gait_cycles(found), label, height=820)
    if any(curves.values()):
        page.heading('Training')
        page.figure(pictures.learning_curves(curves), 'learning curves', height=520)
    page.write(path)


def _gait_row(entry: Mapping[str, Any]) -> tuple[object, ...]:
    gait, smooth = entry['gait'], entry['smoothness']
    return (
        *(entry['name'], entry['task'], gait['stride_s'], gait['swing_s'], gait['stance_s']),
        *(gait['impact_n'], gait['impact_rate_db'], smooth['torque_rms_nm']),
        *(smooth['kfe_velocity_rms'], smooth['kfe_torque_above_20_hz']),
    )


def _text(cell: object) -> str:
    if cell is None:
        return '–'
    if isinstance(cell, float):
        return f'{cell:.0f}' if abs(cell) >= 100 else f'{cell:.2f}'
    return str(cell)
