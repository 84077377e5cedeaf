"""Shares of effects in the power of drives, types of drives and the robot."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite
from typing import Any, Final

import numpy as np
from power_estimator.effects.signals.prepared import WHOLE
from power_estimator.effects.signals.reducer import REDUCED_RATE
from rich import box
from rich.console import Console
from rich.table import Table

from power_lab.budget.levers import Lever
from power_lab.budget.tally import ELECTRONICS, UNEXPLAINED, Tally, interval

FAMILIES: Final[Mapping[str, tuple[str, str, tuple[str, ...]]]] = {
    'shaft': ('work on the joints', '#0072B2', ('shaft',)),
    'regeneration': ('given back by the joints', '#56B4E9', ('regeneration',)),
    'copper': (
        'copper and cables',
        '#D55E00',
        ('copper_loss', 'winding_heating', 'saturation', 'line_resistance'),
    ),
    'gear': (
        'friction, spring and rotor',
        '#E69F00',
        (
            *('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'load_friction'),
            *('cogging', 'rotor_inertia', 'spring'),
        ),
    ),
    'iron': ('iron', '#F0E442', ('iron_loss', 'field_weakening')),
    'inverter': ('inverter', '#CC79A7', ('inverter_loss',)),
    'burnt': ('braking power burnt', '#882255', ('regeneration_efficiency', 'regeneration_limit')),
    'idle': ('idle', '#009E73', ('idle',)),
    'losses': ('losses of the drives', '#AA4499', ('losses',)),  # of models that do not say which
    'drives': ('drives', '#332288', ('drives',)),  # without a model
    'electronics': ('electronics', '#A6A6A6', ('electronics',)),
    'other': ('other effects and meter', '#999933', ()),
    'unexplained': ('unexplained', 'none', ('unexplained',)),
}
"""Words, colour for the colour-blind, and effects of each; `other` has all that no family has."""


def family_of(effect: str) -> str:
    """The family of a part."""
    return next((name for name, (_, _, own) in FAMILIES.items() if effect in own), 'other')


_JOULES = 3600.0


@dataclass(frozen=True)
class Share:
    """Mean power of one part of a member's budget in one phase."""

    drive: str  # or a type of drives, or `robot`
    phase: str
    effect: str
    mean_w: float
    interval: tuple[float, float]  # 90 %
    share: float | None  # of the member's metered energy; None where nothing was metered or drawn
    energy_wh: float


@dataclass(frozen=True)
class BudgetDifference:
    """Power that a part of a recording's budget draws more than that of another."""

    recording: str
    against: str
    drive: str
    phase: str
    effect: str
    mean_w: float
    interval: tuple[float, float]  # 90 %


@dataclass(frozen=True)
class Account:
    """Budget of one recording, or of several as one: tallies by drive, type and robot."""

    name: str
    tallies: Mapping[str, Tally]
    phases: tuple[str, ...]

    @property
    def first(self) -> str:
        """The robot, or its only drive."""
        return WHOLE if WHOLE in self.tallies else next(iter(self.tallies))

    def shares(self, member: str, phase: str = 'all') -> list[Share]:
        """Parts of a member's budget in a phase, what is unexplained last."""
        tally, place = self.tallies[member], self.phases.index(phase)
        means, limits = tally.means[0], interval(tally.means)
        rows = tally.counts[0] / tally.drives
        if not rows[place]:
            return []
        whole = float(means[0, -1] * rows[0])
        found = []
        for part, effect in enumerate(tally.rows[:-1]):
            mean = float(means[place, part])
            if np.isfinite(mean):
                share = mean * float(rows[place]) / whole if whole > 0.0 else None
                low, high = limits[place, part].tolist()
                energy = mean * float(rows[place]) / REDUCED_RATE / _JOULES
                found.append(Share(member, phase, effect, mean, (low, high), share, energy))
        return found

    def rows(self) -> Iterator[Share]:
        """Parts of all members in all phases; electronics are the robot's alone."""
        for member in self.tallies:
            for phase in self.phases:
                for found in self.shares(member, phase):
                    if found.effect != ELECTRONICS or member == WHOLE:
                        yield found

    def power(self, phase: str = 'all') -> tuple[float, tuple[float, float]]:
        """Metered W of the robot in a phase, with its interval."""
        means = self.tallies[self.first].means[:, self.phases.index(phase), -1]
        low, high = interval(means).tolist()
        return float(means[0]), (low, high)

    @property
    def unexplained_w(self) -> float:
        """W of the robot."""
        return next(s.mean_w for s in self.shares(self.first) if s.effect == UNEXPLAINED)

    @property
    def energy_wh(self) -> float:
        """Metered energy of the robot over the rows that count."""
        tally = self.tallies[self.first]
        return float(tally.sums[0, 0, -1]) / REDUCED_RATE / _JOULES

    def runtime(self, battery: float) -> dict[str, dict[str, Any]]:
        """Hours by phase from a battery in Wh; phases that draw nothing are left out."""
        found = {}
        for phase in self.phases:
            watts, (low, high) = self.power(phase)
            if watts > 0.0:
                longest = battery / low if low > 0.0 else None
                found[phase] = {'hours': battery / watts, 'interval': [battery / high, longest]}
        return found

    def json(self) -> dict[str, Any]:
        """Plain values."""
        metered, _ = self.power()
        return {
            'rows': [vars(row) for row in self.rows()],
            'total_w': metered - self.unexplained_w,
            'metered_w': metered,
            'unexplained_w': self.unexplained_w,
            'energy_wh': self.energy_wh,
        }


_WIDTH = 100
_COLUMNS = 6  # members or phases side by side


def in_words(name: str) -> str:
    """A part's name for readers."""
    return name.replace('_', ' ')


def headline(account: Account, levers: Sequence[Lever] = ()) -> str:
    """Mean power, its three largest kinds of parts, the best lever, and what is unexplained."""
    watts, _ = account.power()
    shares = account.shares(account.first)
    kinds: dict[str, float] = defaultdict(float)
    for one in shares:
        kinds[family_of(one.effect)] += one.mean_w
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
    """Parts by size, by drive and by phase, levers, hours and differences, as text.

    accounts: of all recordings as one, then of each. battery: Wh.
    """
    made = _of_account(accounts[0])
    if battery:
        made.append(_hours(accounts, battery))
    if differences:
        made.append(_differences(differences, accounts[0].first))
    if levers:
        made.append(_levers(levers))
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
    types = [name for name in members if account.tallies[name].drives > 1]
    phases = [p for p in account.phases if account.shares(first, p)]
    of_phase, title = partial(account.shares, first), f'mean power of {first} in W by phase'
    by_drive = f'mean power in W by {"type, of all its drives" if types else "drive"}'
    made += [_side_by_side(by_drive, some, account.shares) for some in _abreast(types or members)]
    made += [_side_by_side(title, some, of_phase) for some in _abreast(phases)]
    return made


def _parts(account: Account, member: str) -> Table:
    table = _table(f'{member}: {account.energy_wh:.3g} Wh metered', 'W', '90 % interval', 'share')
    for share in sorted(account.shares(member), key=_order):
        low, high = share.interval
        cells = f'{share.mean_w:.2f}', f'{low:.2f} … {high:.2f}', _percent(share.share)
        table.add_row(in_words(share.effect), *cells)
    watts, (low, high) = account.power()
    table.add_row('metered', f'{watts:.2f}', f'{low:.2f} … {high:.2f}', '100 %')
    return table


def _side_by_side(
    title: str, columns: Sequence[str], shares: Callable[[str], list[Share]]
) -> Table:
    table = _table(title, *columns)
    found = {column: {s.effect: s for s in shares(column)} for column in columns}
    every = {s.effect: s for own in found.values() for s in own.values()}
    for effect, _ in sorted(every.items(), key=lambda item: _order(item[1])):
        cells = [f'{own[effect].mean_w:.2f}' if effect in own else '–' for own in found.values()]
        table.add_row(in_words(effect), *cells)
    return table


def _hours(accounts: Sequence[Account], battery: float) -> Table:
    table = _table(f'hours from {battery:g} Wh', 'h', '90 % interval')
    rows: list[tuple[str, dict[str, Any] | None]] = [*accounts[0].runtime(battery).items()]
    if len(accounts) > 2:
        rows += [(one.name, one.runtime(battery).get('all')) for one in accounts[1:]]
    for name, found in rows:
        if found is not None:
            low, high = found['interval']
            ends = f'{low:.2f} … ' + ('∞' if high is None else f'{high:.2f}')
            table.add_row(name, f'{found["hours"]:.2f}', ends)
    return table


def _differences(differences: Sequence[BudgetDifference], member: str) -> Table:
    table = _table(f'against {differences[0].against}', 'W', '90 % interval')
    for one in differences:
        if one.drive == member and one.phase == 'all':
            table.add_row(f'{one.recording}: {in_words(one.effect)}', *_signed(one))
    return table


def _levers(levers: Sequence[Lever]) -> Table:
    table = _table('change of the mean power at the same motion', 'W', '90 % interval')
    for lever in levers:
        table.add_row(lever.change, *_signed(lever))
    return table


def _signed(one: Lever | BudgetDifference) -> tuple[str, str]:
    return f'{one.mean_w:+.2f}', '{:+.2f} … {:+.2f}'.format(*one.interval)


def _table(title: str, *numbers: str) -> Table:
    table = Table(title=title, title_justify='left', box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column('')
    for name in numbers:
        table.add_column(name, justify='right')
    return table


def _abreast(names: Sequence[str]) -> list[Sequence[str]]:
    return [names[start : start + _COLUMNS] for start in range(0, len(names), _COLUMNS)]


def _order(share: Share) -> tuple[bool, float]:
    return share.effect == UNEXPLAINED, -share.mean_w


def _percent(share: float | None) -> str:
    return '–' if share is None else f'{round(100.0 * share, 1) + 0.0:.1f} %'  # no −0.0
