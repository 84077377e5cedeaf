from dataclasses import replace

import numpy as np
import pytest
from sim_bridge.plant.parameters import MeterParameters, Plant
from sim_bridge.plant.simulation import STEP, PlantBlock, Simulation
from sim_bridge.plant.world import stand_world, walking_world
from sim_bridge.sensors.blocks import Instruments
from sim_bridge.sensors.sensors import (
    OVERRANGE,
    UNDERRANGE,
    DeviceClock,
    FractionalDelay,
    JointSensors,
    LowPass,
    Meter,
    SupplySensor,
    into_base,
)
from wattwalk_core.anymal import DEFAULT_POSE, FOOT_NAMES

DRIVES = ('LF_HAA', 'LF_HFE', 'LF_KFE')


def block_of(current, *, voltage=48.0, first=0, velocity=0.0, torque=0.0):
    """A block with made-up signals; current [B, 3] A."""
    current = np.asarray(current, dtype=float)
    count = len(current)
    like = np.zeros_like(current)
    volts = np.broadcast_to(np.asarray(voltage, dtype=float), (count,)).copy()
    return PlantBlock(
        first=first,
        position=like,
        velocity=like + velocity,
        torque=like + torque,
        voltage=volts,
        power=current * volts[:, None],
        supply_current=current.sum(axis=1),
        temperature=np.full(3, 30.0),
        base=np.full((count, 13), np.nan),
        acceleration=np.full((count, 3), np.nan),
        foot_force=np.zeros((0, len(FOOT_NAMES))),
    )


def meter_of(plant=None, seed=0, **settings):
    plant = Plant.load('ideal') if plant is None else plant
    plant = replace(plant, meter=replace(plant.meter, **settings))
    return Meter(plant, plant.resolve(DRIVES), np.random.default_rng(seed))


def test_an_ideal_meter_reads_every_second_step():
    samples = meter_of().read(block_of(np.tile([1.0, 2.0, -3.0], (400, 1))))
    np.testing.assert_array_equal(samples.step, np.arange(2, 401, 2))
    np.testing.assert_allclose(samples.current[-1], [1.0, 2.0, -3.0], atol=1e-5)
    np.testing.assert_allclose(samples.voltage, 48.0, atol=1e-5)
    assert not samples.status.any()


def test_gain_and_offset_errors_are_those_of_the_plant():
    meter = meter_of(current_gain_error=0.02, current_offset=0.1, voltage_gain_error=-0.01)
    samples = meter.read(block_of(np.full((400, 3), 5.0)))
    np.testing.assert_allclose(samples.current[-1], 5.0 * 1.02 + 0.1, atol=1e-4)
    np.testing.assert_allclose(samples.voltage, 48.0 * 0.99, atol=1e-4)


def test_values_are_whole_numbers_of_converter_steps():
    samples = meter_of(bits=8).read(block_of(np.full((40, 3), 1.234)))
    counts = samples.current / (60.0 / 256)
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)
    assert abs(samples.current[-1, 0] - 1.234) < 60.0 / 256


def test_currents_beyond_the_range_are_clipped_and_flagged():
    samples = meter_of(current_range=10.0).read(block_of(np.tile([12.0, -12.0, 9.0], (400, 1))))
    assert samples.status[-1].tolist() == [OVERRANGE, UNDERRANGE, 0]
    assert samples.current.max() <= 10.0
    assert samples.current.min() >= -10.0


def test_noise_has_the_given_size_and_is_the_same_for_the_same_seed():
    read = [
        meter_of(seed=s, current_noise=0.05).read(block_of(np.zeros((8000, 3)))) for s in (1, 1, 2)
    ]
    assert read[0].current.std() == pytest.approx(0.05, rel=0.05)
    np.testing.assert_array_equal(read[0].current, read[1].current)
    assert not np.array_equal(read[0].current, read[2].current)


def test_a_delay_shifts_the_signal_by_that_time():
    ramp = np.arange(4000)[:, None] * STEP * np.ones(3)
    for delay in (0.25e-3, 0.4e-3, 3.1e-3):
        samples = meter_of(delay=delay, bandwidth=900.0).read(block_of(ramp))
        filter_lag = meter_of(delay=0.25e-3, bandwidth=900.0).read(block_of(ramp)).current[-1, 0]
        lag = samples.step[-1] * STEP - samples.current[-1, 0]
        reference = samples.step[-1] * STEP - filter_lag
        assert lag - reference == pytest.approx(delay - 0.25e-3, abs=2e-5)


def test_bandwidth_halves_the_power_of_a_sine_at_that_frequency():
    time = np.arange(8000) * STEP
    wave = np.sin(2 * np.pi * 40.0 * time)[:, None] * np.ones(3)
    filtered = LowPass(40.0, np.zeros(3))(wave)[4000:]
    assert filtered.std() / wave[4000:].std() == pytest.approx(0.5**0.5, rel=0.05)


def test_cross_talk_mixes_a_neighbour_in():
    plant = Plant.load('ideal').with_effects(cross_talk=True)
    samples = meter_of(plant, cross_talk=0.1).read(block_of(np.tile([10.0, 0.0, 0.0], (400, 1))))
    assert sorted(samples.current[-1].round(3).tolist()) == [0.0, 1.0, 10.0]


@pytest.mark.parametrize('steps', [0.0, 0.3, 1.0, 5.7])
def test_delay_does_not_depend_on_block_sizes(steps):
    values = np.random.default_rng(0).normal(size=(60, 2))
    whole = FractionalDelay(steps, np.zeros(2))(values)
    cut = FractionalDelay(steps, np.zeros(2))
    parts = [cut(part) for part in np.split(values, [1, 3, 20, 21, 50])]
    np.testing.assert_allclose(np.vstack(parts), whole)
    if steps == 1.0:
        np.testing.assert_allclose(whole[1:], values[:-1])


def test_a_fast_device_clock_gains_its_drift():
    clock = DeviceClock.of(MeterParameters(clock_offset=3.0, clock_drift=100.0))
    step = np.array([0, 20_000_000])
    device, true = clock.device_ns(step), clock.elapsed_ns(step)
    assert device[0] == 3_000_000_000
    assert (device[1] - device[0]) / true[1] - 1.0 == pytest.approx(1e-4, rel=1e-6)


def test_reported_speed_lags_and_reported_torque_has_bias_and_bend():
    plant = Plant.load('ideal')
    sensors = replace(plant.sensors, velocity_bandwidth=40.0, torque_bias=0.5, torque_bend=0.1)
    plant = replace(plant, sensors=sensors)
    joints = JointSensors(plant, plant.resolve(DRIVES), np.random.default_rng(0))
    ramp = np.arange(2000)[:, None] * STEP * np.ones(3)
    samples = joints.read(block_of(ramp, velocity=ramp, torque=40.0))
    np.testing.assert_array_equal(samples.step, np.arange(5, 2001, 5))
    assert ramp[-1, 0] - samples.velocity[-1, 0] == pytest.approx(1 / (2 * np.pi * 40), abs=4e-4)
    np.testing.assert_allclose(samples.torque, 40.0 * (1 + 0.1 * 0.5) + 0.5)


def test_the_bench_supply_reads_negative_current_while_the_robot_draws():
    plant = Plant.load('anymal_c')
    sensor = SupplySensor(plant, np.random.default_rng(0))
    samples = sensor.read(block_of(np.full((4000, 3), 2.0)))
    assert len(samples.step) == 200
    expected = -(6.0 + plant.supply.electronics / plant.supply.voltage)
    assert samples.current.mean() == pytest.approx(expected, abs=0.3)
    assert (samples.current < 0.0).all()


def test_readings_do_not_depend_on_how_a_run_is_cut_into_blocks():
    plant = Plant.load('anymal_c')
    runs = []
    for sizes in ([200], [7, 1, 92, 60, 40]):
        simulation = Simulation(plant, walking_world())
        instruments = Instruments(simulation, seed=4)
        runs.append([instruments.read(simulation.advance(size)) for size in sizes])
    for pick in (
        lambda s: s.electrical.current,
        lambda s: s.electrical.step,
        lambda s: s.joints.velocity,
        lambda s: s.supply.current,
        lambda s: s.body.acceleration,
        lambda s: s.odometry.position,
    ):
        whole, cut = (np.concatenate([pick(samples) for samples in run]) for run in runs)
        np.testing.assert_allclose(whole, cut, atol=1e-9)


def test_a_standing_robot_feels_gravity_and_its_weight():
    from sim_bridge.plant.drive import JointCommand

    simulation = Simulation(Plant.load('anymal_c'), walking_world())
    instruments = Instruments(simulation, seed=0)
    simulation.hold(JointCommand(position=DEFAULT_POSE))
    for _ in range(5):
        body = instruments.read(simulation.advance(400)).body
    np.testing.assert_allclose(body.acceleration.mean(axis=0), [0.0, 0.0, 9.81], atol=0.6)
    weight = simulation.world.mass * 9.81
    assert body.foot_force.sum(axis=1).mean() == pytest.approx(weight, rel=0.03)


def test_a_quarter_turn_to_the_left_sees_the_worlds_x_axis_on_the_right():
    quarter = np.array([[np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]])
    seen = into_base(quarter, np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(seen, [[0.0, -1.0, 0.0]], atol=1e-12)


def test_a_stand_has_no_imu():
    simulation = Simulation(Plant.load('anymal_c'), stand_world('LF_KFE'))
    samples = Instruments(simulation, seed=0).read(simulation.advance(40))
    assert samples.body is None
    assert samples.odometry is None
