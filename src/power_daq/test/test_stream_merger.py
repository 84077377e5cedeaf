import numpy as np
import pytest
from power_daq.acquisition.stream_merger import CYCLIC, StreamMerger
from power_recordings.importing.channel_group import Merger

MS = 1_000_000


def merge(rows, periods_ms, streams):
    """Rows are (ms, stream, value); return times in ms, numbers and values by stream."""
    merger = StreamMerger(streams, periods_ms * MS, 0.0, CYCLIC)
    found = [r for t, stream, value in rows for r in merger.add(stream, round(t * MS), value)]
    values = [
        [a + w * (b - a) for a, b, w in zip(r.left, r.right, r.weight, strict=True)] for r in found
    ]
    return [r.time / MS for r in found], [r.number for r in found], np.array(values), merger


def test_values_are_those_that_an_import_of_the_same_rows_would_have():
    rng = np.random.default_rng(0)
    kept, rows = [], []
    for stream, (period, offset) in enumerate([(10, 0.0), (10.07, 3.0), (5, 1.0)]):
        times = np.arange(offset, 4000, period)
        times += rng.uniform(-0.4, 0.4, len(times))
        keep = rng.random(len(times)) > 0.05
        keep[100:110] = stream == 0
        times = times[keep]
        kept.append(times)
        rows += [(t, stream, np.sin(t / 300) + stream) for t in times]
    times, _, values, _ = merge(sorted(rows), 10, 3)
    merger = Merger([1, 1, 1])
    for stream, own in enumerate(kept):
        stamps = np.rint(own * MS).astype(np.int64)
        merger.add(stream, stamps, np.sin(own / 300)[:, None] + stream)
    stamps, expected = merger.take(final=True)
    chosen = np.isin(stamps, np.rint(np.array(times) * MS).astype(np.int64))
    assert len(times) > 300
    np.testing.assert_allclose(values, expected[chosen], atol=1e-9)


def test_rows_wait_until_every_other_stream_has_come_past_them():
    merger = StreamMerger(2, 10 * MS, 0.0)
    assert merger.add(0, 0, 1.0) == []
    assert merger.add(1, 5 * MS, 3.0) == []
    assert merger.add(0, 10 * MS, 2.0) == []
    (row,) = merger.add(1, 15 * MS, 4.0)
    assert (row.time, row.left, row.right, row.weight) == (
        10 * MS,
        [2.0, 3.0],
        [2.0, 4.0],
        [1, 0.5],
    )


def test_a_stream_that_never_comes_is_not_waited_for_longer_than_five_periods():
    times, _, values, merger = merge([(10.0 * k, 0, 1.0) for k in range(20)], 10, 2)
    assert times[0] == 0.0
    assert len(times) == 20
    assert np.isnan(values[:, 1]).all()
    assert merger.silent(190 * MS) == [1]
    assert not merger.seen(1)


def test_the_next_stream_takes_over_while_the_reference_is_silent():
    rows = [(10.0 * k, 0, 1.0) for k in range(100) if not 30 <= k < 70]
    rows += [(10.0 * k + 4, 1, 2.0) for k in range(100)]
    times, _, values, merger = merge(sorted(rows), 10, 2)
    assert (np.diff(times) > 0).all()
    assert np.diff(times).max() <= 34
    assert np.isfinite(values[:, 1]).all()
    gap = (np.array(times) > 300) & (np.array(times) < 700)
    assert np.isnan(values[gap, 0]).all()
    assert merger.missing == [40, 0]


def test_a_row_close_by_stands_beside_a_gap_where_it_may():
    merger = StreamMerger(2, 10 * MS, 0.0, CYCLIC, 0.5)
    times = [0, 10, 20, 80, 90, 100]
    found = [
        row
        for t in times
        for stream, at in ((0, t), (1, t + 1))
        for row in merger.add(stream, at * MS, float(t + stream))
    ]
    assert [row.time // MS for row in found] == [10, 20, 80, 90, 100]
    assert not np.isnan([row.weight for row in found]).any()
    assert found[1].right == [20.0, 21.0]


def test_numbers_skip_what_the_reference_lost_and_a_row_out_of_order_is_left_out():
    rows = [(10.0 * k, 0, 1.0) for k in range(50) if k not in (20, 21)]
    times, numbers, _, merger = merge([*rows, (400.0, 0, 9.0)], 10, 1)
    assert numbers == [k for k in range(50) if k not in (20, 21)]
    assert (merger.lost, merger.out_of_order) == (2, 1)
    assert len(times) == 48


@pytest.mark.parametrize('period', [2.0, 40.0])
def test_the_period_is_learned_where_the_nominal_one_is_wrong(period):
    rows = [(period * k, 0, 1.0) for k in range(200)]
    rows += [(period * k + 0.3 * period, 1, 2.0) for k in range(200)]
    _, numbers, values, merger = merge(sorted(rows), 10, 2)
    assert np.isfinite(values[10:]).all()
    assert (np.diff(numbers)[10:] == 1).all()
    assert merger.lost <= 12
