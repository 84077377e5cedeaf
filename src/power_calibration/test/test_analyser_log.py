from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from power_calibration.analyser.log import Log
from wattwalk_core.errors import InputError

ROWS = 200
TIME = np.arange(ROWS) * 0.001
VOLTS = 48.0 - 0.5 * np.sin(0.31 * np.arange(ROWS))
AMPS = 1.0 + np.sin(0.17 * np.arange(ROWS))


def write(path, *, head='Time,U,I', delimiter=',', comma=False, stamp='{:.6f}', times=None):
    times = [stamp.format(t) for t in TIME] if times is None else times
    lines = [head] if head else []
    for t, v, a in zip(times, VOLTS, AMPS, strict=True):
        row = delimiter.join([t, f'{v:.5f}', f'{a:.5f}'])
        lines.append(row.replace('.', ',') if comma else row)
    path.write_text('\n'.join(lines) + '\n')
    return path


def refused(path, *words, columns=''):
    with pytest.raises(InputError) as error:
        Log.read(path, columns)
    assert '\n' not in str(error.value)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    'how',
    [
        {},
        {'delimiter': ';', 'head': 'Time;U;I'},
        {'delimiter': ';', 'head': 'Zeit;Spannung;Strom', 'comma': True},
        {'delimiter': '\t', 'head': 'Time [s]\tVoltage [V]\tCurrent [A]'},
        {'delimiter': ' ', 'head': '# time voltage current'},
        {'head': 'Analyser X\nrange,60 V\n\n"Time (s)","Urms (V)","Irms (A)"'},
        {'head': 'Time/s,U/V,I/A'},
        {'head': 'time_s,voltage_V,current_A'},
        {'head': 'timestamp_s,u_v,i_a'},
    ],
)
def test_every_dialect_gives_the_same_numbers(tmp_path, how):
    log = Log.read(write(tmp_path / 'a.csv', **how))
    np.testing.assert_allclose(log.voltage, VOLTS, atol=1e-5)
    np.testing.assert_allclose(log.current, AMPS, atol=1e-5)
    assert log.rate == pytest.approx(1000.0)
    assert log.start == 0.0
    assert log.power is None
    np.testing.assert_allclose(log.watts, VOLTS * AMPS, atol=1e-3)


@pytest.mark.parametrize(
    ('stamp', 'start'),
    [
        (lambda t: f'2025-06-15T14:00:00.{round(1e6 * t):06d}', 1749996000.0),
        (lambda t: f'2025-06-15 14:00:00.{round(1e6 * t):06d}Z', 1749996000.0),
        (lambda t: f'2025-06-15 14:00:00.{round(1e3 * t):03d}+02:00', 1749988800.0),
        (lambda t: f'15.06.2025 14:00:00.{round(1e3 * t):03d}', 1749996000.0),
        (lambda t: f'14:00:00.{round(1e3 * t):03d}', 50400.0),
        (lambda t: f'{1749996000 + t:.6f}', 1749996000.0),
        (lambda t: f'{1749996000000 + round(1e3 * t)}', 1749996000.0),
        (lambda t: f'{1749996000000000 + round(1e6 * t)}', 1749996000.0),
    ],
)
def test_times_are_seconds_dates_times_of_day_and_epochs(tmp_path, stamp, start):
    log = Log.read(write(tmp_path / 'a.csv', times=[stamp(t) for t in TIME]))
    assert log.start == pytest.approx(start, abs=1e-6)
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)


@pytest.mark.parametrize('year', ['2025', '1904'])
def test_the_day_of_a_date_comes_first_also_beside_a_damaged_one(tmp_path, year):
    times = [f'15.06.{year} 14:00:00.{round(1e3 * t):03d}' for t in TIME]
    times[3] = times[3].replace('15.06.', '15.16.')
    log = Log.read(write(tmp_path / 'a.csv', times=times))
    np.testing.assert_allclose(log.time, np.delete(TIME, 3), atol=1e-6)


@pytest.mark.parametrize('head', ['Time [ms],U [mV],I [kA]', 'time_ms,U_mV,current_kA'])
def test_units_in_the_heads_and_scales_in_the_mapping_are_applied(tmp_path, head):
    path = write(tmp_path / 'a.csv', head=head)
    log = Log.read(path)
    np.testing.assert_allclose(log.time, TIME / 1e3, atol=1e-9)
    np.testing.assert_allclose(log.voltage, VOLTS / 1e3, atol=1e-5)
    np.testing.assert_allclose(log.current, AMPS * 1e3, atol=1e-2)
    log = Log.read(path, f'time=1*1, voltage={head.split(",")[1]}*1, current=3*-2')
    np.testing.assert_allclose(log.current, -2 * AMPS, atol=1e-4)
    assert log.duration == pytest.approx(TIME[-1])


def test_a_word_behind_an_underscore_that_is_no_unit_belongs_to_the_name(tmp_path):
    log = Log.read(write(tmp_path / 'a.csv', head='time_s,U_rms,I_rms'))
    np.testing.assert_allclose(log.voltage, VOLTS, atol=1e-5)
    refused(write(tmp_path / 'b.csv', head='time_s,voltage_left,current_left'), '--columns')


def test_columns_without_heads_are_named_by_numbers(tmp_path):
    path = write(tmp_path / 'a.csv', head='')
    refused(path, '--columns', 'numbers from 1')
    np.testing.assert_allclose(Log.read(path, 'time=1,current=3').current, AMPS, atol=1e-5)
    refused(path, "'7'", '1 to 3', columns='time=1,current=7')
    refused(path, 'time is missing', columns='current=3')
    refused(path, "'volts=2'", columns='time=1,volts=2')
    refused(path, "'zero'", columns='time=1,current=3*zero')


def test_rows_that_share_a_printed_stamp_are_spread_evenly(tmp_path):
    times = [f'{t:.3f}' for t in np.arange(ROWS) / 20_000]
    log = Log.read(write(tmp_path / 'a.csv', times=times))
    assert log.rate == pytest.approx(20_000, rel=0.02)
    assert len(log.starts) == 1
    assert np.diff(log.time).min() > 0


def test_gaps_and_fields_that_are_no_numbers_are_left_out_and_told(tmp_path):
    path = write(tmp_path / 'a.csv')
    lines = path.read_text().splitlines()
    lines[11] = '0.010000,OL,1.0'
    lines[12] = '0.011000,,'
    del lines[100:150]
    path.write_text('\n'.join(lines) + '\n0.2')
    log = Log.read(path)
    assert len(log.time) == ROWS - 52
    assert len(log.starts) == 3
    assert '2 of 150 rows' in ' '.join(log.notes)
    assert '1 rows of another number of fields' in ' '.join(log.notes)


def rows_of(times):
    return np.column_stack([times, 1.0 + np.sin(0.17 * np.arange(len(times)))])


@pytest.mark.parametrize('rate', [100.0, 20.0])
@pytest.mark.parametrize('digits', [2, 3, 6])
def test_a_row_that_is_left_out_ends_a_run_and_moves_no_stamp(rate, digits):
    times = np.arange(round(20 * rate)) / rate
    rows = rows_of(np.round(times, digits))
    lost = [round(rate * at) for at in (3.0, 6.0, 9.0, 9.5)]
    rows[lost, 1] = np.nan
    log = Log.of(Path('a'), ['time', 'current'], rows)
    kept = np.delete(times, lost)
    assert len(log.starts) == 5
    assert log.rate == pytest.approx(rate, rel=1e-6)
    np.testing.assert_allclose(log.time, kept, atol=1e-9)


@pytest.mark.parametrize('digits', [2, 3, 6])
def test_a_row_that_the_analyser_skipped_ends_a_run_and_moves_no_stamp(digits):
    times = np.delete(np.arange(2000) / 100.0, [300, 600, 601, 950])
    log = Log.of(Path('a'), ['time', 'current'], rows_of(np.round(times, digits)))
    assert log.starts.tolist() == [0, 300, 599, 947]
    np.testing.assert_allclose(log.time, times, atol=1e-9)


@pytest.mark.parametrize(('rate', 'digits'), [(97.3, 2), (730.0, 3), (20_000.0, 3)])
def test_rounding_of_the_print_is_taken_out_and_no_stamp_moves_by_more(rate, digits):
    times = np.arange(20_000) / rate
    printed = np.round(times, digits)
    log = Log.of(Path('a'), ['time', 'current'], rows_of(printed))
    assert len(log.starts) == 1
    assert np.abs(log.time - printed).max() <= 0.51 * 10.0**-digits
    assert np.abs(np.diff(log.time - times)).max() < 1e-8
    assert log.rate == pytest.approx(rate, rel=1e-5)


def test_stamps_of_a_clock_that_jitters_stay_as_they_are_and_in_one_run():
    random = np.random.default_rng(5)
    times = np.round(np.arange(2000) / 100.0 + random.uniform(0.0, 0.004, 2000), 6)
    log = Log.of(Path('a'), ['time', 'current'], rows_of(times))
    assert len(log.starts) == 1
    np.testing.assert_allclose(log.time, times - times[0], atol=1e-9)


def test_what_is_no_log_is_refused_in_a_line(tmp_path):
    path = tmp_path / 'a.csv'
    refused(path, 'cannot read')
    path.write_text('hello\nworld\n')
    refused(path, 'no rows of numbers')
    path.write_text('Time,U,I\n' + ''.join(f'{t},48,{t}\n' for t in range(50)))
    refused(path, '50 rows', '100')
    path.write_text('Time,U,I\n' + ''.join(f'{t},48,2\n' for t in range(500)))
    refused(path, 'current is constant (2)')
    path.write_text('Time,U,I\n' + ''.join(f'7,48,{t}\n' for t in range(500)))
    refused(path, 'same time')
    path.write_text('Time,U,I\n' + ''.join(f'06/07/2025 1:00,48,{t}\n' for t in range(500)))
    refused(path, str(path))


def test_a_clipped_current_is_refused_and_a_coarse_one_is_not(tmp_path):
    amps = 5.0 * np.sin(0.02 * np.arange(2000)) + 0.01 * np.cos(1.3 * np.arange(2000))
    rows = np.column_stack([0.001 * np.arange(2000), np.clip(amps, -9.0, 4.0)])
    path = tmp_path / 'a.csv'
    np.savetxt(path, rows, '%.4f', delimiter=',', header='Time,I')
    refused(path, 'current saturates at 4')
    rows[:, 1] = np.round(amps)
    np.savetxt(path, rows, '%.4f', delimiter=',', header='Time,I')
    assert len(Log.read(path).time) == 2000


@settings(max_examples=40, deadline=None)
@given(
    values=st.lists(
        st.floats(-1e4, 1e4, allow_nan=False).map(lambda x: round(x, 4)), min_size=5, max_size=5
    ),
    delimiter=st.sampled_from([';', '\t', ',']),
    comma=st.booleans(),
    ending=st.sampled_from(['\n', '\r\n']),
)
def test_any_number_is_read_back_as_it_was_written(
    values, delimiter, comma, ending, tmp_path_factory
):
    path = Path(tmp_path_factory.mktemp('log')) / 'a.csv'
    amps = np.tile(values, 30) + np.arange(150)
    lines = [f'{t:.3f}{delimiter}{a:.4f}' for t, a in enumerate(amps)]
    if comma and delimiter != ',':
        lines = [line.replace('.', ',') for line in lines]
    head = delimiter.join(['Time', 'Current'])
    path.write_bytes((ending.join([head, *lines]) + ending).encode())
    log = Log.read(path)
    np.testing.assert_allclose(log.current, amps, atol=1e-4)
    np.testing.assert_allclose(log.time, np.arange(150.0), atol=1e-6)
