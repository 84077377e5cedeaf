import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from power_daq.clock.mapping import ClockMapping, RosTime, WrappingCounter, line_below

MS = 1_000_000
FLOOR = 50_000


class Device:
    """A device that samples each ms of true time, and a bus that delays its frames."""

    def __init__(self, seed=0, drift=0.0, start=0.0, mean_delay=0.5e-3, bursts=1.0):
        self.rng = np.random.default_rng(seed)
        self.drift, self.start = drift, start
        self.mean_delay, self.bursts = mean_delay, bursts
        self.mapping = ClockMapping(1000.0, 32)

    def run(self, seconds, begin=0.0, floor=FLOOR):
        """Stamp error in ns per sample; NaN while the mapping is not settled."""
        truth = begin + np.arange(0.0, seconds, 1e-3)
        device = self.start + (1 + self.drift) * truth
        arrival = truth + floor * 1e-9 + self.rng.exponential(self.mean_delay, len(truth))
        for at in self.rng.uniform(
            begin, begin + seconds, self.rng.poisson(self.bursts * seconds)
        ):
            end = at + self.rng.uniform(5e-3, 20e-3)
            arrival[(arrival > at) & (arrival < end)] = end
        arrival = np.maximum.accumulate(arrival)
        raw = np.round(device * 1e6).astype(np.int64) % 2**32
        errors = np.full(len(truth), np.nan)
        stamps = []
        for k, (ticks, time) in enumerate(
            zip(raw.tolist(), (1e9 * (1000 + arrival)).astype(np.int64).tolist(), strict=True)
        ):
            stamp = self.mapping.to_steady(self.mapping.update(ticks, time))
            if self.mapping.settled:
                errors[k] = stamp - 1e9 * (1000 + truth[k])
                stamps.append(stamp)
        if self.mapping.epoch == 0:
            assert (np.diff(stamps) > 0).all()
        return errors


def p99(errors):
    return np.nanpercentile(np.abs(errors), 99)


@pytest.mark.parametrize('drift', [-100e-6, 0.0, 100e-6])
@pytest.mark.parametrize('mean_delay', [0.1e-3, 1e-3])
def test_stamps_are_within_a_fifth_of_a_millisecond_of_the_truth(drift, mean_delay):
    device = Device(seed=1, drift=drift, mean_delay=mean_delay, bursts=2.0)
    errors = device.run(20.0)
    assert np.isfinite(errors[400:]).all()
    assert p99(errors) < 200_000
    assert p99(errors[5000:]) < FLOOR + 30_000
    assert device.mapping.drift == pytest.approx(-drift / (1 + drift), abs=2e-6)
    assert device.mapping.epoch == 0


def test_a_device_clock_that_wraps_is_followed_without_a_new_epoch():
    device = Device(seed=2, start=2**32 * 1e-6 - 3.0)
    assert p99(device.run(8.0)) < 200_000
    assert device.mapping.epoch == 0
    assert device.mapping.update(5_000_000, 1008 * 1000 * MS) == (2**32 + 5_000_000) * 1000


def test_the_clock_is_followed_through_a_silence_longer_than_its_wrap():
    device = Device(seed=3, drift=20e-6)
    device.run(10.0)
    assert p99(device.run(5.0, begin=10.0 + 1.5 * 2**32 * 1e-6)) < 200_000
    assert device.mapping.epoch == 0


@pytest.mark.parametrize('jump', [-2000.0, -1.0, 0.05, 1500.0])
def test_a_clock_that_jumps_begins_a_new_epoch_and_is_followed_again(jump):
    device = Device(seed=4, drift=50e-6, start=2100.0)
    device.run(10.0)
    device.start += jump
    errors = device.run(10.0, begin=10.0)
    assert device.mapping.epoch == 1
    assert np.isnan(errors[:100]).all()
    assert p99(errors) < 200_000


def test_a_device_that_starts_again_counts_its_time_from_zero():
    mapping = ClockMapping(1000.0, 32)
    mapping.update(70_000_000, 1000 * MS)
    assert mapping.update(12, 1001 * MS) == 12_000
    assert mapping.epoch == 1


def test_a_clock_put_back_a_little_is_noticed_at_once():
    device = Device(seed=5)
    device.run(10.0)
    device.start -= 0.03
    errors = device.run(10.0, begin=10.0)
    assert device.mapping.epoch == 1
    assert p99(errors[1000:]) < 200_000


def test_a_bus_that_becomes_slower_or_faster_for_good_is_followed():
    device = Device(seed=6, mean_delay=0.2e-3)
    device.run(10.0, floor=FLOOR)
    slower = device.run(30.0, begin=10.0, floor=3 * MS)
    assert np.nanmedian(slower[25_000:]) == pytest.approx(3 * MS, abs=100_000)
    faster = device.run(10.0, begin=40.0, floor=FLOOR)
    assert p99(faster[500:]) < 200_000
    assert device.mapping.epoch == 0


def test_a_sender_that_falls_seconds_behind_and_catches_up_bends_no_stamp():
    device = Device(seed=9, drift=20e-6, bursts=0.0)
    device.run(10.0)
    for k in range(8000):
        truth = 10.0 + 1e-3 * k
        behind = min(0.4 * (truth - 10.0), max(0.0, 2.0 - 0.8 * (truth - 15.0)))
        ticks = round((1 + 20e-6) * truth * 1e6)
        arrival = round(1e9 * (1000 + truth + behind)) + FLOOR
        stamp = device.mapping.to_steady(device.mapping.update(ticks, arrival))
        assert abs(stamp - 1e9 * (1000 + truth)) < 200_000
    assert device.mapping.epoch == 0


@pytest.mark.parametrize(
    ('since', 'lost'), [(0.0, 0), (0.0, 4), (10.0, 150)], ids=['at the start', 'losing', 'later']
)
def test_a_sender_that_was_late_for_long_has_not_started_again(since, lost):
    device = Device(seed=9, bursts=0.0)
    if since:
        device.run(since)
    drops = range(40_000, 40_000 + lost)
    for k in range(60_000):
        truth = since + 1e-3 * k
        behind = 0.2 if k < 40_000 + lost else max(0.0, 0.2 - (truth - since - 40.0))
        if k not in drops:
            arrival = round(1e9 * (1000 + truth + behind)) + FLOOR
            time = device.mapping.update(round(truth * 1e6), arrival)
            assert device.mapping.settled or truth < 1.0
    assert abs(device.mapping.to_steady(time) - 1e9 * (1000 + truth)) < 200_000


def test_frames_read_late_after_a_pause_of_this_process_do_not_bend_the_fit():
    device = Device(seed=7)
    device.run(10.0)
    device.bursts = 0.0
    late = Device(seed=8)
    late.mapping = device.mapping
    ticks = np.arange(10_000_000, 12_000_000, 1000)
    for k in ticks.tolist():
        stamp = device.mapping.to_steady(device.mapping.update(k, (1_012_000_000 + 5) * 1000))
        assert abs(stamp - (1_000_000_000 + k) * 1000) < 200_000
    assert device.mapping.epoch == 0
    assert p99(device.run(5.0, begin=12.0)) < 200_000


@given(st.integers(2, 32), st.integers(0, 2**40), st.integers(0, 2**40), st.data())
def test_a_counter_is_unwrapped_as_long_as_the_guess_is_off_by_less_than_half(
    bits, start, steps, data
):
    size = 1 << bits
    guess = steps + data.draw(st.integers(-(size // 2) + 1, size // 2 - 1))
    counter = WrappingCounter(bits)
    assert counter.advance(start % size, (start + steps) % size, guess) == steps


def test_the_line_below_touches_the_least_delayed_points():
    delays = [5, 0, 9, 3, 7, 9, 0, 8, 2]
    points = [(10 * k, 1000 + 20 * k + delay) for k, delay in enumerate(delays)]
    (x, y), slope = line_below(points, 10.0)
    assert slope == pytest.approx(2.0)
    assert y - slope * x == pytest.approx(1000)
    assert line_below(points, 1.0) is None
    assert line_below([(0, 0)], 1.0) is None


def test_a_step_of_the_system_clock_is_followed_and_counted():
    class Clocks:
        steady, step = 0, 5_000_000_000

    ros = RosTime(lambda: Clocks.steady + Clocks.step, lambda: Clocks.steady)
    assert ros.of(7) == 5_000_000_007
    Clocks.steady, Clocks.step = 50 * MS, 9_000_000_000
    ros.follow(Clocks.steady)
    assert ros.steps == 0
    Clocks.steady = 150 * MS
    ros.follow(Clocks.steady)
    assert (ros.steps, ros.of(7)) == (1, 9_000_000_007)
    Clocks.steady, Clocks.step = 300 * MS, 9_000_010_000
    ros.follow(Clocks.steady)
    assert (ros.steps, ros.of(7)) == (1, 9_000_010_007)
