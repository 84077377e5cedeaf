from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from power_recordings.reading.ordering import ascending


def kept(stamps: list[int]) -> list[int]:
    array = np.array(stamps, np.int64)
    return array[ascending(array)].tolist()


@pytest.mark.parametrize(
    ('stamps', 'expected'),
    [
        ([1, 2, 3], [1, 2, 3]),
        ([1, 2, 2, 2, 3], [1, 2, 3]),
        ([1, 2, 3, 4, 99, 5, 6], [1, 2, 3, 4, 5, 6]),
        ([1, 2, 97, 98, 99, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]),
        ([99, 1, 2, 3], [1, 2, 3]),
        ([1, 2, 3, 0, 4, 5], [1, 2, 3, 4, 5]),
        ([1, 2, 3, 4, 5, 3, 4, 5, 6, 7], [1, 2, 3, 4, 5, 6, 7]),
        ([7], [7]),
    ],
)
def test_as_many_as_can_be_are_kept(stamps: list[int], expected: list[int]) -> None:
    assert kept(stamps) == expected


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.lists(st.integers(0, 30), min_size=1, max_size=60))
def test_what_is_kept_ascends_and_one_run_is_never_beaten(stamps: list[int]) -> None:
    result = kept(stamps)
    assert all(a < b for a, b in pairwise(result))
    runs, length = 1, 1
    for before, after in pairwise(stamps):
        length = length + 1 if after > before else 1 if after < before else length
        runs = max(runs, length)
    assert len(result) >= runs


def test_thousands_of_steps_back_are_still_put_in_order() -> None:
    stamps = np.arange(20_000) + np.where(np.arange(20_000) % 4 == 0, 100, 0)
    keep = ascending(stamps)
    assert (np.diff(stamps[keep]) > 0).all()
    assert keep.sum() >= 5000
