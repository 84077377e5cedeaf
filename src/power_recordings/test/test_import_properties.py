"""Properties of conversion, merging and clocks, on drawn numbers."""

import contextlib
import csv
import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from power_recordings.commands.arguments import import_logs as main
from power_recordings.importing.channel_group import Merger
from power_recordings.importing.map_file import parse_map
from power_recordings.importing.times import LogClock
from power_recordings.importing.units import SI, conversion
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

UNITS = {
    'position': ('rad', 'deg', 'rev', 'turns', 'mrad', '°'),
    'velocity': ('rad/s', 'deg/s', 'rpm', 'rev/s', 'rps', '1/min'),
    'torque': ('N*m', 'Nm', 'mNm', 'kNm', 'Ncm', 'N m'),
    'voltage': ('V', 'mV', 'kV'),
    'current': ('A', 'mA', 'uA'),
    'power': ('W', 'kW', 'mW', 'V*A'),
    'temperature': ('degC', 'K', 'degF', '°C'),
    'time': ('s', 'ms', 'us', 'µs', 'ns', 'min', 'h'),
}
numbers = st.floats(-1e6, 1e6)


@settings(deadline=None)
@given(st.data(), st.sampled_from(sorted(UNITS)), st.lists(numbers, min_size=2, max_size=5))
def test_a_conversion_is_a_line_and_that_of_the_quantity_itself_is_none(data, quantity, values):
    convert = conversion(data.draw(st.sampled_from(UNITS[quantity])), quantity)
    x = np.array(values)
    assert convert.factor > 0
    np.testing.assert_allclose(
        convert(x) - convert(np.zeros_like(x)), convert.factor * x, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_array_equal(conversion(SI[quantity], quantity)(x), x)


@settings(deadline=None)
@given(st.text(max_size=40), st.sampled_from(sorted(UNITS)))
def test_any_text_is_a_unit_or_is_refused_in_one_line(text, quantity):
    with contextlib.suppress(InputError):
        assert np.isfinite(conversion(text, quantity).factor)
        return
    with pytest.raises(InputError, match='expected one such as') as refused:
        conversion(text, quantity)
    assert '\n' not in str(refused.value)


steps = st.lists(st.integers(1, 5), min_size=1, max_size=60)


@settings(deadline=None)
@given(
    steps,
    steps,
    st.lists(st.integers(0, 60), max_size=6),
    st.lists(st.integers(0, 60), max_size=6),
)
def test_merged_rows_do_not_depend_on_the_blocks_in_which_they_come(first, second, one, other):
    streams = [np.cumsum(np.array(part)) * 1_000_000 for part in (first, second)]
    values = [np.sin(stamps / 3e6)[:, None] for stamps in streams]

    def merged(edges):
        merger = Merger([1, 1])
        for i, stamps in enumerate(streams):
            bounds = [0, *sorted(min(c, len(stamps)) for c in edges[i]), len(stamps)]
            for a, b in pairwise(bounds):
                if b > a:
                    merger.add(i, stamps[a:b], values[i][a:b])
        return merger.take(final=True)

    whole, parts = merged([[], []]), merged([one, other])
    np.testing.assert_array_equal(whole[0], streams[0])
    np.testing.assert_array_equal(parts[0], whole[0])
    np.testing.assert_array_equal(parts[1], whole[1])
    exact = np.isin(streams[0], streams[1])
    np.testing.assert_allclose(whole[1][exact, 1], whole[1][exact, 0])


@settings(deadline=None)
@given(st.lists(st.one_of(st.just(-1), st.integers(0, 10**6)), max_size=80), st.integers(1, 20))
def test_stamps_ascend_whatever_the_times_are(times, block):
    clock = LogClock('log')
    stamps, kept = [], 0
    for start in range(0, len(times), block):
        given = np.array(times[start : start + block], np.int64)
        rows = clock.order(given)
        assert len(rows.starts) == len(rows.stamps) == len(rows.of(given.astype(float)))
        kept += len(rows.stamps)
        stamps += rows.stamps.tolist()
    assert (np.diff(stamps) > 0).all()
    assert kept + clock.missing + clock.repeated + clock.late == len(times)


@settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.lists(st.tuples(numbers, numbers, numbers), min_size=8, max_size=40),
    st.sampled_from(('csv', 'json', 'jsonl', 'h5', 'parquet')),
)
def test_every_kind_of_file_gives_the_same_recording(tmp_path, rows, kind):
    table = np.array(rows)
    assume(np.ptp(table, axis=0).all())
    named = {
        't': np.arange(len(rows)) / 50,
        **{n: table[:, i] for i, n in enumerate(('q', 'w', 'p'))},
    }
    mapping = tmp_path / 'map.yaml'
    mapping.write_text(
        'format: import/1\ntime: {column: t, unit: s}\ndrives:\n  A:\n'
        '    position: {from: q, unit: deg}\n    velocity: {from: w, unit: rpm}\n'
        '    voltage: {value: 10}\n    power: {from: p, unit: mW}\n'
    )
    log = write(tmp_path / f'log.{kind}', named)
    assert main([str(log), '--map', str(mapping), '-o', str(tmp_path / 'bag'), '--overwrite']) == 0
    recording = Recording.open(tmp_path / 'bag')
    joints, drives = recording.joint_states(), recording.drive_supply()
    np.testing.assert_allclose(joints.position[:, 0], np.deg2rad(named['q']), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        joints.velocity[:, 0], named['w'] * 2 * np.pi / 60, rtol=1e-6, atol=1e-9
    )
    np.testing.assert_allclose(drives.power[:, 0], named['p'] / 1e3, rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(np.diff(joints.stamp_ns), 20_000_000)


def write(path, named):
    rows = list(zip(*(v.tolist() for v in named.values()), strict=True))
    if path.suffix == '.csv':
        with path.open('w', newline='') as file:
            csv.writer(file).writerows([list(named), *rows])
    elif path.suffix == '.json':
        path.write_text(json.dumps({k: v.tolist() for k, v in named.items()}))
    elif path.suffix == '.jsonl':
        path.write_text('\n'.join(json.dumps(dict(zip(named, row, strict=True))) for row in rows))
    elif path.suffix == '.h5':
        import h5py

        with h5py.File(path, 'w') as file:
            for name, values in named.items():
                file[name] = values
    else:
        import pyarrow as pa
        from pyarrow import parquet

        parquet.write_table(pa.table(named), path)
    return path


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                (
                    'format',
                    'time',
                    'drives',
                    'supply',
                    'card',
                    'from',
                    'unit',
                    'scale',
                    'position',
                    'a*',
                )
            )
            | st.text(max_size=6),
            inner,
            max_size=4,
        )
    ),
    max_leaves=20,
)


@settings(deadline=None)
@given(plain)
def test_any_content_of_a_map_is_one_or_is_refused_in_one_line(content):
    if isinstance(content, dict):
        content = {'format': 'import/1', 'drives': content, **content}
    with pytest.raises(InputError, match='map') as refused:
        raise InputError('map') if parse_map(content, 'map') else AssertionError
    assert '\n' not in str(refused.value)
