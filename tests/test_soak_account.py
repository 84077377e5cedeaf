"""The account of a soak, on streams small enough to be counted by hand."""

import numpy as np
import pytest
from soak_account import BagRows, Counters, account, markdown, supply_account
from soak_devices import current_numbers, numbered, position_numbers


def bag(numbers, begun, ended, how='stopped', name='bag', kept=None, told=None):
    numbers = np.array(numbers, np.int64)
    sequence = numbers.copy()
    return BagRows(
        *(name, numbers, begun, ended, how),
        len(numbers) if kept is None else kept,
        sequence,
        1_000_000 * numbers,
        *(told or (None, None)),
    )


def test_each_sample_has_one_fate_and_the_sums_close():
    """
    100 measured; 20 to 29 while the bus was off; the first 5 not trusted.

    Bag 1 holds 5..49 but for 40 and 41, killed after 52; the next recorder was ready at 60 and
    matched at 64; it is stopped at the end.
    """
    first = [n for n in range(5, 50) if not 20 <= n < 30 and n not in (40, 41)]
    bags = (
        bag(first, 0, 53, 'killed', 'one'),
        bag(range(64, 100), 60, 100, name='two', kept=30, told=(36, 0)),
    )
    found = account('x', 100, {'bus off': range(20, 30)}, Counters(90, 10, 5, 0, 85), bags)
    assert {why: count for why, count in found.rows.items() if count} == {
        'bus off': 10,
        'stamps not trusted yet': 5,
        'not written yet when the recorder was killed': 3,
        'no recorder ran': 7,
        'the new recorder was not matched yet': 4,
        'lost in DDS': 2,
    }
    assert found.recorded == 33 + 36
    assert found.left_out == 6
    assert [check.name for check in found.checks if not check.closes] == []
    assert found.closes


@pytest.mark.parametrize(
    ('counters', 'broken'),
    [
        (Counters(89, 10, 5, 0, 84), 'measured = received + lost'),
        (Counters(90, 10, 5, 0, 84), 'received = published'),
        (Counters(90, 9, 5, 0, 85), 'measured = received + lost'),
    ],
)
def test_a_node_that_miscounts_leaves_the_account_open(counters, broken):
    bags = (bag([n for n in range(5, 100) if not 20 <= n < 30], 0, 100),)
    found = account('x', 100, {'bus off': range(20, 30)}, counters, bags)
    assert not found.closes
    assert any(check.name.startswith(broken) for check in found.checks if not check.closes)


def test_a_sample_that_is_there_twice_or_never_was_leaves_the_account_open():
    for numbers in ([*range(100), 99], [*range(99), 105]):
        found = account('x', 100, {}, Counters(100, 0, 0, 0, 100), (bag(numbers, 0, 100),))
        assert not found.closes


def test_a_sample_with_the_sequence_or_time_of_another_leaves_the_account_open():
    whole = bag(range(100), 0, 100)
    whole.sequence[50:] += 1
    found = account('x', 100, {}, Counters(100, 0, 0, 0, 100), (whole,))
    assert [check.other for check in found.checks if not check.closes] == [0]
    whole = bag(range(100), 0, 100)
    whole.device_time[3] += 1
    assert not account('x', 100, {}, Counters(100, 0, 0, 0, 100), (whole,)).closes


def test_losses_that_the_recorder_did_not_see_leave_the_account_open():
    numbers = [n for n in range(100) if n != 50]
    for told, closes in (((99, 1), True), ((99, 0), False), ((100, 1), False)):
        found = account(
            'x', 100, {}, Counters(100, 0, 0, 0, 100), (bag(numbers, 0, 100, told=told),)
        )
        assert found.rows['lost in DDS'] == 1
        assert found.closes is closes


def test_without_a_bag_nothing_is_recorded_and_the_sums_still_close():
    found = account('x', 50, {}, Counters(50, 0, 10, 0, 40), ())
    assert found.recorded == 0
    assert sum(found.rows.values()) == 50


def test_an_answer_of_the_supply_may_be_lost_with_a_connection_only():
    rows = BagRows('bag', np.array([0, 1, 2, 4, 5], np.int64), 0, 6, 'stopped', 5)
    assert supply_account(6, 5, 1, (rows,)).closes
    assert not supply_account(6, 5, 0, (rows,)).closes
    lost = supply_account(6, 6, 0, (rows,))
    assert lost.rows['lost in DDS'] == 1
    assert lost.closes


def test_numbers_survive_the_wire_as_digits():
    for number in (0, 7, 99, 100, 1_799_999, 99_999_999):
        for read, unit, step in ((current_numbers, 0.1, 0.00125), (position_numbers, 0.01, 2e-6)):
            wire = np.round(numbered(number, 12, unit) / step) * step
            assert read(np.float32(wire)[None]).tolist() == [number]
    assert position_numbers(np.float32([[0.01, -0.02, 0.0, 0.0]])).tolist() == [-1]


def test_the_table_says_what_is_unaccounted_for():
    found = account('x', 100, {}, Counters(90, 0, 0, 0, 90), (bag(range(90), 0, 100),))
    assert '| **unaccounted for** | **0** |' in markdown([found]) or not found.closes
    assert '**open**' in markdown([found])
