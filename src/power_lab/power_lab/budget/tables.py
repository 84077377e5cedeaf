"""Budgets as tables to print."""

from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from functools import partial
from math import isfinite
from typing import Any

from power_estimator.effects.signals.prepared import WHOLE
from rich import box
from rich.console import Console
from rich.table import Table

from power_lab.budget.account import Account, BudgetDifference, Share
from power_lab.budget.families import FAMILIES, family_of
from power_lab.budget.levers import Lever
from power_lab.budget.tally import ELECTRONICS, UNEXPLAINED

_WIDTH = 100
_COLUMNS = 6  # members or phases side by side


def in_words(name: str) -> str:
    """Name of a part with spaces for underscores."""
    return name.replace('_', ' ')


def by_family(account: Account, member: str) -> dict[str, float]:
    """Mean power of a drive, drive type or the robot by family of effects, W."""
    found: dict[str, float] = defaultdict(float)
    for share in account.shares(member):
        if share.effect != ELECTRONICS or member == WHOLE:
            found[family_of(share.effect)] += share.mean_w
    return found


def headline(account: Account, levers: Sequence[Lever] = ()) -> str:
    """Sentence with the mean power, its largest parts, the unexplained share, the best lever."""
    watts, _ = account.power()
    shares = account.shares(account.first)
    kinds = by_family(account, account.first)
    del kinds[UNEXPLAINED]
    largest = sorted(kinds, key=lambda kind: -kinds[kind])
    named = [kind for kind in largest if kinds[kind] > 0.0][:3]
    if watts <= 0.0:  # what a brake gives back has no shares
        named = []
    parts = ', '.join(f'{FAMILIES[kind][0]} {_percent(kinds[kind] / watts)}' for kind in named)
    which = 'the robot' if account.first == WHOLE else account.first
    said = f'{which} draws {watts:.1f} W'
    said += f': {parts}; {_unexplained(shares, watts)} is unexplained' if named else ''
    sure = [one for one in levers if one.interval[1] < 0.0 and ',' not in one.change]
    if not sure:
        return said
    best = min(sure, key=lambda one: one.mean_w)
    name, _, factor = best.change.partition('=')
    if name == 'payload':
        name = 'weight to carry'
    elif name == 'idle' and 'idle' not in {one.effect for one in shares}:
        name = ELECTRONICS  # a robot with one meter
    by = 100.0 * (float(factor) - 1.0)
    change = f'{abs(by):.3g} % {"less" if by < 0.0 else "more"}'
    return f'{said}; {change} {in_words(name)} saves most, {-best.mean_w:.1f} W'


def _unexplained(shares: Sequence[Share], watts: float) -> str:
    """Per cent of the power that is unexplained, with its interval where there is one."""
    (rest,) = (one for one in shares if one.effect == UNEXPLAINED)
    low, high = (100.0 * end / watts for end in rest.interval)
    between = f' ({low:.0f} … {high:.0f} %)' if isfinite(high - low) else ''
    return f'{_percent(rest.mean_w / watts)}{between}'


def tables(
    sentence: str,
    model: str,
    accounts: Sequence[Account],
    differences: Sequence[BudgetDifference],
    levers: Sequence[Lever],
    refused: Sequence[str],
    battery: float | None,
) -> str:
    """Render a budget as text: parts, drives, phases, battery hours, differences and levers.

    sentence, model: the first two lines; accounts: all recordings pooled, then each; refused: why
    levers are missing; battery: Wh, None for no hours.
    """
    made = _of_account(accounts[0])
    if battery:
        made.append(_hours(accounts, battery))
    if differences:
        made.append(ruled_table(f'against {differences[0].against}', ('', 'W', '90 % interval')))
        for one in differences:
            if one.drive == accounts[0].first and one.phase == 'all':
                made[-1].add_row(f'{one.recording}: {in_words(one.effect)}', *signed_w(one))
    if levers:
        title = 'change of the mean power at the same motion'
        made.append(ruled_table(title, ('', 'W', '90 % interval')))
        for lever in levers:
            made[-1].add_row(lever.change, *signed_w(lever))
    console = Console(width=_WIDTH, highlight=False)
    with console.capture() as found:
        for line in (sentence, f'model: {model}'):
            console.print(line, markup=False)
        for table in made:
            console.print(table)
        for reason in refused:
            console.print(f'not carried over: {reason}', markup=False)
    return found.get().rstrip()


def _of_account(account: Account) -> list[Table]:
    first = account.first
    made = [_parts(account, first)]
    members = [name for name in account.tallies if name != first]
    types = any(account.tallies[name].drives > 1 for name in members)
    shown = account.groups if types else members
    phases = [p for p in account.phases if account.shares(first, p)]
    of_phase, title = partial(account.shares, first), f'mean power of {first} in W by phase'
    by_drive = f'mean power in W by {"type, of all its drives" if types else "drive"}'
    made += [_side_by_side(by_drive, some, account.shares) for some in _abreast(shown)]
    made += [_side_by_side(title, some, of_phase) for some in _abreast(phases)]
    return made


def _parts(account: Account, member: str) -> Table:
    title = f'{member}: {account.energy_wh:.3g} Wh metered'
    table = ruled_table(title, ('', 'W', '90 % interval', 'share'))
    for share in sorted(account.shares(member), key=_order):
        table.add_row(in_words(share.effect), *share_cells(share))
    watts, (low, high) = account.power()
    table.add_row('metered', f'{watts:.2f}', f'{low:.2f} … {high:.2f}', '100 %')
    return table


def _side_by_side(
    title: str, columns: Sequence[str], shares: Callable[[str], list[Share]]
) -> Table:
    table = ruled_table(title, ('', *columns))
    found = {column: {s.effect: s for s in shares(column)} for column in columns}
    every = {s.effect: s for own in found.values() for s in own.values()}
    for effect, _ in sorted(every.items(), key=lambda item: _order(item[1])):
        cells = [f'{own[effect].mean_w:.2f}' if effect in own else '–' for own in found.values()]
        table.add_row(in_words(effect), *cells)
    return table


def _hours(accounts: Sequence[Account], battery: float) -> Table:
    table = ruled_table(f'hours from {battery:g} Wh', ('', 'h', '90 % interval'))
    rows: list[tuple[str, dict[str, Any] | None]] = [*accounts[0].runtime(battery).items()]
    if len(accounts) > 2:
        rows += [(one.name, one.runtime(battery).get('all')) for one in accounts[1:]]
    for name, found in rows:
        if found is not None:
            low, high = found['interval']
            ends = f'{low:.2f} … ' + ('∞' if high is None else f'{high:.2f}')
            table.add_row(name, f'{found["hours"]:.2f}', ends)
    return table


def share_cells(share: Share) -> tuple[str, str, str]:
    """Mean power in W, its interval and its share, as cells of a table."""
    low, high = share.interval
    return f'{share.mean_w:.2f}', f'{low:.2f} … {high:.2f}', _percent(share.share)


def signed_w(one: Lever | BudgetDifference) -> tuple[str, str]:
    """Change of the mean power in W with its sign, and its interval, as cells of a table."""
    return f'{one.mean_w:+.2f}', '{:+.2f} … {:+.2f}'.format(*one.interval)


def ruled_table(title: str, columns: Sequence[str], left: Collection[str] = ('',)) -> Table:
    """An empty table; left: columns of text, as numbers are set to the right."""
    table = Table(title=title, title_justify='left', box=box.SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        table.add_column(name, justify='left' if name in left else 'right')
    return table


def _abreast(names: Sequence[str]) -> list[Sequence[str]]:
    return [names[start : start + _COLUMNS] for start in range(0, len(names), _COLUMNS)]


def _order(share: Share) -> tuple[bool, float]:
    return share.effect == UNEXPLAINED, -share.mean_w


def _percent(share: float | None) -> str:
    return '–' if share is None else f'{round(100.0 * share, 1) + 0.0:.1f} %'  # no −0.0
