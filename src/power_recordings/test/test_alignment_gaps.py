"""Gaps in what was recorded end a segment; a sample that is lost alone is bridged."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from power_recordings.alignment.stream import Stream
from synthetic_walk import aligned, seconds, spans, wave
from wattwalk_core.errors import InputError

Make = Callable[..., Any]
ANTIALIAS_HALF = 0.0195  # s: 39 taps at 1 kHz
SMOOTHING_HALF = 0.0425  # s: 35 taps at 400 Hz


def test_a_gap_in_the_joint_states_ends_a_segment(walk: Make, tmp_path: Path) -> None:
    sketch = walk(4.0)
    sketch.drop_joints(slice(800, 880))  # 2.0 s to 2.2 s
    data = aligned(sketch, tmp_path)
    (_, end), (start, _) = spans(data)
    assert end == pytest.approx(1.9975 - SMOOTHING_HALF, abs=0.006)
    assert start == pytest.approx(2.2 + SMOOTHING_HALF, abs=0.003)
    assert data.segment.tolist() == sorted(data.segment.tolist())
    assert 'joint_states: 1 gaps, 0.203 s in all' in ' '.join(data.notes)


def test_a_gap_in_the_electrical_samples_ends_a_segment(walk: Make, tmp_path: Path) -> None:
    sketch = walk(4.0)
    sketch.current[2000:] = 99.0
    sketch.drop_supply(slice(2000, 2100))
    data = aligned(sketch, tmp_path)
    (_, end), (start, _) = spans(data)
    edge = ANTIALIAS_HALF + SMOOTHING_HALF
    assert end == pytest.approx(1.999 - edge, abs=0.006)
    assert start == pytest.approx(2.1 + edge, abs=0.006)
    # Nothing of what came after the gap has leaked to before it.
    np.testing.assert_allclose(data.current[data.segment == 0], 2, rtol=1e-5)
    np.testing.assert_allclose(data.current[data.segment == 1], 99, rtol=1e-5)
    assert 'drive_supply: 100 samples missing in 1 places' in ' '.join(data.notes)


def test_one_missing_sequence_number_ends_a_segment(walk: Make, tmp_path: Path) -> None:
    sketch = walk(3.0)
    sketch.drop_supply(slice(1500, 1501))
    data = aligned(sketch, tmp_path)
    assert len(spans(data)) == 2


def test_one_missing_joint_state_is_no_gap(walk: Make, tmp_path: Path) -> None:
    sketch = walk(3.0)
    sketch.position[:] = wave(sketch.joint_time, 3)
    sketch.drop_joints(slice(600, 601))
    data = aligned(sketch, tmp_path, smooth=False, rate=400.0)
    assert len(spans(data)) == 1
    expected = wave(seconds(data)[:, None], 3) + 0 * data.position
    np.testing.assert_allclose(data.position, expected, atol=2e-3)


def test_a_sample_of_bad_status_and_several_of_nan_are_gaps(walk: Make, tmp_path: Path) -> None:
    sketch = walk(5.0)
    sketch.current[1500, 0] = 900.0
    sketch.status[1500, 0] = 4
    sketch.current[3000:3003, 2] = np.nan
    sketch.effort[1600:1602, 1] = np.nan  # 4.0 s
    data = aligned(sketch, tmp_path)
    assert len(spans(data)) == 4
    np.testing.assert_allclose(data.power, 96, rtol=1e-5)
    notes = ' '.join(data.notes)
    assert 'drive_supply: 1 samples of bad status cut out' in notes
    assert 'drive_supply: 3 samples with NaN cut out' in notes
    assert 'joint_states: 2 samples with NaN cut out' in notes


def test_a_sample_of_nan_is_bridged_as_a_lost_one_is(walk: Make, tmp_path: Path) -> None:
    sketch = walk(5.0)
    sketch.current[3000, 2] = np.nan
    sketch.effort[1600, 1] = np.nan
    data = aligned(sketch, tmp_path)
    assert len(spans(data)) == 1
    np.testing.assert_allclose(data.power, 96, rtol=1e-5)


def test_a_sample_apart_stays_apart_where_it_is_bad() -> None:
    time, values = np.arange(8.0), np.arange(8.0, dtype=np.float32)[:, None]
    bad, apart = np.zeros(8, np.bool_), np.zeros(8, np.bool_)
    bad[[0, 3]] = apart[3] = True
    found = Stream.of(time, values, bad, apart)
    assert found.time.tolist() == [1, 2, 4, 5, 6, 7]
    assert (found.starts.tolist(), found.stops.tolist()) == ([0, 2], [2, 6])
    none = Stream.of(time, values, np.ones(8, np.bool_))
    assert (len(none.starts), len(none.stops)) == (0, 0)


def test_drives_that_are_never_read_together_are_refused_in_words(
    walk: Make, tmp_path: Path
) -> None:
    sketch = walk(2.0)
    sketch.current[::2, 0] = sketch.current[1::2, 2] = np.nan
    with pytest.raises(InputError, match='drive_supply'):
        aligned(sketch, tmp_path)


def test_bad_samples_of_a_drive_that_is_not_wanted_do_not_matter(
    walk: Make, tmp_path: Path
) -> None:
    sketch = walk(2.0)
    sketch.status[1000, 0] = 4
    sketch.effort[:, 0] = np.nan
    data = aligned(sketch, tmp_path, drives=['LF_KFE', 'LF_HFE'])
    assert data.names == ('LF_KFE', 'LF_HFE')
    assert len(spans(data)) == 1


def test_a_drive_that_is_mostly_bad_counts_as_not_measured(walk: Make, tmp_path: Path) -> None:
    sketch = walk(2.0)
    sketch.status[:1500, 1] = 8
    data = aligned(sketch, tmp_path)
    assert data.measured_drives() == ('LF_HAA', 'LF_KFE')
    assert np.isnan(data.power[:, 1]).all()
    assert len(spans(data)) == 1
    assert '75% of the samples of LF_HFE are bad' in ' '.join(data.notes)


def test_segments_too_short_for_the_filters_are_dropped_and_reported(
    walk: Make, tmp_path: Path
) -> None:
    sketch = walk(3.0)
    sketch.drop_supply([1500, 1560, 1620])
    data = aligned(sketch, tmp_path)
    assert len(spans(data)) == 2
    assert '2 stretches under' in ' '.join(data.notes)


def test_stamps_that_ran_backwards_are_not_bridged(walk: Make, tmp_path: Path) -> None:
    sketch = walk(3.0)
    sketch.late = lambda times: np.arange(len(times)) * 1000
    sketch.joint_stamps[600:] -= 100_000_000
    sketch.supply_stamps[1500:] -= 100_000_000
    data = aligned(sketch, tmp_path)
    (_, end), (start, _) = spans(data)
    assert end < 1.5 < start
    assert 'run backwards' in ' '.join(data.notes)
