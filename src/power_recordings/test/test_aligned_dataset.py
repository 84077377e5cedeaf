from dataclasses import replace

import numpy as np
import pytest
from power_recordings.alignment.dataset import AlignedDataset


def dataset() -> AlignedDataset:
    grid = np.arange(12, dtype=np.float32).reshape(6, 2)
    power = grid.copy()
    power[:, 1] = np.nan
    data = AlignedDataset.blank(
        200.0,
        ('LF_HAA', 'LF_KFE'),
        np.arange(6) / 200,
        'a',
        position=grid,
        torque=grid,
        command=grid + 1,
        power=power,
    )
    return replace(
        data,
        segment=np.array([0, 0, 0, 1, 1, 2], np.int32),
        supply=grid[:, 0],
        extras={'foot_force': np.ones((6, 4), np.float32)},
        notes=('a: whole',),
    )


def test_a_blank_dataset_has_nan_for_all_signals_that_are_not_given() -> None:
    data = AlignedDataset.blank(400.0, ('a', 'b'), [0.0, 1.0], 'bag', torque=3.0)
    assert data.torque.tolist() == [[3, 3], [3, 3]]
    assert data.torque.dtype == data.power.dtype == np.float32
    unknown = (data.position, data.velocity, data.command, data.power, data.voltage, data.current)
    assert all(np.isnan(x).all() and x.shape == (2, 2) for x in unknown)
    assert np.isnan(data.temperature).all()
    assert np.isnan(data.supply).all()
    assert list(data.segments()) == [slice(0, 2)]
    assert data.recordings == ('bag',)
    with pytest.raises(TypeError, match='speed'):
        AlignedDataset.blank(400.0, ('a',), [0.0], 'bag', speed=3.0)


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
