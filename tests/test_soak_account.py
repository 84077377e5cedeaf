"""The account of a soak, on streams small enough to be counted by hand."""

import numpy as np
import pytest
from soak_account import BagRows, Counters, account, markdown, supply_account
from soak_devices import numbered, numbers, told_came, told_lost


def ms(count):
    """Times of measurement of so many samples at 1 kHz."""
    return [0.001 * number for number in range(count)]


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

    Bag 1 holds 5..49 but for 40 and 41, for which the DAQ had no room, killed after 52; the next
    recorder was ready at 60 and matched at 64; it is stopped at the end.
    """
    first = [n for n in range(5, 50) if not 20 <= n < 30 and n not in (40, 41)]
    bags = (
        bag(first, 0, 53, 'killed', 'one'),
        bag(range(64, 100), 60, 100, name='two', kept=30, told=(36, 0)),
    )
    found = account('x', ms(100), {'bus off': range(20, 30)}, Counters(90, 10, 5, 2, 83), bags)
    assert {why: count for why, count in found.rows.items() if count} == {
        'bus off': 10,
        'stamps not trusted yet': 5,
        'not written yet when the recorder was killed': 3,
        'no recorder ran': 7,
        'the new recorder was not matched yet': 4,
        'no room in the queue of the DAQ': 2,
    }
    assert found.recorded == 33 + 36
    assert found.unaccounted == 0
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
    found = account('x', ms(100), {'bus off': range(20, 30)}, counters, bags)
    assert not found.closes
    assert any(check.name.startswith(broken) for check in found.checks if not check.closes)


def test_a_sample_that_is_there_twice_or_never_was_leaves_the_account_open():
    for rows in ([*range(100), 99], [*range(99), 105]):
        found = account('x', ms(100), {}, Counters(100, 0, 0, 0, 100), (bag(rows, 0, 100),))
        assert not found.closes


def test_a_sample_with_the_sequence_or_time_of_another_leaves_the_account_open():
    whole = bag(range(100), 0, 100)
    whole.sequence[50:] += 1
    found = account('x', ms(100), {}, Counters(100, 0, 0, 0, 100), (whole,))
    assert [check.other for check in found.checks if not check.closes] == [0]
    whole = bag(range(100), 0, 100)
    whole.device_time[3] += 1
    assert not account('x', ms(100), {}, Counters(100, 0, 0, 0, 100), (whole,)).closes


def open_checks(found):
    return [check.name for check in found.checks if not check.closes]


INSIDE = 'missing inside of bags, counted by no node'
STREAMS = ('electrical', 'joints', 'supply')


def account_of(stream, measured, bags):
    """An account of nodes that counted no loss at all, in which one number is one ms."""
    if stream == 'supply':
        return supply_account(ms(measured), measured, 0, bags)
    return account(stream, ms(measured), {}, Counters(measured, 0, 0, 0, measured), bags)


def silent(numbers, ended, how='stopped', begun=0):
    """A bag of a stream whose samples have no sequence."""
    numbers = np.array(numbers, np.int64)
    return BagRows('bag', numbers, begun, ended, how, len(numbers))


@pytest.mark.parametrize('stream', STREAMS)
@pytest.mark.parametrize('lacking', [1, 5000])
def test_a_bag_that_lacks_samples_inside_does_not_close(stream, lacking):
    numbers = [n for n in range(20_000) if not 7000 <= n < 7000 + lacking]
    found = account_of(stream, 20_000, (silent(numbers, 20_000),))
    assert found.unaccounted == lacking
    assert open_checks(found) == [INSIDE]


@pytest.mark.parametrize('stream', STREAMS)
@pytest.mark.parametrize(
    ('how', 'most'), [('killed', 1000), ('stopped', 1000), ('disk full', 5000)]
)
def test_the_end_of_a_bag_may_cost_so_much_and_no_more(stream, how, most):
    for lacking, closes in ((most - 1, True), (most + 2, False)):
        bags = (silent(range(20_000 - lacking), 20_000, how),)
        found = account_of(stream, 20_000, bags)
        assert found.unaccounted == 0
        assert found.closes is closes
        assert len(open_checks(found)) == (not closes)


def test_what_an_end_may_cost_is_a_time_however_fast_the_samples_came():
    """The device was late, and made up for it at 5 kHz; then 1 s lacks 5000 samples."""
    fast = [0.0002 * number for number in range(20_000)]
    counters = Counters(20_000, 0, 0, 0, 20_000)
    for lacking, closes in ((4990, True), (5010, False)):
        bags = (silent(range(20_000 - lacking), 20_000, 'killed'),)
        assert account('x', fast, {}, counters, bags).closes is closes


def test_the_limit_is_of_each_bag_and_not_of_all_together():
    bags = [silent(range(b, b + 400), b + 1000, 'killed', b) for b in (0, 1000, 2000)]
    assert account_of('joints', 3000, bags).closes
    bags[1] = silent((), 2000, 'stopped', 1000)
    assert account_of('joints', 3000, bags).rows['the new recorder was not matched yet'] == 1000


def test_a_recorder_that_hears_nothing_for_long_does_not_pass_for_none():
    bags = (silent(range(5000), 5000), silent((), 10_000, begun=5000))
    found = account_of('joints', 10_000, bags)
    assert found.rows['no recorder ran'] == 0
    assert not found.closes


def test_a_count_of_a_node_that_no_missing_sample_bears_out_does_not_close():
    """300 are said to be dropped, and all are recorded."""
    counters = Counters(1000, 0, 0, 300, 700)
    found = account('x', ms(1000), {}, counters, (silent(range(1000), 1000),))
    assert found.unaccounted == -300
    assert open_checks(found) == [INSIDE]


def test_a_row_below_zero_leaves_the_account_open():
    """The device measured 1000, and the node says that 1010 came: 10 fewer than none were lost."""
    found = account(
        'x', ms(1000), {}, Counters(1010, -10, 0, 10, 1000), (silent(range(1000), 1000),)
    )
    assert found.unaccounted == 0
    assert open_checks(found) == ['rows below zero']


def test_losses_that_the_recorder_did_not_see_leave_the_account_open():
    numbers = [n for n in range(100) if n != 50]
    for told, closes in (((99, 1), True), ((99, 0), False), ((100, 1), False)):
        bags = (bag(numbers, 0, 100, told=told),)
        assert account('x', ms(100), {}, Counters(100, 0, 0, 1, 99), bags).closes is closes


@pytest.mark.parametrize('stream', STREAMS)
def test_a_bag_with_fewer_rows_than_its_recorder_counted_leaves_the_account_open(stream):
    rows = BagRows('bag', np.arange(990), 0, 1000, 'stopped', 990, recorder_came=1000)
    assert open_checks(account_of(stream, 1000, (rows,))) == [
        'bag: rows = what the recorder counted'
    ]


def test_without_a_bag_nothing_is_recorded_and_the_sums_still_close():
    found = account('x', ms(50), {}, Counters(50, 0, 0, 0, 50), ())
    assert found.recorded == 0
    assert found.rows['no recorder ran'] == 50
    assert found.closes


def test_an_answer_of_the_supply_may_be_lost_with_a_connection_only():
    rows = BagRows('bag', np.array([0, 1, 2, 4, 5], np.int64), 0, 6, 'stopped', 5)
    assert supply_account(ms(6), 5, 1, (rows,)).closes
    assert not supply_account(ms(6), 5, 0, (rows,)).closes
    lost = supply_account(ms(6), 6, 0, (rows,))
    assert lost.unaccounted == 1
    assert not lost.closes


def test_an_answer_that_was_cut_at_the_very_end_is_not_counted_twice():
    rows = BagRows('bag', np.arange(99), 0, 100, 'stopped', 99)
    found = supply_account(ms(100), 99, 1, (rows,))
    assert {why: count for why, count in found.rows.items() if count} == {
        'answered, and the line was cut': 1
    }
    assert found.closes


@pytest.mark.parametrize(
    ('said', 'came', 'lost'),
    [
        ('all 1200 samples of drive_supply came', 1200, 0),
        ('drive_supply lost 7 samples in 2 places (1193 came)', 1193, 7),
        ('Killed', None, None),
    ],
)
def test_what_a_recorder_said_at_its_end_is_read(said, came, lost):
    said = f'recording to x\n/joint_states                  480 messages     400.0 Hz\n{said}\n'
    assert (told_came(said, 'drive_supply'), told_lost(said)) == (came, lost)
    assert (told_came(said, 'joint_states'), told_came(said, 'supply')) == (480, None)


def test_numbers_survive_the_wire_as_digits():
    for number in (0, 7, 99, 100, 1_799_999, 99_999_999):
        for unit, step in ((0.1, 0.00125), (0.01, 2e-6)):
            wire = np.round(numbered(number, 12, unit) / step) * step
            assert numbers(np.float32(wire)[None], unit).tolist() == [number]
    assert numbers(np.float32([[0.01, -0.02, 0.0, 0.0]]), 0.01).tolist() == [-1]


def test_the_table_says_what_is_unaccounted_for():
    """100 measured and received, of which the bag holds 90 and lacks 40 to 49 inside."""
    numbers = [n for n in range(100) if not 40 <= n < 50]
    table = markdown([account_of('joints', 100, (silent(numbers, 100),))])
    assert '| **measured by the device** | **100** |' in table
    assert '| **recorded** | **90** |' in table
    assert '| **unaccounted for** | **10** |' in table
    assert f'| {INSIDE} | joints | 10 | 0 | **open** |' in table
    assert table.count('**open**') == 1


def test_the_table_says_what_an_end_cost_and_the_most_that_it_may():
    table = markdown([account_of('joints', 100, (silent(range(97), 100),))])
    assert '| on the way when the recorder was stopped | 3 |' in table
    assert '| **unaccounted for** | **0** |' in table
    assert 'worst, and what 1 s are | joints | 3 | ≤ 100 | closes |' in table
    assert '**open**' not in table
