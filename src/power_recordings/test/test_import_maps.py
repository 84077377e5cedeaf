from itertools import pairwise

import numpy as np
import pytest
from power_recordings.importing.channel_group import PositionRates
from power_recordings.importing.map_file import load_map, names, parse_map
from power_recordings.importing.units import conversion
from wattwalk_core.errors import InputError


def test_ready_maps_are_valid():
    assert {'ur_rtde', 'ur_ros2', 'ros_odrive', 'moteus', 'unitree_go2'} < set(names())
    assert {'voraus', 'hebi', 'wattwalk'} < set(names())
    for name in names():
        assert load_map(name).drives


@pytest.mark.parametrize(
    ('unit', 'quantity', 'factor', 'offset'),
    [
        ('rev', 'position', 2 * np.pi, 0),
        ('rpm', 'velocity', 2 * np.pi / 60, 0),
        ('Nm', 'torque', 1, 0),
        ('mNm', 'torque', 1e-3, 0),
        ('degF', 'temperature', 5 / 9, -160 / 9),
        ('K', 'temperature', 1, -273.15),
        ('us', 'time', 1e-6, 0),
        ('kgf.cm', 'torque', 0.0980665, 0),
        ('kg-cm', 'torque', 0.0980665, 0),
        ('oz.in', 'torque', 0.00706155181423, 0),
        ('ft·lbf', 'torque', 1.35581794833, 0),
        ('0.1 V', 'voltage', 0.1, 0),
        ('x1000 rpm', 'velocity', 2000 * np.pi / 60, 0),
        ('V DC', 'voltage', 1, 0),
    ],
)
def test_units_are_converted(unit, quantity, factor, offset):
    found = conversion(unit, quantity)
    assert found.factor == pytest.approx(factor, rel=1e-9)
    assert found.offset == pytest.approx(offset, abs=1e-9)


@pytest.mark.parametrize(
    ('unit', 'quantity'),
    [('counts', 'position'), ('1/s', 'velocity'), ('Wh', 'torque'), ('%', 'torque')],
)
def test_what_has_the_dimension_alone_is_no_unit_of_a_quantity(unit, quantity):
    with pytest.raises(InputError, match=f'unit .{unit}. of {quantity}'):
        conversion(unit, quantity)


def test_a_map_of_others_is_plain_data():
    with pytest.raises(InputError, match='map: drives: expected keys with values'):
        parse_map({'format': 'import/1', 'drives': 5}, 'map')
    with pytest.raises(InputError, match='drives'):
        parse_map({'format': 'import/1', 'drives': {}}, 'map')


def test_rates_of_position_do_not_depend_on_how_rows_come():
    rng = np.random.default_rng(0)
    stamps = np.cumsum(rng.integers(1_900_000, 2_100_000, 1000))
    stamps[500:] += 10**9  # a gap
    turning = np.mod(0.05 * np.arange(1000), 2 * np.pi)  # wraps
    rows = np.stack([rng.normal(size=1000), turning], axis=1)
    whole, parts = PositionRates([1]), PositionRates([1])
    stamps_1, at_once = whole.extend(stamps, rows, final=True)
    edges = [0, 1, 2, 9, 400, 403, 1000]
    pieces = [parts.extend(stamps[a:b], rows[a:b], final=b == 1000) for a, b in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate([s for s, _ in pieces]), stamps_1)
    late = np.arange(1000) > 20  # the first few rows alone tell the period less well
    np.testing.assert_array_equal(np.concatenate([r for _, r in pieces])[late], at_once[late])
    assert np.isnan(at_once[497:503, 2]).all()
    np.testing.assert_allclose(at_once[100:400, 2], 25, rtol=0.06)  # 0.05 rad in 2 ms
