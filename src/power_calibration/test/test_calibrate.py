import json
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from power_calibration.analyser.bandwidth import response_of_drive
from power_calibration.analyser.curve import Curve, Match, matches
from power_calibration.analyser.reference_fit import Clock, fit_reference
from power_calibration.commands.arguments import calibrate as main
from power_recordings.calibration import Calibration, label
from power_recordings.card import Card

DRIVE = 'LF_HFE'
SECONDS = 14.0
GAIN = {'voltage': 1.012, 'current': 0.985}
OFFSET = {'voltage': -0.2, 'current': 0.06}


def truth(time):
    """Voltage and current that never repeat: bursts of a few Hz on a slow swell."""
    amps = 2.0 + np.zeros_like(time)
    for k, (rate, size) in enumerate(
        [(0.23, 1.5), (1.1, 1.0), (2.7, 1.2), (5.3, 0.8), (9.1, 0.4)]
    ):
        amps += size * np.sin(2 * np.pi * rate * time + k) * (1 + 0.5 * np.sin(0.4 * time + 2 * k))
    return 48.0 - 0.3 * amps + 0.4 * np.sin(0.9 * time), amps


@pytest.fixture
def rig(walk, tmp_path, monkeypatch):
    """A recording of a meter that is off, and a writer of logs of the same run."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(3)
    run = walk(seconds=SECONDS, drive_names=(DRIVE,))
    time = (run.supply_stamps - run.supply_stamps[0]) / 1e9
    for name, values in zip(('voltage', 'current'), truth(time), strict=True):
        noise = 0.005 * random.standard_normal(len(time))
        setattr(run, name, ((values - OFFSET[name]) / GAIN[name] + noise)[:, None])
    run.write(tmp_path / 'bag')

    def log(
        offset=0.0,
        drift=0.0,
        rate=5000.0,
        start=0.7,
        stop=13.1,
        change=lambda v, a: (v, a),
        head='Time,U,I',
    ):
        times = np.arange(start, stop, 1 / rate)
        volts, amps = change(*truth(times))
        noise = 0.003 * random.standard_normal((2, len(times)))
        rows = np.column_stack(
            [offset + times * (1 + 1e-6 * drift), volts + noise[0], amps + noise[1]]
        )
        np.savetxt(tmp_path / 'ref.csv', rows, '%.6f', delimiter=',', header=head, comments='')

    return SimpleNamespace(log=log, folder=tmp_path, run=run)


def calibrate(*more):
    return main(['bag', '--reference', 'ref.csv', '-o', 'cal.yaml', '--json', 'cal.json', *more])


def result():
    with open('cal.json') as file:
        return json.load(file)


@pytest.mark.parametrize(
    ('offset', 'drift', 'rate'),
    [(0.0, 0.0, 5000.0), (-7203.25, 60.0, 5000.0), (1.7e9, -45.0, 2000.0)],
)
def test_gain_offset_clock_offset_and_drift_are_found_within_their_intervals(
    rig, offset, drift, rate
):
    rig.log(offset, drift, rate)
    assert calibrate() == 0
    found = result()
    for name in ('voltage', 'current'):
        channel = found['channels'][f'{DRIVE}.{name}']
        low, high = channel['gain_interval']
        assert low <= GAIN[name] <= high
        assert high - low < 0.004
        low, high = channel['offset_interval']
        assert low <= OFFSET[name] <= high
    assert found['drift_ppm'] == pytest.approx(drift, abs=3.0)
    at = (found['time_offset_at'] - offset) / (1 + 1e-6 * drift)
    start = rig.run.supply_stamps[0] / 1e9
    assert found['time_offset'] == pytest.approx(start + at - found['time_offset_at'], abs=2e-5)
    assert found['rmse_after_w'] < 0.3 < found['rmse_before_w']
    assert abs(found['bias_after_w']) < 0.02


def test_what_folds_into_the_band_widens_intervals_and_is_told_with_what_to_do(rig, capsys):
    rig.log()
    assert calibrate() == 0
    assert 'folds' not in ' '.join(result()['notes'])
    plain = result()['channels'][f'{DRIVE}.current']['gain_interval']
    capsys.readouterr()
    # 1002 Hz looks like 2 Hz at 1 kHz
    rig.log(change=lambda v, a: (v, a + 3.0 * np.sin(2 * np.pi * 1002 * np.arange(len(a)) / 5000)))
    assert calibrate() == 0
    said = ' '.join(capsys.readouterr().out.split())
    assert 'most of the interval of current gain, time offset allows for' in said
    assert '--frequency 4.0371' in said
    assert np.ptp(result()['channels'][f'{DRIVE}.current']['gain_interval']) > 3 * np.ptp(plain)


def test_the_file_makes_the_daq_measure_what_the_analyser_does(rig):
    rig.log()
    calibrate()
    applied = Calibration.load(rig.folder / 'cal.yaml', [DRIVE])
    time = np.arange(0, 5, 0.001)
    raw = [(v - OFFSET[n]) / GAIN[n] for n, v in zip(GAIN, truth(time), strict=True)]
    true = np.array(raw)[:, :, None] * applied.gain[:, None] + applied.offset[:, None]
    np.testing.assert_allclose(true[:, :, 0], truth(time), atol=0.01)


def test_a_log_of_100_hz_whose_rows_are_means_gives_the_gain(rig):
    fine = 5000.0
    times = np.arange(0.5, 13.0, 1 / fine)
    rows = np.column_stack([times, *truth(times)]).reshape(-1, 50, 3).mean(axis=1)
    np.savetxt('ref.csv', rows, '%.6f', delimiter=';', header='t;u;i', comments='')
    assert calibrate() == 0
    found = result()
    assert found['rows_are_means'] is True
    assert 'rows of the reference are means over their 10 ms' in found['notes']
    assert found['channels'][f'{DRIVE}.current']['gain'] == pytest.approx(0.985, abs=0.002)


def test_point_samples_of_the_very_same_signal_are_not_taken_for_means(rig, capsys):
    volts, amps = rig.run.voltage[:, 0], rig.run.current[:, 0]
    times = (rig.run.supply_stamps - rig.run.supply_stamps[0]) / 1e9
    rows = np.column_stack([times, volts, amps])[500:13000:4]
    np.savetxt('ref.csv', rows, '%.6f', ',', header='time_s,voltage_V,current_A', comments='')
    assert calibrate() == 0
    found = result()
    assert found['rows_are_means'] is False
    assert 'means' not in ' '.join(found['notes'])
    assert found['bandwidth']['minus_3db_hz'] is None
    assert found['channels'][f'{DRIVE}.current']['gain'] == pytest.approx(1.0, abs=5e-4)
    printed = ' '.join(capsys.readouterr().out.split())
    assert 'our bandwidth, −3 dB [Hz] none up to' in printed
    assert 'drift of its clock [ppm]' in printed


def test_rows_of_a_slow_signal_are_said_to_be_undecidable(rig):
    rig.log(rate=400.0)
    assert calibrate() == 0
    found = result()
    assert found['rows_are_means'] is None
    assert 'cannot tell whether rows of the reference are samples or means' in ' '.join(
        found['notes']
    )
    rig.log(rate=5000.0)
    assert calibrate() == 0
    assert 'means' not in ' '.join(result()['notes'])


@pytest.mark.parametrize(
    ('columns', 'channels'),
    [
        ('time=1,current=3', ['current']),
        ('time=1,voltage=2', ['voltage']),
        ('time=1,power=4', ['current']),
        ('time=1,voltage=2,power=4', ['current', 'voltage']),
        ('time=1,voltage=2,current=3,power=4', ['current', 'voltage']),
    ],
)
def test_any_of_voltage_current_and_power_will_do(rig, columns, channels):
    times = np.arange(0.5, 13.0, 0.0005)
    volts, amps = truth(times)
    np.savetxt('ref.csv', np.column_stack([times, volts, amps, volts * amps]), '%.6f', ',')
    assert calibrate('--columns', columns) == 0
    found = result()['channels']
    assert sorted(found) == [f'{DRIVE}.{name}' for name in channels]
    for name in channels:
        alone = columns == 'time=1,power=4'
        expected = GAIN['voltage'] * GAIN['current'] if alone else GAIN[name]
        assert found[f'{DRIVE}.{name}']['gain'] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ('how', 'words'),
    [
        ({'change': lambda v, a: (v, -a)}, ['other sign', '*-1']),
        ({'change': lambda v, a: (v, 1000 * a)}, ['current would need a gain of', 'unit']),
        (
            {'change': lambda v, a: (v, np.random.default_rng(0).normal(2, 1, len(a)))},
            ['does not fit', 'best correlation'],
        ),
        ({'change': lambda v, a: truth(np.arange(len(v)) / 5000 + 977.0)}, ['at any offset']),
        ({'start': 5.0, 'stop': 6.5}, ['3 s without gaps']),
        ({'rate': 10.0}, ['rows a second']),
        ({'change': lambda v, a: (v, np.full_like(a, 2.0) + 0 * v), 'rate': 8.0}, ['rows']),
    ],
)
def test_a_reference_that_does_not_fit_is_refused_in_a_line(rig, capsys, how, words):
    rig.log(**how)
    assert calibrate() == 2
    said = capsys.readouterr().err.strip()
    assert '\n' not in said
    for word in words:
        assert word in said
    assert not (rig.folder / 'cal.yaml').exists()


def test_a_recording_made_with_a_calibration_is_combined_with_it_and_with_no_other(rig, capsys):
    rig.log()
    old = {'channels': {f'{DRIVE}.current': {'gain': 2.0, 'offset': 0.5}, 'RF_HFE.current': {}}}
    (rig.folder / 'old.yaml').write_text(yaml.safe_dump(old))
    (rig.folder / 'wrong.yaml').write_text('channels: {}')
    Card(calibration=label(rig.folder / 'old.yaml')).save(rig.folder / 'bag')
    assert calibrate() == 2
    assert '--onto' in capsys.readouterr().err
    assert calibrate('--onto', 'wrong.yaml') == 2
    assert calibrate('--onto', 'old.yaml') == 0
    with open('cal.yaml') as file:
        channels = yaml.safe_load(file)['channels']
    new = result()['channels'][f'{DRIVE}.current']
    joined = channels[f'{DRIVE}.current']
    assert joined['gain'] == pytest.approx(2.0 * new['gain'], rel=1e-6)
    assert joined['offset'] == pytest.approx(new['gain'] * 0.5 + new['offset'], abs=1e-6)
    assert 'RF_HFE.current' in channels


def test_reports_are_written_as_page_and_picture(rig):
    rig.log()
    assert calibrate('--report', 'cal.html') == 0
    page = (rig.folder / 'cal.html').read_text()
    assert 'http' not in page.split('<script>')[0].replace('http-equiv', '')
    assert 'Calibration of LF_HFE' in page
    assert calibrate('--report', 'cal.png') == 0
    assert (rig.folder / 'cal.png').read_bytes()[:4] == b'\x89PNG'
    assert calibrate('--report', 'cal.doc') == 2


def test_a_motion_that_repeats_itself_has_other_offsets_that_fit_as_well():
    time = np.arange(0, 20, 0.001)
    wave = np.sin(2 * np.pi * 2.0 * time)[:, None]
    ours = Curve(((time, wave),), 0.001)
    part = Curve(((time[:8000], wave[5000:13000]),), 0.001)
    best, _ = matches(ours.low_passed(50.0), part.low_passed(50.0))
    offsets = np.array([match.offset for match in best])
    assert len(offsets) > 2
    np.testing.assert_allclose((offsets - 5.0) / 0.5, np.rint((offsets - 5.0) / 0.5), atol=0.02)


def test_a_hole_in_the_log_is_not_bridged():
    time = np.arange(0, 20, 0.001)
    values = np.column_stack(truth(time))
    cut = ((time[:6000], values[:6000]), (time[11000:], values[11000:]))
    ours, log = Curve(((time, values),), 0.001), Curve(cut, 0.001)
    found = fit_reference(
        ours.low_passed(100.0), log.low_passed(100.0), Match(0, 0, 1, 20, 10), 100.0
    )
    assert found.seconds == pytest.approx(15.0, abs=0.5)
    assert found.gain[1].value == pytest.approx(1.0, abs=1e-4)
    assert found.offset.value == pytest.approx(0.0, abs=1e-6)


def noise_and_what_a_meter_of_300_hz_makes_of_it(rate=24_000, seconds=20):
    """White noise up to 480 Hz, and the same past a filter of first order; s, [N] each."""
    frequency = np.fft.rfftfreq(rate * seconds, 1 / rate)
    random = np.random.default_rng(5)
    spectrum = random.standard_normal((2, len(frequency))).T @ [1.0, 1j] * (frequency < 480.0)
    both = [np.fft.irfft(s) for s in (spectrum, spectrum / (1.0 + 1j * frequency / 300.0))]
    return np.arange(rate * seconds) / rate, *both


def test_the_bandwidth_allows_for_rows_that_are_samples_or_means():
    time, amps, seen = noise_and_what_a_meter_of_300_hz_makes_of_it()
    ours = Curve(((time[::24], seen[::24, None]),), 0.001)
    wide = {}
    for rate, every in ((24_000, 1), (6000, 4), (3000, 8)):
        blocks = amps.reshape(-1, every).mean(axis=1), time.reshape(-1, every).mean(axis=1)
        for kind, values, times in (
            ('samples', amps[::every], time[::every]),
            ('means', *blocks),
        ):
            log = Curve.of(times, values[:, None], [0], [len(times)], 1 / rate)
            found = response_of_drive(ours, log, Clock(0.0, 0.0, 10.0)).cutoff
            # 1.5 %: gain is taken as 1 below 40 Hz, where this meter is down by 0.3 % on average,
            # and the cubic through rows of 3 kHz loses 0.4 % at 300 Hz
            assert found.low - 4.5 <= 300.0 <= found.high + 4.5, (rate, kind, found)
            assert found.value == pytest.approx(300.0, rel=0.04)
            wide[rate] = found.high - found.low
    assert wide[24_000] < 0.6 * wide[3000]
    assert wide[3000] < 35.0
