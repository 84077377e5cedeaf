"""The page of a budget."""

import io
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from wattwalk_core.figures import style
from wattwalk_core.pages.page import Page, escape

from power_lab.budget.account import Account
from power_lab.budget.budget import Budget
from power_lab.budget.tables import headline, in_words
from power_lab.report.budget_figures import drawn


def write_budget(path: Path, budget: Budget) -> None:
    """The page of `budget`."""
    account = budget.account
    sentence = headline(account, budget.levers)
    page = Page(f'Energy budget: {", ".join(one.name for one in budget.accounts)}')
    page.add('<p class="kind no_evidence">Energy budget</p>')
    page.add(f'<h1 id="verdict">{escape(sentence[0].upper() + sentence[1:])}.</h1>')
    facts = {
        'Recordings': ', '.join(one.name for one in budget.accounts),
        'Metered': f'{account.energy_wh:.3g} Wh',
        'Model': budget.origin,
    }
    if budget.battery:
        hours = account.runtime(budget.battery).get('all')
        if hours is not None:
            facts['Battery'] = f'{budget.battery:g} Wh last {hours["hours"]:.2f} h'
    page.facts(facts)
    page.text(
        'The parts add up to what was metered; what no effect of the model explains is a part of '
        'its own. Intervals are meant to hold nine of ten: they allow for how well the '
        'recording tells the coefficients, for departures from the formulas, and for what changes '
        'from second to second.',
        faint=True,
    )
    with style(dark=False):
        shown = {name: (caption, _svg(figure)) for name, caption, figure in drawn(budget)}
    maps = [one for name, one in shown.items() if name.startswith('efficiency')]
    for caption, markup in (one for one in shown.values() if one not in maps):
        page.heading(caption)
        page.add(_picture(caption, markup))
    if maps:
        page.heading('Efficiency over torque and speed')
        page.add(f'<div class="pair">{"".join(_picture(*one) for one in maps)}</div>')
    page.heading('Parts')
    members = dict.fromkeys((account.first, *account.tallies))
    page.tabs({member: _table(account, member) for member in members})
    _levers(page, budget)
    _differences(page, budget)
    page.write(path)


def _picture(caption: str, markup: str) -> str:
    return f'<div role="img" aria-label="{escape(caption)}">{markup}</div>'


def _svg(figure: Figure) -> str:
    """A figure as markup in the colours of the page."""
    FigureCanvasAgg(figure)
    stream = io.StringIO()
    figure.savefig(stream, format='svg', transparent=True)
    text = stream.getvalue()
    for ink in ('#1a1a1a', '#000000'):
        text = text.replace(ink, 'currentColor')
    start = text.index('<svg')
    width = text.index('viewBox', start)
    return f'<svg style="width:100%;height:auto" {text[width:]}'


def _table(account: Account, member: str) -> str:
    page = Page('')
    rows: list[list[str]] = []
    for phase in account.phases:
        for place, share in enumerate(account.shares(member, phase)):
            low, high = share.interval
            of = '–' if share.share is None else f'{100.0 * share.share:.1f} %'
            watts = f'{share.mean_w:.2f}', f'{low:.2f} … {high:.2f}', of, f'{share.energy_wh:.3g}'
            rows.append(['' if place else phase, in_words(share.effect), *watts])
    columns = ['phase', 'part', 'mean W', '90 % interval', 'share', 'Wh']
    page.table(columns, rows, numbers=(2, 3, 4, 5))
    return ''.join(page.parts)


def _levers(page: Page, budget: Budget) -> None:
    if not budget.levers:
        return
    page.heading('What would change it')
    page.text('Change of the mean power at the same motion of the joints; negative saves.')
    rows = [
        [
            in_words(lever.change),
            f'{lever.mean_w:+.2f} W',
            '{:+.2f} … {:+.2f}'.format(*lever.interval),
        ]
        for lever in budget.levers
    ]
    page.table(['change', 'mean power', '90 % interval'], rows, numbers=(1, 2))
    for reason in budget.refused:
        page.text(f'Not carried over: {reason}.', faint=True)


def _differences(page: Page, budget: Budget) -> None:
    if len(budget.accounts) < 2:
        return
    page.heading(f'Against {budget.accounts[0].name}')
    rows = [
        [
            one.recording,
            in_words(one.effect),
            f'{one.mean_w:+.2f}',
            '{:+.2f} … {:+.2f}'.format(*one.interval),
        ]
        for one in budget.differences
        if one.drive == budget.account.first and one.phase == 'all'
    ]
    page.table(['recording', 'part', 'W', '90 % interval'], rows, numbers=(2, 3))
