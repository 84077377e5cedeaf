from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from power_recordings.alignment.align import align, load_aligned
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.alignment.filters import antialias, gain, smoothing
from power_recordings.alignment.stream import Stream, held
from power_recordings.messages import cdr
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

START = 1_700_000_000_000_000_000
Make = Callable[..., Any]
ANTIALIAS_HALF = 0.0195  # s: 39 taps at 1 kHz
SMOOTHING_HALF = 0.0425  # s: 35 taps at 400 Hz


def wave(time: np.ndarray, frequency: float, phase: float = 0.0) -> np.ndarray:
    return np.sin(2 * np.pi * frequency * time + phase)


def aligned(sketch: Any, tmp_path: Path, **options: Any) -> AlignedDataset:
    return align(Recording.open(sketch.write(tmp_path / 'walk')), **options)


def seconds(data: AlignedDataset) -> np.ndarray:
    return data.time - START / 1e9


@pytest.mark.parametrize('rate', [400.0, 200.0, 100.0, 50.0])
@pytest.mark.parametrize('smooth', [True, False])
def test_sines_keep_their_phase_and_amplitude(
    walk: Make, tmp_path: Path, rate: float, smooth: bool
) -> None:
    sketch = walk(3.0)
    sketch.current[:] = 2 + wave(sketch.supply_time, 3, np.arange(3))
    sketch.position[:] = wave(sketch.joint_time, 3)
    sketch.velocity[:] = wave(sketch.joint_time, 3, np.pi / 2)
    sketch.effort[:] = 20 * wave(sketch.joint_time, 3, -np.arange(3))
    data = aligned(sketch, tmp_path, rate=rate, smooth=smooth)
    kept = gain(smoothing(400.0), 3, 400) if smooth else 1.0
    time = seconds(data)[:, None]
    assert data.rate == rate
    # Stamps lie in 2⁻²² s of float64 at this date.
    np.testing.assert_allclose(np.diff(data.time), 1 / rate, atol=1e-6)
    within = {'atol': 2e-3, 'rtol': 0}
    np.testing.assert_allclose(data.position, kept * wave(time, 3) + 0 * data.position, **within)
    np.testing.assert_allclose(
        data.velocity, kept * wave(time, 3, np.pi / 2) + 0 * data.position, **within
    )
    np.testing.assert_allclose(data.torque / 20, kept * wave(time, 3, -np.arange(3)), **within)
    np.testing.assert_allclose(data.power / 48, 2 + kept * wave(time, 3, np.arange(3)), **within)
    np.testing.assert_allclose(data.current, data.power / 48, rtol=1e-5)
    np.testing.assert_allclose(data.temperature, 40, rtol=1e-5)
    np.testing.assert_allclose(data.command, 0.25, rtol=1e-5)


def test_power_and_torque_of_one_noise_are_in_step(walk: Make, tmp_path: Path) -> None:
    sketch = walk(4.0)
    noise = np.random.default_rng(0).normal(size=(4100, 1))
    slow = np.convolve(noise[:, 0], np.hanning(41) / 20, 'same')[:4000]
    sketch.current[:] = slow[:, None]
    sketch.effort[:] = np.interp(sketch.joint_time, sketch.supply_time[:, 0], slow)
    data = aligned(sketch, tmp_path, rate=400.0)
    power, torque = data.power[:, 0], data.torque[:, 0]
    lags = range(-20, 21)
    scores = [np.corrcoef(power[30:-30], np.roll(torque, lag)[30:-30])[0, 1] for lag in lags]
    assert lags[int(np.argmax(scores))] == 0
    assert max(scores) > 0.999


def test_power_is_the_product_of_each_sample(walk: Make, tmp_path: Path) -> None:
    # 300 Hz ripple in phase on both: its product has a mean of a·b/2, which averages first lose.
    sketch = walk(2.0)
    ripple = wave(sketch.supply_time, 300, 0.3)
    sketch.voltage[:] = 48 + 2 * ripple
    sketch.current[:] = 3 + 1.5 * ripple
    data = aligned(sketch, tmp_path)
    np.testing.assert_allclose(data.power, 48 * 3 + 2 * 1.5 / 2, rtol=2e-3)
    np.testing.assert_allclose(data.voltage, 48, rtol=1e-3)


@pytest.mark.parametrize('frequency', [350.0, 402.0, 450.0])
def test_fast_ripple_in_power_does_not_alias(walk: Make, tmp_path: Path, frequency: float) -> None:
    sketch = walk(2.0)
    sketch.current[:] = 2 + wave(sketch.supply_time, frequency)
    data = aligned(sketch, tmp_path, rate=400.0, smooth=False)
    assert np.abs(data.power - 96).max() < 48 * 2e-3
    np.testing.assert_allclose(data.power.mean(axis=0), 96, rtol=1e-4)


def test_lower_rates_do_not_alias_without_smoothing(walk: Make, tmp_path: Path) -> None:
    sketch = walk(3.0)
    sketch.effort[:] = wave(sketch.joint_time, 40)
    data = aligned(sketch, tmp_path, rate=50.0, smooth=False)
    assert np.abs(data.torque).max() < 2e-3


def test_smoothing_takes_half_the_power_at_its_cutoff_from_all_signals_alike(
    walk: Make, tmp_path: Path
) -> None:
    # The window is a whole number of samples: −3 dB lies at 12.18 Hz instead of 12.5 Hz.
    assert gain(smoothing(400.0), 12.5, 400) ** 2 == pytest.approx(0.5, abs=0.04)
    assert gain(smoothing(400.0), 12.18, 400) ** 2 == pytest.approx(0.5, abs=0.002)
    assert gain(smoothing(400.0), 1.0, 400) == pytest.approx(1, abs=1e-3)
    sketch = walk(3.0)
    sketch.current[:] = 2 + wave(sketch.supply_time, 12.5)
    sketch.effort[:] = wave(sketch.joint_time, 12.5)
    sketch.position[:] = wave(sketch.joint_time, 12.5, 1.0)
    data = aligned(sketch, tmp_path, rate=400.0)
    for signal in (data.power / 48, data.torque, data.position):
        amplitude = np.sqrt(2) * signal.std(axis=0)
        np.testing.assert_allclose(amplitude, gain(smoothing(400.0), 12.5, 400), rtol=0.01)


@pytest.mark.parametrize(('rate', 'lower'), [(1000.0, 400.0), (400.0, 200.0), (400.0, 50.0)])
def test_the_antialias_filter_responds_as_stated(rate: float, lower: float) -> None:
    taps = antialias(rate, lower)
    passed = [gain(taps, f, rate) for f in np.linspace(0, lower / 4, 50)]
    stopped = [gain(taps, f, rate) for f in np.linspace(lower / 2, rate / 2, 400)]
    np.testing.assert_allclose(passed, 1, atol=2e-3)
    assert np.abs(stopped).max() < 10 ** (-58 / 20)
    assert taps.sum() == pytest.approx(1, abs=1e-12)
    np.testing.assert_array_equal(taps, taps[::-1])


def test_a_step_in_the_command_is_held_from_its_stamp(walk: Make, tmp_path: Path) -> None:
    sketch = walk(2.0)
    sketch.command[60:, 1] = 0.75  # at 1.2 s
    data = aligned(sketch, tmp_path, rate=200.0, smooth=False)
    after = seconds(data) >= 1.2 - 1e-6
    assert after.any()
    assert not after.all()
    np.testing.assert_array_equal(data.command[:, 1], np.where(after, 0.75, 0.25))
    np.testing.assert_array_equal(data.command[:, 0], 0.25)
    np.testing.assert_array_equal(data.position_error, data.command - data.position)


def test_commands_that_are_nan_leave_the_last_target_in_force(walk: Make, tmp_path: Path) -> None:
    sketch = walk(2.0)
    sketch.command[50:, 0] = np.nan
    data = aligned(sketch, tmp_path)
    np.testing.assert_allclose(data.command, 0.25, rtol=1e-5)


def test_time_before_the_first_command_is_left_out(walk: Make, tmp_path: Path) -> None:
    sketch = walk(3.0)
    sketch.command_stamps = sketch.command_stamps[50:]
    sketch.command = sketch.command[50:]
    data = aligned(sketch, tmp_path)
    assert seconds(data)[0] == pytest.approx(1.0 + SMOOTHING_HALF, abs=0.003)
    assert np.isfinite(data.command).all()


def test_without_commands_the_command_is_nan(walk: Make, tmp_path: Path) -> None:
    sketch = walk(1.0)
    sketch.left_out = ('/joint_commands',)
    data = aligned(sketch, tmp_path)
    assert np.isnan(data.command).all()
    assert np.isfinite(data.power).all()


def spans(data: AlignedDataset) -> list[tuple[float, float]]:
    time = seconds(data)
    return [(time[part][0], time[part][-1]) for part in data.segments()]


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


def test_samples_of_bad_status_or_nan_are_gaps(walk: Make, tmp_path: Path) -> None:
    sketch = walk(5.0)
    sketch.current[1500, 0] = 900.0
    sketch.status[1500, 0] = 4
    sketch.current[3000, 2] = np.nan
    sketch.effort[1600, 1] = np.nan  # 4.0 s
    data = aligned(sketch, tmp_path)
    assert len(spans(data)) == 4
    np.testing.assert_allclose(data.power, 96, rtol=1e-5)
    notes = ' '.join(data.notes)
    assert 'drive_supply: 1 samples of bad status cut out' in notes
    assert 'drive_supply: 1 samples with NaN cut out' in notes
    assert 'joint_states: 1 samples with NaN cut out' in notes


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


def test_arrival_does_not_matter(walk: Make, tmp_path: Path) -> None:
    sketch = walk(2.0)
    sketch.current[:] = 2 + wave(sketch.supply_time, 3)
    prompt = align(Recording.open(sketch.write(tmp_path / 'prompt')))
    delays = np.random.default_rng(0).exponential(0.02, 10_000)
    sketch.late = lambda times: np.maximum.accumulate(
        times + (delays[: len(times)] * 1e9).astype(np.int64)
    )
    late = align(Recording.open(sketch.write(tmp_path / 'late')))
    np.testing.assert_array_equal(prompt.power, late.power)
    np.testing.assert_array_equal(prompt.time, late.time)


def test_clocks_of_slightly_different_speed_stay_in_step(walk: Make, tmp_path: Path) -> None:
    sketch = walk(20.0)
    for name, factor in (('supply_stamps', 1.0002), ('joint_stamps', 0.9999)):
        since = getattr(sketch, name) - START
        setattr(sketch, name, START + np.rint(since * factor).astype(np.int64))
    sketch.current[:] = 2 + wave(sketch.supply_time, 5)
    sketch.effort[:] = wave(sketch.joint_time, 5)
    data = aligned(sketch, tmp_path, rate=400.0, smooth=False)
    assert len(spans(data)) == 1
    np.testing.assert_allclose(data.power / 48 - 2, data.torque, atol=2e-3)


def test_faster_and_slower_streams_are_brought_to_the_grid(walk: Make, tmp_path: Path) -> None:
    sketch = walk(2.0)
    keep = slice(None, None, 2)  # 500 Hz electrical, 200 Hz joint states
    for name in ('supply_stamps', 'voltage', 'current', 'status'):
        setattr(sketch, name, getattr(sketch, name)[keep])
    sketch.sequence = sketch.sequence[: len(sketch.current)]
    for name in ('joint_stamps', 'position', 'velocity', 'effort'):
        setattr(sketch, name, getattr(sketch, name)[keep])
    sketch.current[:] = 2 + wave(sketch.supply_time, 3)
    sketch.effort[:] = wave(sketch.joint_time, 3)
    data = aligned(sketch, tmp_path, smooth=False)
    np.testing.assert_allclose(data.power / 48 - 2, data.torque, atol=2e-3)


def test_drives_follow_their_names_in_both_topics(walk: Make, tmp_path: Path) -> None:
    sketch = walk(1.0)
    sketch.drive_names = ('LF_KFE', 'LF_HAA', 'LF_HFE')
    sketch.current[:] = [3.0, 1.0, 2.0]
    sketch.effort[:] = [1.0, 2.0, 3.0]
    data = aligned(sketch, tmp_path)
    np.testing.assert_allclose(data.power[0] / 48, data.torque[0], rtol=1e-5)


def test_drives_without_measurement_have_nan_power(walk: Make, tmp_path: Path) -> None:
    sketch = walk(1.0, drive_names=('LF_KFE',))
    data = aligned(sketch, tmp_path)
    assert data.names == ('LF_HAA', 'LF_HFE', 'LF_KFE')
    assert data.measured_drives() == ('LF_KFE',)
    assert np.isnan(data.power[:, :2]).all()
    assert np.isfinite(data.torque).all()


def test_unknown_drives_are_an_error_unless_others_are_chosen(walk: Make, tmp_path: Path) -> None:
    sketch = walk(1.0, drive_names=('LF_HAA', 'ARM_1', 'LF_KFE'))
    recording = Recording.open(sketch.write(tmp_path / 'walk'))
    with pytest.raises(InputError, match='drive_supply measures ARM_1, which joint_states'):
        align(recording)
    data = align(recording, drives=['LF_HAA', 'LF_KFE'])
    assert data.measured_drives() == ('LF_HAA', 'LF_KFE')
    with pytest.raises(InputError, match="no joint 'ARM_1' in joint_states"):
        align(recording, drives=['ARM_1'])


def test_supply_power_is_positive_while_the_battery_current_is_negative(
    walk: Make, tmp_path: Path
) -> None:
    sketch = walk(2.0)
    times = START + np.arange(200) * 10_000_000
    sketch.topics['/supply'] = (
        cdr.BATTERY_STATE,
        times,
        cdr.encode_batteries(times, np.full(200, 50.0), np.full(200, -6.0)),
    )
    data = aligned(sketch, tmp_path)
    np.testing.assert_allclose(data.supply[:-10], 300, rtol=1e-5)


def test_other_topics_become_extras(walk: Make, tmp_path: Path) -> None:
    sketch = walk(2.0)
    times = sketch.joint_stamps
    time = sketch.joint_time
    feet = ('RH_FOOT', 'LF_FOOT', 'LH_FOOT', 'RF_FOOT')
    half = wave(time[:, 0], 0.5) / 2
    turn = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    turn[::2] *= -1  # q and −q are the same orientation
    rate = wave(time, 2, np.arange(3))
    sketch.topics = {
        '/foot_force': (
            cdr.JOINT_STATE,
            times,
            cdr.encode_joint_states(times, feet, effort=np.tile([4.0, 1.0, 3.0, 2.0], (800, 1))),
        ),
        '/imu': (cdr.IMU, times, cdr.encode_imu(times, turn, rate, -rate)),
        '/cmd_vel': (
            cdr.TWIST_STAMPED,
            times[[0, 400]],
            cdr.encode_twists(times[[0, 400]], np.array([[0.5, 0, 0], [0, 0.25, 1.0]])),
        ),
    }
    data = aligned(sketch, tmp_path, smooth=False, rate=400.0)
    assert set(data.extras) == {
        'foot_force',
        'orientation',
        'angular_velocity',
        'linear_acceleration',
        'cmd_vel',
    }
    np.testing.assert_allclose(data.extras['foot_force'][0], [1, 2, 3, 4], rtol=1e-5)
    since = seconds(data)
    np.testing.assert_allclose(
        data.extras['angular_velocity'], wave(since[:, None], 2, np.arange(3)), atol=2e-3
    )
    np.testing.assert_allclose(
        np.abs(data.extras['orientation'][:, 2]), np.abs(np.sin(wave(since, 0.5) / 2)), atol=2e-3
    )
    late = since >= 1.0 - 1e-6
    np.testing.assert_array_equal(
        data.extras['cmd_vel'], np.where(late[:, None], [0, 0.25, 1.0], [0.5, 0, 0])
    )


def test_a_gap_in_an_extra_is_nan_and_ends_nothing(walk: Make, tmp_path: Path) -> None:
    sketch = walk(3.0)
    times = np.delete(sketch.joint_stamps, slice(400, 600))  # 1.0 s to 1.5 s
    sketch.topics['/foot_force'] = (
        cdr.JOINT_STATE,
        times,
        cdr.encode_joint_states(times, ['LF_FOOT'], effort=np.ones((len(times), 1))),
    )
    data = aligned(sketch, tmp_path, smooth=False, rate=400.0)
    assert len(spans(data)) == 1
    missing = np.isnan(data.extras['foot_force'][:, 0])
    time = seconds(data)
    np.testing.assert_array_equal(missing, (time > 0.9976) & (time < 1.4999))


def test_recordings_are_joined_and_stay_apart(walk: Make, tmp_path: Path) -> None:
    first = walk(3.0)
    first.drop_supply(slice(1500, 1501))
    second = walk(2.0)
    second.current[:] = 5.0
    second.topics['/foot_force'] = (
        cdr.JOINT_STATE,
        second.joint_stamps,
        cdr.encode_joint_states(second.joint_stamps, ['LF_FOOT'], effort=np.ones((800, 1))),
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


def break_it(sketch: Any, how: str) -> None:
    if how == 'degrees':
        sketch.position[:, 1] = np.rad2deg(0.8)
    elif how == 'milliamperes':
        sketch.current[:, 2] = 2000
    elif how == 'millivolts':
        sketch.voltage[:, 0] = 48_000
    elif how == 'nan effort':
        sketch.effort[:, 0] = np.nan
    elif how == 'nan current':
        sketch.current[:] = np.nan
    elif how == 'constant stamps':
        sketch.joint_stamps[:] = START
    elif how == 'zero stamps':
        sketch.supply_stamps[:] = 0
    elif how == 'no joints':
        sketch.left_out = ('/joint_states',)
    elif how == 'no supply':
        sketch.left_out = ('/drive_supply',)
    elif how == 'other clock':
        sketch.supply_stamps -= START
    elif how == 'few':
        sketch.drop_joints(slice(3, None))


@pytest.mark.parametrize(
    ('how', 'error'),
    [
        ('degrees', r'joint_states\.position of LF_HFE reaches 45\.84.*degrees\? expected rad'),
        ('milliamperes', r'drive_supply\.current of LF_KFE reaches 2000: mA\? expected A'),
        ('millivolts', r'drive_supply\.voltage of LF_HAA reaches 4\.8e\+04: mV\? expected V'),
        ('nan effort', r'joint_states\.effort of LF_HAA is NaN or missing in 100%'),
        ('nan current', r'drive_supply has a bad status or NaN in most samples of all drives'),
        ('constant stamps', r'joint_states has only 1 samples.*all 400 messages have the same'),
        (
            'zero stamps',
            r'drive_supply has only 1 samples.*all 1000 messages have the same stamp 0',
        ),
        ('no joints', r"no messages on topic 'joint_states'; there are: /drive_supply"),
        ('no supply', r"no messages on topic 'drive_supply'; there are: /joint_commands"),
        ('other clock', r'do not overlap.*one clock'),
        ('few', r'joint_states has only 3 samples'),
    ],
)
def test_what_cannot_be_aligned_is_an_error_that_names_recording_and_field(
    walk: Make, tmp_path: Path, how: str, error: str
) -> None:
    sketch = walk(1.0)
    break_it(sketch, how)
    with pytest.raises(InputError, match=error) as caught:
        aligned(sketch, tmp_path)
    assert str(tmp_path / 'walk') in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_recording_too_short_for_the_filters_is_an_error(walk: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'nothing is left of 0\.10 s.*longer than the 0\.13 s'):
        aligned(walk(0.1), tmp_path)


def test_recordings_without_power_can_be_admitted(walk: Make, tmp_path: Path) -> None:
    sketch = walk(1.0)
    sketch.left_out = ('/drive_supply',)
    data = aligned(sketch, tmp_path, need_power=False)
    assert np.isnan(data.power).all()
    assert data.measured_drives() == ()


def test_a_recording_in_memory_is_aligned_like_one_on_disk(walk: Make, tmp_path: Path) -> None:
    sketch = walk(1.0)
    sketch.current[:] = 2 + wave(sketch.supply_time, 3)
    disk = Recording.open(sketch.write(tmp_path / 'walk'))
    parts = {
        'drive_supply': disk.drive_supply(),
        'joint_states': disk.joint_states(),
        'joint_commands': disk.joint_commands(),
    }
    memory = Recording.in_memory('simulated', parts)
    assert memory.duration == pytest.approx(0.999)
    np.testing.assert_array_equal(align(memory).power, align(disk).power)
    assert align(memory).recordings == ('simulated',)
    with pytest.raises(InputError, match="no topic 'joints'"):
        Recording.in_memory('simulated', {'joints': disk.joint_states()})
    with pytest.raises(InputError, match='simulated holds no samples'):
        Recording.in_memory('simulated', {'joint_states': disk.joint_states().rows(slice(0))})


def test_other_rates_are_refused(walk: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match='rate is 123 Hz; it is one of 400, 200, 100, 50'):
        aligned(walk(0.2), tmp_path, rate=123.0)


def test_a_cubic_passes_exactly_through_a_cubic() -> None:
    time = np.arange(10) * 0.0025
    stream = Stream.of(time, ((time * 400) ** 3)[:, None].astype(np.float32))
    grid = np.arange(0.001, 0.0224, 0.0025)
    np.testing.assert_allclose(stream.sample(grid)[:, 0], (grid * 400) ** 3, rtol=1e-4, atol=1e-4)


def test_holding_starts_with_the_first_value() -> None:
    values = np.array([[1.0, np.nan], [np.nan, 5.0], [3.0, 6.0]])
    result = held(np.array([0.0, 1.0, 2.0]), values, np.array([-0.5, 0.0, 1.5, 2.0, 9.0]))
    np.testing.assert_array_equal(result, [[np.nan, np.nan], [1, np.nan], [1, 5], [3, 6], [3, 6]])
