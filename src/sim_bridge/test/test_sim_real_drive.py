"""Effects that real drives have beside the usual ones: off unless a plant has them on."""

from dataclasses import replace

import numpy as np
import pytest
from sim_bridge.plant.circuit import Bus, Circuit
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Effects, Plant
from sim_bridge.plant.simulation import STEP, Simulation
from sim_bridge.plant.world import Stand, stand_world, walking_world
from sim_bridge.sensors.blocks import Instruments
from wattwalk_core.anymal import DEFAULT_POSE
from wattwalk_core.errors import InputError

OFF = {
    'drives': {
        'loop_bandwidth': 33.0,
        'loop_delay': 0.002,
        'current_bandwidth': 200.0,
        'torque_ripple': 0.1,
        'dead_time': 0.05,
        'dead_torque': 5.0,
        'magnet_coefficient': 0.01,
    },
    'supply': {'battery_resistance': 2.0},
    'meter': {'slow_bandwidth': 5.0},
    'sensors': {'torque_hysteresis': 3.0, 'eccentricity': 0.05},
}
NAMES = (
    *('torque_loop', 'torque_ripple', 'dead_time', 'magnet_heating', 'battery'),
    *('encoder_eccentricity', 'torque_hysteresis', 'meter_filter'),
)
LOCKED = Stand(inertia=100.0)


def changed(plant):
    drives = {name: replace(one, **OFF['drives']) for name, one in plant.drive_types.items()}
    others = {name: replace(getattr(plant, name), **OFF[name]) for name in OFF if name != 'drives'}
    return replace(plant, drive_types=drives, **others)


def readings(plant):
    simulation = Simulation(plant, walking_world())
    instruments = Instruments(simulation, 4)
    simulation.hold(JointCommand(position=DEFAULT_POSE + 0.2))
    return [instruments.read(simulation.advance(200)) for _ in range(3)]


def test_parameters_of_what_is_off_change_no_reading_to_the_bit():
    plant = Plant.load('anymal_c').unit(2)
    assert not any(getattr(plant.effects, name).enabled for name in NAMES)
    for one, other in zip(readings(plant), readings(changed(plant)), strict=True):
        for part in ('electrical', 'joints', 'temperature', 'supply'):
            for mine, its in zip(
                vars(getattr(one, part)).values(), vars(getattr(other, part)).values(), strict=True
            ):
                np.testing.assert_array_equal(mine, its)


def test_each_of_them_changes_a_reading_when_it_is_on():
    usual = readings(Plant.load('anymal_c'))[-1]
    for name in NAMES:
        found = readings(Plant.load('anymal_c').with_effects(**{name: True}))[-1]
        same = [
            np.array_equal(mine, its)
            for part in ('electrical', 'joints')
            for mine, its in zip(
                vars(getattr(usual, part)).values(),
                vars(getattr(found, part)).values(),
                strict=True,
            )
        ]
        assert not all(same), name


def test_a_torque_loop_needs_the_spring_that_it_reads():
    with pytest.raises(InputError, match='torque_loop is on without spring'):
        Effects.parse({'torque_loop': True})


def amplitude(plant, frequency):
    """Torque on a locked joint against the torque asked for, beyond what dies out first."""
    simulation = Simulation(plant, stand_world('LF_KFE', LOCKED))
    torques = []
    for index in range(2000):
        effort = 10.0 * np.sin(2 * np.pi * frequency * index * STEP)
        simulation.hold(JointCommand(effort=np.array([effort])))
        torques.append(simulation.advance(1).torque[0, 0])
    return np.std(torques[1000:]) / (10.0 / np.sqrt(2))


def test_a_torque_loop_moves_the_springs_resonance_to_its_bandwidth():
    spring = Plant.load('ideal').with_effects(spring=True, rotor_inertia=True)
    loop = spring.with_effects(torque_loop=True)
    p = spring.parameters('LF_KFE')
    alone = np.sqrt(p.spring_stiffness / p.rotor_inertia) / (2 * np.pi)
    assert alone == pytest.approx(12.25, abs=0.01)
    assert amplitude(spring, 25.0) < 0.5
    assert 0.65 < amplitude(loop, 25.0) < 1.3


def test_a_command_reaches_the_drives_after_the_plants_delay():
    plant = replace(Plant.load('ideal'), command_delay=0.0075)
    simulation = Simulation(plant, stand_world('LF_KFE', LOCKED))
    simulation.hold(JointCommand(effort=np.array([10.0])))
    simulation.advance(5)
    simulation.hold(JointCommand(effort=np.array([4.0])))
    torque = [simulation.advance(1).torque[0, 0] for _ in range(16)]
    np.testing.assert_allclose(torque, [0.0] * 10 + [10.0] * 5 + [4.0], atol=1e-6)


def test_ripple_is_a_share_of_the_torque_and_periodic():
    plant = Plant.load('ideal').with_effects(torque_ripple=True)
    simulation = Simulation(plant, stand_world('LF_KFE', Stand(inertia=0.5)))
    simulation.hold(JointCommand(effort=np.array([20.0])))
    simulation.advance(100)
    motor = simulation.drives.trace.motor[:100, 0]
    ripple = plant.parameters('LF_KFE').torque_ripple
    assert np.abs(motor / 20.0 - 1.0).max() == pytest.approx(ripple, rel=0.02)


def test_dead_time_takes_torque_around_no_current_and_heats_the_bridge():
    plant = Plant.load('ideal').with_effects(dead_time=True, inverter_loss=True)
    simulation = Simulation(plant, stand_world('LF_KFE', LOCKED))
    simulation.hold(JointCommand(effort=np.array([20.0])))
    block = simulation.advance(10)
    assert block.torque[-1, 0] == pytest.approx(20.0 - plant.parameters('LF_KFE').dead_torque)

    def bridge(plant):
        circuit = Circuit(plant, ('LF_KFE',), plant.resolve(('LF_KFE',)))
        arguments = np.full((1, 1), 20.0), np.zeros((1, 1)), np.zeros((1, 1)), 48.0, np.zeros(1)
        flow = circuit.solve(*arguments)
        return flow.inverter[0, 0] / flow.current[0, 0]

    more = bridge(plant) - bridge(plant.with_effects(dead_time=False))
    assert more == pytest.approx(2 * 0.02 * 0.9)


def test_warm_magnets_ask_for_more_current():
    plant = Plant.load('ideal').with_effects(magnet_heating=True)
    circuit = Circuit(plant, ('LF_KFE',), plant.resolve(('LF_KFE',)))
    circuit.temperature.housing[:] = 75.0
    assert circuit.constant()[0] == pytest.approx(5.4 * (1 - 0.001 * 50.0))


def test_a_battery_sags_by_its_current():
    plant = Plant.load('ideal').with_effects(battery=True)
    result = Bus(plant, plant.resolve(('LF_KFE',)), STEP).solve(np.full((400, 1), 480.0))
    current = 480.0 / result.voltage[-1]
    assert result.voltage[-1] == pytest.approx(48.0 - 0.1 * current, rel=1e-3)


def test_hysteresis_and_eccentricity_are_in_the_readings_alone():
    def swung(**effects):
        plant = Plant.load('ideal').with_effects(**effects)
        quiet = {'position_noise': 0.0, 'velocity_noise': 0.0, 'torque_noise': 0.0}
        plant = replace(plant, sensors=replace(plant.sensors, **quiet))
        simulation = Simulation(plant, stand_world('LF_KFE', Stand(inertia=0.05, mass=3.0)))
        instruments, joints = Instruments(simulation, 0), []
        for index in range(40):
            simulation.hold(JointCommand(position=np.array([1.0 if index % 4 < 2 else -1.0])))
            joints.append(instruments.read(simulation.advance(200)).joints)
        return [
            np.concatenate([getattr(part, name) for part in joints])
            for name in ('position', 'velocity', 'torque')
        ]

    position, velocity, torque = swung()
    late = swung(torque_hysteresis=True)[2] - torque
    assert late.max() == pytest.approx(0.5)
    assert late.min() == pytest.approx(-0.5)
    turned, faster, _ = swung(encoder_eccentricity=True)
    np.testing.assert_allclose(turned - position, 2e-3 * np.sin(position), atol=1e-12)
    moving = np.abs(velocity) > 1.0
    assert np.abs(faster[moving] / velocity[moving] - 1.0).max() == pytest.approx(2e-3, rel=0.2)
