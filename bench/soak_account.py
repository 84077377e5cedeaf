"""Account of every sample of a soak: sums by the numbers in the samples, and their checks.

Each sample carries the device's own number, so what a bag lacks is known one by one. Samples
that are missing inside a bag have to be those that a node counted; what is missing between bags
has to lie where no recorder ran, or within what each kind of end may cost.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

Numbers = NDArray[np.int64]
_OPEN, _RECORDED, _WITHHELD = 0, 1, 2
_REASONS = {
    'killed': 'not written yet when the recorder was killed',
    'stopped': 'on the way when the recorder was stopped',
    'disk full': 'came after the disk was full',
}
NO_RECORDER, UNMATCHED = 'no recorder ran', 'the new recorder was not matched yet'
_MOST = {
    _REASONS['killed']: 1.0,
    _REASONS['stopped']: 1.0,
    _REASONS['disk full']: 5.0,
    UNMATCHED: 2.0,
}  # s of samples at one end of one bag


@dataclass(frozen=True)
class BagRows:
    """Rows of a stream in one bag, in the order of the file.

    begun, ended: samples measured before its recorder was ready, and before its end was requested
    or forced. kept: rows that a reader returns, without those whose stamps run backwards.
    """

    name: str
    numbers: Numbers
    begun: int
    ended: int
    how: str  # killed, stopped or disk full
    kept: int
    sequence: Numbers | None = None
    device_time: Numbers | None = None
    recorder_came: int | None = None  # by the recorder's own count, where it told
    recorder_lost: int | None = None


@dataclass(frozen=True)
class Counters:
    """Sample counters of the node.

    unsettled: samples without trusted stamps; dropped: those for which there was no room.
    """

    received: int
    lost: int
    unsettled: int
    dropped: int
    published: int


@dataclass(frozen=True)
class Check:
    """Comparison of two numbers that must be equal; with at_most, `other` is an upper limit."""

    name: str
    one: int
    other: int
    at_most: bool = False

    @property
    def closes(self) -> bool:
        """True if the comparison holds."""
        return self.one <= self.other if self.at_most else self.one == self.other


@dataclass
class Account:
    """Number of missing samples by reason (`rows`), and checks.

    recorded: samples in bags; left_out: of these, those that a reader leaves out.
    """

    stream: str
    measured: int
    rows: dict[str, int] = field(default_factory=dict)
    recorded: int = 0
    left_out: int = 0
    checks: list[Check] = field(default_factory=list)

    @property
    def unaccounted(self) -> int:
        """Number of samples that are missing without a reason.

        What is missing inside bags beyond what nodes counted: lost in DDS, or by the recorder.
        """
        return self.measured - self.recorded - sum(self.rows.values())

    @property
    def closes(self) -> bool:
        """True if all sums agree."""
        return all(check.closes for check in self.checks)

    def content(self) -> dict[str, object]:
        """Return the account as a mapping for a JSON file."""
        checks = [{**asdict(check), 'closes': check.closes} for check in self.checks]
        return {
            'measured': self.measured,
            'rows': self.rows,
            'recorded': self.recorded,
            'unaccounted': self.unaccounted,
            'left_out_on_reading': self.left_out,
            'checks': checks,
            'closes': self.closes,
        }


def account(
    stream: str,
    times: Sequence[float],
    withheld: Mapping[str, Sequence[int]],
    counters: Counters,
    bags: Sequence[BagRows],
) -> Account:
    """Return the account of a stream of the DAQ.

    times: when each sample was measured, s on a steady clock. withheld: numbers of samples that
    never went on the wire, by reason.
    """
    measured = len(times)
    found = Account(stream, measured)
    fate = np.full(measured, _OPEN, np.int8)
    for why, numbers in withheld.items():
        fate[np.asarray(numbers, np.int64)] = _WITHHELD
        found.rows[why] = len(numbers)
    entries = _enter(bags, fate)
    on_wire = measured - sum(found.rows.values())
    found.rows['lost on the wire'] = on_wire - counters.received
    found.rows['stamps not trusted yet'] = counters.unsettled
    found.rows['no room in the queue of the DAQ'] = counters.dropped
    at_ends = _at_ends(bags, fate)
    if bags:
        # Stamps are not trusted when a device is first heard, which is when the first bag begins.
        first = at_ends[0]
        first[UNMATCHED] = max(first.get(UNMATCHED, 0) - counters.unsettled, 0)
    found.checks = [
        Check(
            'measured = received + lost, by the counters of the DAQ',
            measured,
            counters.received + counters.lost,
        ),
        Check(
            'received = published + not trusted + no room',
            counters.received,
            counters.published + counters.unsettled + counters.dropped,
        ),
        *entries,
    ]
    _close(found, fate, bags, at_ends, np.asarray(times))
    return found


def supply_account(
    times: Sequence[float], readings: int, excuses: int, bags: Sequence[BagRows]
) -> Account:
    """Return the account of the bench supply, whose samples are answers to queries.

    times: of the answers, s on a steady clock. readings: answers that the node counted. excuses:
    lost connections and invalid answers, each of which may have cost one answer.
    """
    measured = len(times)
    found = Account('supply', measured)
    fate = np.full(measured, _OPEN, np.int8)
    entries = _enter(bags, fate)
    never = measured - readings
    found.rows['answered, and the line was cut'] = never
    at_ends = _at_ends(bags, fate)
    # Which answers were cut is not known: those inside of bags first, then the last.
    elsewhere = max(never - _inside(bags, fate), 0)
    for end in reversed(at_ends):
        for reason, count in end.items():
            end[reason] = count - min(elsewhere, count)
            elsewhere -= count - end[reason]
    cut = Check('answers cut, and what may have cut them', never, excuses, at_most=True)
    found.checks = [cut, *entries]
    _close(found, fate, bags, at_ends, np.asarray(times))
    return found


def _close(
    found: Account,
    fate: NDArray[np.int8],
    bags: Sequence[BagRows],
    at_ends: Sequence[Mapping[str, int]],
    times: Floats,
) -> None:
    """Enter what is recorded, and what is missing at the ends of bags; add the checks of both."""
    for part in at_ends:
        for reason, count in part.items():
            found.rows[reason] = found.rows.get(reason, 0) + count
    found.recorded = int(np.count_nonzero(fate == _RECORDED))
    found.left_out = sum(len(bag.numbers) - bag.kept for bag in bags)
    found.checks += [
        Check('missing inside of bags, counted by no node', found.unaccounted, 0),
        Check('rows below zero', sum(count < 0 for count in found.rows.values()), 0),
        *_within(bags, at_ends, times),
        *_by_sequence(bags),
        *_by_recorder(bags),
    ]


def _within(
    bags: Sequence[BagRows], at_ends: Sequence[Mapping[str, int]], times: Floats
) -> list[Check]:
    """For each reason the bag of which most is missing beyond what was measured in so long."""
    worst: dict[str, Check] = {}
    for bag, missing in zip(bags, at_ends, strict=False):
        for reason, count in missing.items():
            if reason == UNMATCHED:
                until = times[bag.begun : bag.begun + 1] + _MOST[reason]
                most = int(np.searchsorted(times, until, 'right').sum()) - bag.begun
            else:
                since = times[max(bag.ended - 1, 0) : bag.ended] - _MOST[reason]
                most = bag.ended - int(np.searchsorted(times, since, 'right').sum())
            name = f'{reason}: worst, and what {_MOST[reason]:g} s are'
            check, before = Check(name, count, most, at_most=True), worst.get(reason)
            if count and (before is None or count - most > before.one - before.other):
                worst[reason] = check
    return list(worst.values())


def _enter(bags: Sequence[BagRows], fate: NDArray[np.int8]) -> list[Check]:
    """Mark what is recorded; check for rows with impossible numbers, and that were there."""
    strange = twice = 0
    for bag in bags:
        good = (bag.numbers >= 0) & (bag.numbers < len(fate))
        strange += int(np.count_nonzero(~good))
        numbers, counts = np.unique(bag.numbers[good], return_counts=True)
        twice += int((counts - 1).sum())
        strange += int(np.count_nonzero(fate[numbers] == _WITHHELD))
        twice += int(np.count_nonzero(fate[numbers] == _RECORDED))
        fate[numbers] = _RECORDED
    return [
        Check('rows with a number that was never measured, or withheld', strange, 0),
        Check('rows with a number that is there already', twice, 0),
    ]


def _inside(bags: Sequence[BagRows], fate: NDArray[np.int8]) -> int:
    """Number of open samples between the first and the last row of a bag."""
    filled = [bag.numbers for bag in bags if len(bag.numbers)]
    return sum(
        int(np.count_nonzero(fate[max(rows.min(), 0) : rows.max() + 1] == _OPEN))
        for rows in filled
    )


def _at_ends(bags: Sequence[BagRows], fate: NDArray[np.int8]) -> list[dict[str, int]]:
    """Open samples outside of the rows of bags by reason, for each bag, and last those of no bag.

    A bag accounts for what was measured from when its recorder was ready until it was ended.
    """
    outside = fate == _OPEN
    for bag in bags:
        if len(bag.numbers):
            outside[max(bag.numbers.min(), 0) : bag.numbers.max() + 1] = False
    at_ends = []
    for bag in bags:
        numbers = bag.begun + np.flatnonzero(outside[bag.begun : bag.ended])
        outside[bag.begun : bag.ended] = False
        late = int(np.count_nonzero(numbers > bag.numbers.max())) if len(bag.numbers) else 0
        at_ends.append({UNMATCHED: len(numbers) - late, _REASONS[bag.how]: late})
    return [*at_ends, {NO_RECORDER: int(np.count_nonzero(outside))}]


def _by_sequence(bags: Sequence[BagRows]) -> list[Check]:
    told = [bag for bag in bags if bag.sequence is not None and len(bag.numbers)]
    if not told:
        return []
    offsets = np.concatenate([bag.numbers - bag.sequence for bag in told])
    times = np.concatenate([bag.device_time - 1_000_000 * bag.numbers for bag in told])
    return [
        Check(
            'samples whose sequence is not the count of the device',
            int((offsets != offsets[0]).sum()),
            0,
        ),
        Check('samples with the device time of another', int(np.count_nonzero(times)), 0),
    ]


def _by_recorder(bags: Sequence[BagRows]) -> list[Check]:
    checks = []
    for bag in bags:
        if bag.recorder_came is not None:
            name = f'{bag.name}: rows = what the recorder counted'
            checks.append(Check(name, len(bag.numbers), bag.recorder_came))
        if bag.recorder_lost is not None and bag.sequence is not None:
            gaps = int((np.diff(bag.sequence) - 1).clip(min=0).sum())
            name = f'{bag.name}: gaps = losses it counted'
            checks.append(Check(name, gaps, bag.recorder_lost))
    return checks


def markdown(accounts: Sequence[Account]) -> str:
    """Return Markdown with a table of all accounts and a table of the checks."""
    reasons = list(dict.fromkeys(why for found in accounts for why in found.rows))

    def row(name: str, cell: Callable[[Account], str]) -> str:
        return f'| {name} | ' + ' | '.join(map(cell, accounts)) + ' |'

    def of_reason(why: str) -> str:
        return row(why, lambda found: f'{found.rows[why]:,}' if why in found.rows else '')

    lines = [row('samples', lambda found: found.stream), '|---|' + '---:|' * len(accounts)]
    lines.append(row('**measured by the device**', lambda found: f'**{found.measured:,}**'))
    lines += [of_reason(why) for why in reasons if any(f.rows.get(why) for f in accounts)]
    lines.append(row('**recorded**', lambda found: f'**{found.recorded:,}**'))
    back = 'of these not read back, the clock having been stepped back'
    lines.append(row(back, lambda found: f'{found.left_out:,}'))
    lines.append(row('**unaccounted for**', lambda found: f'**{found.unaccounted:,}**'))
    lines += ['', '| check | stream | one way | the other | |', '|---|---|---:|---:|---|']
    for found in accounts:
        lines += [
            f'| {check.name} | {found.stream} | {check.one:,} | '
            f'{"≤ " if check.at_most else ""}{check.other:,} | '
            f'{"closes" if check.closes else "**open**"} |'
            for check in found.checks
        ]
    return '\n'.join(lines) + '\n'
