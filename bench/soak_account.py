"""
Where every sample of a soak has gone: sums by the numbers in the samples, and checks of them.

Each sample carries the device's own number, so what a bag lacks is known one by one. The checks
set these sums against the counters of the nodes, which know nothing of the numbers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.int64]
_OPEN, _RECORDED, _WITHHELD, _INSIDE = 0, 1, 2, 3
_REASONS = {
    'killed': 'not written yet when the recorder was killed',
    'stopped': 'on the way when the recorder was stopped',
    'disk full': 'came after the disk was full',
}
NO_RECORDER, UNMATCHED = 'no recorder ran', 'the new recorder was not matched yet'


@dataclass(frozen=True)
class BagRows:
    """
    What one bag holds of a stream, in the order of the file.

    begun and ended: samples that had been measured when its recorder was ready, and when it was
    told to end or could not go on. kept: rows that a reader gives out, the others having stamps
    that run backwards.
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
    """What the node counted: complete samples, lost by its counters, not trusted, no room, out."""

    received: int
    lost: int
    unsettled: int
    dropped: int
    published: int


@dataclass(frozen=True)
class Check:
    """Two ways to the same number."""

    name: str
    one: int
    other: int

    @property
    def closes(self) -> bool:
        """Whether they agree."""
        return self.one == self.other


@dataclass
class Account:
    """Rows of samples by what became of them, and the checks."""

    stream: str
    measured: int
    rows: dict[str, int] = field(default_factory=dict)
    recorded: int = 0
    left_out: int = 0
    checks: list[Check] = field(default_factory=list)

    @property
    def closes(self) -> bool:
        """Whether all sums agree."""
        return all(check.closes for check in self.checks)

    def content(self) -> dict[str, object]:
        """For a file."""
        checks = [{**asdict(check), 'closes': check.closes} for check in self.checks]
        return {
            'measured': self.measured,
            'rows': self.rows,
            'recorded': self.recorded,
            'left_out_on_reading': self.left_out,
            'checks': checks,
            'closes': self.closes,
        }


def account(
    stream: str,
    measured: int,
    withheld: Mapping[str, Sequence[int]],
    counters: Counters,
    bags: Sequence[BagRows],
) -> Account:
    """
    The account of a stream of the DAQ.

    withheld: numbers of samples that never went on the wire, by reason.
    """
    found = Account(stream, measured)
    fate = np.full(measured, _OPEN, np.int8)
    for why, numbers in withheld.items():
        fate[np.asarray(numbers, np.int64)] = _WITHHELD
        found.rows[why] = len(numbers)
    strange, twice = _enter(bags, fate)
    gone = sum(found.rows.values())
    on_wire = measured - gone
    heard = counters.received + counters.lost
    found.rows['lost on the wire'] = on_wire - counters.received
    found.rows['stamps not trusted yet'] = counters.unsettled
    found.rows['no room in the queue of the DAQ'] = counters.dropped
    between, inside, before = _missing(bags, fate)
    found.rows |= between
    early = min(before, counters.unsettled)
    rejected_later = counters.unsettled - early + counters.dropped
    found.rows[UNMATCHED] = found.rows.get(UNMATCHED, 0) + before - early
    on_wire_later = found.rows['lost on the wire']
    found.rows['lost in DDS'] = inside - rejected_later - on_wire_later
    found.recorded = int(np.count_nonzero(fate == _RECORDED))
    found.left_out = sum(len(bag.numbers) - bag.kept for bag in bags)
    down = sum(between.values()) + before - early
    found.checks = [
        Check('measured = received + lost, by the counters of the DAQ', measured, heard),
        Check(
            'received = published + not trusted + no room',
            counters.received,
            counters.published + counters.unsettled + counters.dropped,
        ),
        Check(
            'published = recorded + no recorder + DDS',
            counters.published,
            found.recorded + down + found.rows['lost in DDS'],
        ),
        Check(
            'measured = recorded + all rows', measured, found.recorded + sum(found.rows.values())
        ),
        Check('rows with a number that was never measured, or withheld', strange, 0),
        Check('rows with a number that is there already', twice, 0),
        *_by_sequence(bags),
        *_by_recorder(bags),
    ]
    return found


def supply_account(measured: int, readings: int, excuses: int, bags: Sequence[BagRows]) -> Account:
    """
    The account of the bench supply: questions that it answered.

    readings: answers that the node counted. excuses: connections lost and answers that were none,
    each of which may have cost one answer.
    """
    found = Account('supply', measured)
    fate = np.full(measured, _OPEN, np.int8)
    strange, twice = _enter(bags, fate)
    between, inside, before = _missing(bags, fate)
    never = measured - readings
    found.rows['answered, and the line was cut'] = never
    found.rows |= between
    found.rows[UNMATCHED] = found.rows.get(UNMATCHED, 0) + before
    found.rows['lost in DDS'] = inside - min(never, inside)
    late = never - min(never, inside)
    if late:
        found.rows[NO_RECORDER] = found.rows.get(NO_RECORDER, 0) - late
    found.recorded = int(np.count_nonzero(fate == _RECORDED))
    found.left_out = sum(len(bag.numbers) - bag.kept for bag in bags)
    unrecorded = sum(between.values()) + before - late
    found.checks = [
        Check(
            'readings = recorded + no recorder + DDS',
            readings,
            found.recorded + unrecorded + found.rows['lost in DDS'],
        ),
        Check(
            'measured = recorded + all rows', measured, found.recorded + sum(found.rows.values())
        ),
        Check('answers lost without a lost connection', max(never - excuses, 0), 0),
        Check('rows with a number that was never measured', strange, 0),
        Check('rows with a number that is there already', twice, 0),
    ]
    return found


def _sum(found: Account) -> Check:
    total = found.recorded + sum(found.rows.values())
    return Check('measured = recorded + all rows', found.measured, total)


def _enter(bags: Sequence[BagRows], fate: NDArray[np.int8]) -> tuple[int, int]:
    """Mark what is recorded; rows with impossible numbers, and with one that was there."""
    strange = twice = 0
    for bag in bags:
        good = (bag.numbers >= 0) & (bag.numbers < len(fate))
        strange += int(np.count_nonzero(~good))
        numbers, counts = np.unique(bag.numbers[good], return_counts=True)
        twice += int((counts - 1).sum())
        strange += int(np.count_nonzero(fate[numbers] == _WITHHELD))
        twice += int(np.count_nonzero(fate[numbers] == _RECORDED))
        fate[numbers] = _RECORDED
    return strange, twice


def _missing(bags: Sequence[BagRows], fate: NDArray[np.int8]) -> tuple[dict[str, int], int, int]:
    """Open samples between bags by reason, inside of bags, and before the first."""
    between: dict[str, int] = {}
    inside = 0
    filled = [bag for bag in bags if len(bag.numbers)]
    if not filled:
        return {NO_RECORDER: int(np.count_nonzero(fate == _OPEN))}, 0, 0
    begins = [int(bag.numbers.min()) for bag in filled]
    ends = [int(bag.numbers.max()) for bag in filled]
    before = int(np.count_nonzero(fate[: begins[0]] == _OPEN))
    for index, bag in enumerate(filled):
        inside += int(np.count_nonzero(fate[begins[index] : ends[index]] == _OPEN))
        last = index + 1 == len(filled)
        gap_end = len(fate) if last else begins[index + 1]
        ready = len(fate) if last else filled[index + 1].begun
        numbers = ends[index] + 1 + np.flatnonzero(fate[ends[index] + 1 : gap_end] == _OPEN)
        reasons = np.where(
            numbers < bag.ended,
            _REASONS[bag.how],
            np.where(numbers < ready, NO_RECORDER, UNMATCHED),
        )
        for reason, count in zip(*np.unique(reasons, return_counts=True), strict=True):
            between[str(reason)] = between.get(str(reason), 0) + int(count)
    return between, inside, before


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
        if bag.recorder_came is None or bag.sequence is None:
            continue
        gaps = int((np.diff(bag.sequence) - 1).clip(min=0).sum())
        checks.append(
            Check(
                f'{bag.name}: rows = what the recorder counted',
                len(bag.numbers),
                bag.recorder_came,
            )
        )
        checks.append(Check(f'{bag.name}: gaps = losses it counted', gaps, bag.recorder_lost or 0))
    return checks


def markdown(accounts: Sequence[Account]) -> str:
    """All accounts as one table, and the checks as another."""
    reasons = list(dict.fromkeys(why for found in accounts for why in found.rows))
    head = '| samples | ' + ' | '.join(found.stream for found in accounts) + ' |'
    lines = [head, '|---|' + '---:|' * len(accounts)]
    lines.append(
        _row('**measured by the device**', [f'**{found.measured:,}**' for found in accounts])
    )
    lines += [
        _row(why, [f'{found.rows[why]:,}' if why in found.rows else '' for found in accounts])
        for why in reasons
        if any(found.rows.get(why) for found in accounts)
    ]
    lines.append(_row('**recorded**', [f'**{found.recorded:,}**' for found in accounts]))
    lines.append(
        _row(
            'of these not read back, the clock having been stepped back',
            [f'{found.left_out:,}' for found in accounts],
        )
    )
    sums = [found.measured - found.recorded - sum(found.rows.values()) for found in accounts]
    lines.append(_row('**unaccounted for**', [f'**{rest:,}**' for rest in sums]))
    lines += ['', '| check | stream | one way | the other | |', '|---|---|---:|---:|---|']
    for found in accounts:
        lines += [
            f'| {check.name} | {found.stream} | {check.one:,} | {check.other:,} | '
            f'{"closes" if check.closes else "**open**"} |'
            for check in found.checks
        ]
    return '\n'.join(lines) + '\n'


def _row(name: str, cells: Sequence[str]) -> str:
    return f'| {name} | ' + ' | '.join(cells) + ' |'
