import numpy as np
import pytest
from power_daq.supply.energy_counters import EnergyCounter, PowerBalance

S = 1_000_000_000
DRIVES = ('LF_HAA', 'LF_HFE', 'LF_KFE')


def test_a_hundred_watts_for_36_seconds_are_one_watt_hour():
    counter = EnergyCounter()
    for i in range(3601):
        counter.add(i * S // 100, 100.0)
    energy = counter.total()
    assert energy.joule == pytest.approx(3600.0)
    assert energy.watt_hours == pytest.approx(1.0)
    assert energy.seconds == pytest.approx(36.0)


def test_a_ramp_is_counted_by_its_mean():
    counter = EnergyCounter()
    for i in range(101):
        counter.add(i * S // 100, 2.0 * i)
    assert counter.total().joule == pytest.approx(100.0)


def test_power_given_back_is_taken_off():
    counter = EnergyCounter()
    for i, power in enumerate([50.0, 50.0, -50.0, -50.0]):
        counter.add(i * S // 100, power)
    assert counter.total().joule == pytest.approx(0.0)


def test_nothing_is_counted_across_a_gap_and_its_length_is_told():
    counter = EnergyCounter(period=0.01)
    for time in (0.0, 0.05, 5.05, 5.1):
        counter.add(round(time * S), 100.0)
    energy = counter.total()
    assert energy.joule == pytest.approx(10.0)
    assert (energy.seconds, energy.uncounted) == (pytest.approx(0.1), pytest.approx(5.0))


def test_a_reading_that_is_no_number_and_a_clock_that_goes_back_add_nothing():
    counter = EnergyCounter(period=0.05)
    readings = ((0.0, 100.0), (0.1, 100.0), (0.2, float('nan')), (0.3, 100.0), (0.1, 100.0))
    for time, power in readings:
        counter.add(round(time * S), power)
    energy = counter.total()
    assert energy.joule == pytest.approx(10.0)
    assert (energy.seconds, energy.uncounted) == (pytest.approx(0.1), pytest.approx(0.2))


def test_a_reset_tells_what_was_counted_and_goes_on_from_zero():
    counter = EnergyCounter()
    counter.add(0, 100.0)
    counter.add(S // 100, 100.0)
    assert counter.reset().joule == pytest.approx(1.0)
    counter.add(2 * S // 100, 100.0)
    assert counter.total().joule == pytest.approx(1.0)


def feed(balance, second, supply, drives, device='board', names=DRIVES, until=1.0):
    start = second * S
    if supply is not None:
        for i in range(round(100 * until)):
            balance.add_supply(start + i * S // 100, supply)
    if drives is not None:
        stamps = start + np.arange(round(1000 * until), dtype=np.int64) * (S // 1000)
        balance.add_drives(stamps, device, names, np.tile(drives, (len(stamps), 1)))


def test_what_the_drives_leave_over_is_the_electronics():
    balance = PowerBalance()
    for second in range(100, 104):
        feed(balance, second, 120.0, [30.0, 40.0, 26.0])
    found = balance.report()
    assert (found.supply, found.drives) == (pytest.approx(120.0), pytest.approx(96.0))
    assert found.rest == pytest.approx(24.0)
    assert found.names == DRIVES


def test_the_mean_is_of_the_last_thirty_seconds():
    balance = PowerBalance()
    for i in range(42):
        feed(balance, 100 + i, 120.0 if i < 10 else 150.0, [30.0, 40.0, 26.0])
        found = balance.report()
    assert found.seconds == 30
    assert found.rest_mean == pytest.approx(54.0)


def test_a_second_that_one_side_saw_in_part_does_not_count():
    balance = PowerBalance()
    feed(balance, 100, 120.0, [30.0, 40.0, 26.0])
    feed(balance, 101, 500.0, [30.0, 40.0, 26.0], until=0.5)
    feed(balance, 102, 500.0, None)
    feed(balance, 103, None, [500.0, 0.0, 0.0])
    feed(balance, 106, 1.0, None)
    assert balance.report().rest_mean == pytest.approx(24.0)


def test_samples_of_two_seconds_in_one_message_are_told_apart():
    balance = PowerBalance()
    for second in (100, 101):
        feed(balance, second, 10.0, None)
    stamps = np.arange(100 * S, 102 * S, S // 1000, dtype=np.int64)
    balance.add_drives(stamps, 'board', ('a',), np.repeat([[1.0], [3.0]], 1000, axis=0))
    balance.add_supply(104 * S, 10.0)
    found = balance.report()
    assert (found.drives, found.rest_mean) == (pytest.approx(3.0), pytest.approx(8.0))


def test_a_drive_that_two_devices_measure_counts_once():
    balance = PowerBalance()
    feed(balance, 100, 120.0, [30.0, 40.0, 26.0])
    feed(balance, 100, None, [31.0], device='ethercat', names=('LF_HAA',))
    feed(balance, 100, None, [5.0], device='ethercat', names=('RF_HAA',))
    feed(balance, 103, 1.0, None)
    assert balance.report().drives == pytest.approx(101.0)


def test_without_drives_there_is_no_balance_and_an_old_one_goes():
    balance = PowerBalance()
    assert balance.report() is None
    feed(balance, 100, 120.0, [30.0, 40.0, 26.0])
    feed(balance, 103, 120.0, None)
    assert balance.report() is not None
    feed(balance, 200, 120.0, None)
    assert balance.report() is None


def test_a_clock_that_steps_back_starts_the_comparison_over():
    balance = PowerBalance()
    feed(balance, 5000, 999.0, [1.0, 1.0, 1.0])
    for second in range(100, 104):
        feed(balance, second, 120.0, [30.0, 40.0, 26.0])
    assert balance.report().rest_mean == pytest.approx(24.0)
