from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects.signals import pieces
from power_estimator.effects.signals.prepared import prepare
from power_estimator.effects.signals.reducer import REDUCED_RATE, Reducer
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

RATE = 400.0


def dataset(seconds=30.0, *, lag=0.004, seed=0, gap=None):
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    phase = np.array([0.0, 1.0])
    position = 0.4 * np.sin(2 * np.pi * 1.7 * time[:, None] + phase)
    velocity = 0.4 * 2 * np.pi * 1.7 * np.cos(2 * np.pi * 1.7 * (time[:, None] - lag) + phase)
    torque = 10 + 5 * np.sin(2 * np.pi * 0.9 * time[:, None])
    torque = np.repeat(torque, 2, axis=1)
    power = torque * velocity + 8 + random.normal(0, 0.5, torque.shape)
    data = AlignedDataset.blank(
        RATE,
        ('a_hip', 'b_hip'),
        time + 50.0,
        'made',
        position=position,
        velocity=velocity,
        torque=torque,
        command=position,
        power=power,
        voltage=48.0,
        current=power / 48.0,
    )
    if gap is not None:
        data.segment[round(gap * RATE) :] = 1
    return data


def test_products_pass_unchanged_below_the_cutoff_and_vanish_above():
    reducer = Reducer(RATE, (slice(0, 4000),))
    time = np.arange(4000)[:, None] / RATE
    slow, fast = np.sin(2 * np.pi * 3.0 * time), np.sin(2 * np.pi * 25.0 * time)
    centres = reducer.centres()
    assert reducer.reduce(np.ones((4000, 1))) == pytest.approx(1.0)
    assert reducer.reduce(slow)[:, 0] == pytest.approx(slow[centres, 0], abs=6e-3)
    assert np.abs(reducer.reduce(fast)).max() < 6e-3
    assert np.diff(centres).tolist() == [8] * (len(centres) - 1)


def test_a_shift_reads_the_signal_later():
    reducer = Reducer(RATE, (slice(0, 4000),))
    time = np.arange(4000) / RATE
    shifted = reducer.reduce(np.sin(2 * np.pi * 4.0 * time)[:, None], 0.0073)
    expected = np.sin(2 * np.pi * 4.0 * (time[reducer.centres()] + 0.0073))
    assert shifted[:, 0] == pytest.approx(expected, abs=6e-3)


def test_nothing_is_carried_across_a_gap():
    data = dataset(gap=14.0)
    prepared = prepare(data)
    edges = data.time[round(14.0 * RATE)]
    assert np.abs(prepared.time - edges).min() > 0.2
    assert len(prepared.reducer.stretches()) == 2


@pytest.mark.parametrize('lag', [0.0, 0.004, 0.008])
def test_the_lag_of_the_velocity_is_found_from_position_and_velocity(lag):
    prepared = prepare(dataset(lag=lag))
    assert prepared.lag == pytest.approx([lag, lag], abs=3e-4)


def test_power_can_be_read_at_any_delay():
    prepared = prepare(dataset())
    at = prepared.power_at(0.0034)
    between = prepared.reducer.reduce(np.asarray(dataset().power, float), 0.0034)
    assert at == pytest.approx(between, abs=0.02)


def test_the_noise_of_the_meter_is_estimated_after_the_low_pass():
    prepared = prepare(dataset(seconds=60.0))
    taps = prepared.reducer._taps(0.0)
    assert prepared.noise == pytest.approx(0.5 * np.sqrt(np.sum(taps**2)), rel=0.25)


def test_degrees_among_radians_are_refused():
    data = dataset()
    with pytest.raises(InputError, match=r'a_hip: .*radians'):
        prepare(replace(data, position=np.rad2deg(data.position)))


def test_data_without_electrical_measurement_are_refused():
    data = dataset()
    with pytest.raises(InputError, match=r'no drive has electrical data .*made'):
        prepare(replace(data, power=np.full_like(data.power, np.nan)))


def test_a_drive_without_torque_is_named():
    data = dataset()
    torque = data.torque.copy()
    torque[:, 1] = np.nan
    with pytest.raises(InputError, match='b_hip has no torque'):
        prepare(replace(data, torque=torque))


def test_only_measured_drives_are_prepared():
    data = dataset()
    power = data.power.copy()
    power[:, 0] = np.nan
    prepared = prepare(replace(data, power=power))
    assert prepared.names == ('b_hip',)
    assert prepared.seconds == pytest.approx(len(prepared.time) / REDUCED_RATE)


def test_an_unknown_value_is_unknown_in_just_those_reduced_values_that_it_counts_in():
    values = np.ones((4000, 2))
    values[2000, 1] = np.nan
    reducer = Reducer(RATE, (slice(0, 4000),))
    found = reducer.reduce(values)
    near = np.abs(reducer.centres() - 2000) / RATE <= 0.2
    assert np.isnan(found[near, 1]).mean() > 0.9
    assert found[~near, 1] == pytest.approx(1.0)
    assert found[:, 0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ('rate', 'factor'), [(400.0, 16), (100.0, 4), (60.0, 2), (50.0, 2), (40.0, 1)]
)
def test_sparse_rows_are_no_fewer_than_25_a_second(rate, factor):
    sparse = Reducer(rate, (slice(0, 4000),)).sparse()
    assert sparse.factor == factor
    assert sparse.sparse() == sparse
    assert Reducer(rate, (slice(0, 4000),), steady=True).sparse().factor == 1


@pytest.mark.parametrize(
    ('rate', 'samples'), [(400.0, 999 + 974), (1000.0, 399 + 389), (80.0, 8000)]
)
def test_means_of_a_few_samples_are_reduced_as_all_of_them_are(rate, samples):
    """Of 400 a second 100 are left; a mean over 10 ms takes 0.13 % off 3 Hz."""
    reducer = Reducer(rate, (slice(0, 4000), slice(4100, 8000))).sparse()
    slow = np.sin(2 * np.pi * 3.0 * np.arange(8000) / rate)
    thin = reducer.thin(slow[:, None])
    assert len(thin) == samples
    assert reducer.reduce_thin(thin)[:, 0] == pytest.approx(reducer.reduce(slow), abs=2e-3)
    slow_meter = replace(reducer, window=0.5)
    assert slow_meter.reduce_thin(slow_meter.thin(slow)) == pytest.approx(slow_meter.reduce(slow))


def test_a_stretch_without_samples_adds_none():
    reducer = Reducer(RATE, (slice(0, 4000), slice(5000, 5000))).sparse()
    values = np.ones(5000)
    assert reducer.reduce_thin(reducer.thin(values)) == pytest.approx(reducer.reduce(values))


def test_sparse_rows_are_every_second_row_of_each_stretch():
    prepared = prepare(dataset(gap=14.0))
    sparse = pieces.sparse(prepared)
    first, second = prepared.reducer.stretches()
    rows = [*range(first.start, first.stop, 2), *range(second.start, second.stop, 2)]
    assert sparse.time == pytest.approx(prepared.time[rows])
    assert sparse.power == pytest.approx(prepared.power[:, rows])
    velocity = prepared.signals.velocity
    assert sparse.reduced(velocity) == pytest.approx(prepared.reduced(velocity)[rows])
    assert sparse.seconds == pytest.approx(prepared.seconds, abs=2 / REDUCED_RATE)
