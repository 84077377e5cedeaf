from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from power_recordings.alignment.align import align
from power_recordings.alignment.filters import antialias, gain, smoothing
from power_recordings.alignment.stream import Stream, held
from power_recordings.messages import cdr
from power_recordings.reading.reader import Recording
from synthetic_walk import START, aligned, seconds, spans, wave
from wattwalk_core.errors import InputError

Make = Callable[..., Any]
SMOOTHING_HALF = 0.0425  # s: 35 taps at 400 Hz


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
        cdr.in_a_list(cdr.battery_block(times, np.full(200, 50.0), np.full(200, -6.0))),
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
            cdr.in_a_list(
                cdr.joint_state_block(times, feet, effort=np.tile([4.0, 1.0, 3.0, 2.0], (800, 1)))
            ),
        ),
        '/imu': (cdr.IMU, times, cdr.in_a_list(cdr.imu_block(times, turn, rate, -rate))),
        '/cmd_vel': (
            cdr.TWIST_STAMPED,
            times[[0, 400]],
            cdr.in_a_list(
                cdr.twist_block(times[[0, 400]], np.array([[0.5, 0, 0], [0, 0.25, 1.0]]))
            ),
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
        cdr.in_a_list(cdr.joint_state_block(times, ['LF_FOOT'], effort=np.ones((len(times), 1)))),
    )
    data = aligned(sketch, tmp_path, smooth=False, rate=400.0)
    assert len(spans(data)) == 1
    missing = np.isnan(data.extras['foot_force'][:, 0])
    time = seconds(data)
    np.testing.assert_array_equal(missing, (time > 0.9976) & (time < 1.4999))


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


def test_a_cubic_passes_exactly_through_a_cubic() -> None:
    time = np.arange(10) * 0.0025
    stream = Stream.of(time, ((time * 400) ** 3)[:, None].astype(np.float32))
    grid = np.arange(0.001, 0.0224, 0.0025)
    np.testing.assert_allclose(stream.sample(grid)[:, 0], (grid * 400) ** 3, rtol=1e-4, atol=1e-4)


def test_holding_starts_with_the_first_value() -> None:
    values = np.array([[1.0, np.nan], [np.nan, 5.0], [3.0, 6.0]])
    result = held(np.array([0.0, 1.0, 2.0]), values, np.array([-0.5, 0.0, 1.5, 2.0, 9.0]))
    np.testing.assert_array_equal(result, [[np.nan, np.nan], [1, np.nan], [1, 5], [3, 6], [3, 6]])
