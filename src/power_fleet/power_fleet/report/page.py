"""The page of tracking: alarms, each drive's history, and what circumstances explain."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from rich.console import Console
from rich.markup import escape as plain
from rich.table import Table
from wattwalk_core.errors import printable
from wattwalk_core.pages.page import COLORS, Figure, Page, escape, finished, short

from power_fleet.track.change_test import Change
from power_fleet.track.outcome import Tracked
from power_fleet.track.search import CertainChange


def series(found: Tracked, drive: int, column: int, changes: Sequence[Change]) -> Figure:
    """Plot one coefficient (column) of a drive over time with 95 % intervals, and its level."""
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
        begin = dates[profile.first]
        dashed = {'color': COLORS['better'], 'width': 1.5, 'dash': 'dash'}
        figure.add_vline(x=begin, line=dashed)
        figure.add_annotation(
            x=begin,
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


_SHOWN = ('power_gain', 'current_offset', 'torque_bias', 'time_offset')


def write_tracked(path: Path, found: Tracked) -> None:
    """Write the HTML page of `track`."""
    changed = bool(found.alarms)
    title = 'Changed' if changed else 'Steady'
    page = Page(f'{title}: {found.model.name}')
    page.add(f'<p class="kind {"named" if changed else "no_evidence"}">{title}</p>')
    page.add(f'<h1 id="verdict">{escape(found.headline)}</h1>')
    for text in found.alarms:
        page.text(text)
    first = found.histories[0]
    page.facts(
        {
            'Model': found.model.name,
            'Effects': ', '.join(found.model.effects),
            'Recordings': f'{len(first.recordings)}, {first.recordings[0]} to '
            f'{first.recordings[-1]}',
            'Drives': ', '.join(history.drive for history in found.histories),
            'Covariates': ', '.join(first.names) or 'none that vary',
        }
    )
    _section_overview(page, found)
    _section_changes(page, found)
    _section_explained(page, found)
    _section_histories(page, found)
    page.heading('How to read this')
    page.text(
        'A point is the estimate of one recording, as far as it says something, and else that of '
        'the others; its bar is the 95 % interval. Estimates are shown as they are, with the '
        'weather in them; changes are judged with level, slopes by the covariates and scatter of '
        'all estimates of a drive together. The line is the level before and after a change. '
        'Chance alone raises any alarm in at most 5 % of histories without a change: the largest '
        'evidence of all drives, effects and dates is compared with that of the same recordings '
        'in random orders.',
        faint=True,
    )
    page.write(path)


def _section_overview(page: Page, found: Tracked) -> None:
    page.heading('At a glance')
    names = [
        name
        for name in dict.fromkeys(n for own in found.histories for n in own.responses)
        if name in found.model.effects or name in _SHOWN
    ]
    rows, changed = [], []
    for drive, history in enumerate(found.histories):
        sizes = {
            finding.change.hypothesis: found.watts(drive, finding.change)
            for finding in found.result.findings
            if finding.drive == drive
        }
        told = [f'{sizes[name]:+.2f} W' if name in sizes else 'steady' for name in names]
        rows.append([history.drive, *told])
        if sizes:
            changed.append(drive)
    columns = ['drive', *(name.replace('_', ' ') for name in names)]
    page.table(columns, rows, numbers=range(1, len(columns)), bold=changed)


def _section_changes(page: Page, found: Tracked) -> None:
    if not found.result.findings:
        return
    page.heading('What changed')
    rows = []
    for finding in found.result.findings:
        change = finding.change
        *course, end, watts = _cells(found, finding)
        percent = found.percent(finding.drive, change)
        rows.append(
            [
                *course,
                f'{end} ± {1.96 * change.error:.2g} {found.unit(change.hypothesis)}',
                '–' if percent is None else f'{percent:+.0f} %',
                f'{watts} W',
                ', '.join(rival.hypothesis for rival in finding.rivals) or 'nothing',
            ]
        )
    columns = ['drive', 'effect', 'course', 'since', 'from', 'to', 'size', 'power', 'or else']
    page.table(columns, rows, numbers=(4, 5, 6, 7))


def _cells(found: Tracked, finding: CertainChange) -> tuple[str, ...]:
    """Cells on a change: drive, effect, course, since when, the ends in its unit, and watts."""
    change, history = finding.change, found.histories[finding.drive]
    begin, end = found.ends(finding.drive, change)
    return (
        history.drive,
        change.hypothesis,
        'step' if change.profile.step else 'drift',
        history.recordings[change.profile.first],
        f'{begin:.4g}',
        f'{end:.4g}',
        f'{found.watts(finding.drive, change):+.2f}',
    )


def _section_explained(page: Page, found: Tracked) -> None:
    if not found.result.explained and not found.left_out:
        return
    page.heading('What is no wear')
    for text in found.explained:
        page.text(text)
    for text in found.left_out:
        page.text(f'Left out: {text}', faint=True)


def _section_histories(page: Page, found: Tracked) -> None:
    page.heading('History of each drive')
    panels = {}
    for drive, history in enumerate(found.histories):
        body = ''
        changed = [f.change for f in found.result.findings if f.drive == drive]
        named = {change.hypothesis for change in changed}
        for column, (name, term) in enumerate(history.labels):
            if term or not (name in found.model.effects or name in _SHOWN or name in named):
                continue
            own = [change for change in changed if change.hypothesis == name]
            body += f'<h4>{escape(name.replace("_", " "))}</h4>'
            figure = series(found, drive, column, own)
            body += page.figure(figure, f'{name} of {history.drive} over time', size='low')
        panels[history.drive] = body
    page.tabs(panels)


def print_tracked(console: Console, found: Tracked) -> None:
    """Print alarms, what circumstances explain, and the certain changes as a table."""
    for text in found.alarms or [found.sentence]:
        console.print(plain(text), style='bold')
    for text in found.explained:
        console.print(plain(text))
    for text in found.left_out:
        console.print(plain(printable(f'left out: {text}')), style='dim')
    if not found.result.findings:
        return
    table = Table(box=None)
    for name in ('drive', 'effect', 'change', 'since'):
        table.add_column(name, overflow='fold')
    for name in ('from', 'to', 'W', 'certainty'):
        table.add_column(name, justify='right')
    for finding in found.result.findings:
        cells = (plain(printable(cell)) for cell in _cells(found, finding))
        table.add_row(*cells, f'{finding.certainty:.3f}')
    console.print(table)
