from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from power_recordings.alignment.align import load_aligned, merge
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.messages import cdr
from wattwalk_core.errors import InputError

Make = Callable[..., Any]


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


def test_recordings_are_joined_and_stay_apart(walk: Make, tmp_path: Path) -> None:
    first = walk(3.0)
    first.drop_supply(slice(1500, 1501))
    second = walk(2.0)
    second.current[:] = 5.0
    second.topics['/foot_force'] = (
        cdr.JOINT_STATE,
        second.joint_stamps,
        cdr.in_a_list(
            cdr.joint_state_block(second.joint_stamps, ['LF_FOOT'], effort=np.ones((800, 1)))
        ),
    )
    paths = [first.write(tmp_path / 'a'), second.write(tmp_path / 'b')]
    data = load_aligned(paths)
    assert data.recordings == (str(paths[0]), str(paths[1]))
    assert [data.segment[part][0] for part in data.segments()] == [0, 1, 2]
    assert (data.recording == (data.segment == 2)).all()
    np.testing.assert_allclose(data.power[data.recording == 1], 240, rtol=1e-5)
    assert np.isnan(data.extras['foot_force'][data.recording == 0]).all()
    assert np.isfinite(data.extras['foot_force'][data.recording == 1]).any()
    assert any(note.startswith(str(paths[0])) for note in data.notes)


def test_recordings_of_different_rates_are_not_joined() -> None:
    other = replace(dataset(), rate=400.0, recordings=('b',))
    with pytest.raises(InputError, match='a and b: aligned at 200 Hz and 400 Hz'):
        merge([dataset(), other])


def test_recordings_of_different_joints_are_joined_only_where_told(
    walk: Make, tmp_path: Path
) -> None:
    a = walk(1.0).write(tmp_path / 'a')
    names = ('LF_KFE', 'LF_HFE', 'RF_HAA')
    b = walk(1.0, names=names, drive_names=names).write(tmp_path / 'b')
    with pytest.raises(InputError, match=r'has the joints LF_HAA.*has LF_KFE.*name those'):
        load_aligned([a, b])
    data = load_aligned([a, b], drives=['LF_HFE', 'LF_KFE'])
    assert data.names == ('LF_HFE', 'LF_KFE')
    with pytest.raises(InputError, match='no recording given'):
        load_aligned([])
