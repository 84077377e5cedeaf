import numpy as np
import pytest
from power_recordings.alignment.dataset import AlignedDataset


def dataset() -> AlignedDataset:
    grid = np.arange(12, dtype=np.float32).reshape(6, 2)
    power = grid.copy()
    power[:, 1] = np.nan
    return AlignedDataset(
        rate=200.0,
        names=('LF_HAA', 'LF_KFE'),
        time=np.arange(6) / 200,
        segment=np.array([0, 0, 0, 1, 1, 2], np.int32),
        position=grid,
        velocity=grid,
        torque=grid,
        command=grid + 1,
        power=power,
        voltage=grid,
        current=grid,
        temperature=grid,
        supply=grid[:, 0],
        recordings=('a',),
        recording=np.zeros(6, np.int32),
        extras={'foot_force': np.ones((6, 4), np.float32)},
        notes=('a: whole',),
    )


def test_segments_are_slices_between_the_borders() -> None:
    assert list(dataset().segments()) == [slice(0, 3), slice(3, 5), slice(5, 6)]


def test_rows_take_all_arrays_along() -> None:
    rows = dataset().rows(slice(1, 4))
    assert len(rows.time) == len(rows.supply) == len(rows.extras['foot_force']) == 3
    assert rows.position.tolist() == [[2, 3], [4, 5], [6, 7]]
    assert rows.notes == ('a: whole',)
    none = dataset().rows(np.zeros(6, bool))
    assert list(none.segments()) == []


def test_drives_are_taken_by_name_in_the_order_asked_for() -> None:
    swapped = dataset().drives(['LF_KFE', 'LF_HAA'])
    assert swapped.names == ('LF_KFE', 'LF_HAA')
    assert swapped.torque[0].tolist() == [1, 0]
    assert swapped.supply.tolist() == dataset().supply.tolist()
    with pytest.raises(KeyError, match="no drive 'RF_HAA'; there are LF_HAA, LF_KFE"):
        dataset().drives(['RF_HAA'])


def test_measured_drives_are_those_with_any_power() -> None:
    assert dataset().measured_drives() == ('LF_HAA',)
    assert dataset().position_error.tolist() == np.ones((6, 2)).tolist()
