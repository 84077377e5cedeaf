"""Energy that the supply gives is work, a loss that has a name, or stored."""

import numpy as np
import pytest
from energy_balance import BalancedSimulation
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Effects, Plant
from sim_bridge.plant.simulation import STEP, Simulation
from sim_bridge.plant.world import Stand, stand_world, walking_world
from wattwalk_core.anymal import DEFAULT_POSE

EFFECTS = [name for name, _ in Effects() if name != 'cross_talk']
CHANNELS = {
    'coulomb_friction': 'coulomb_friction',
    'viscous_friction': 'viscous_friction',
    'stribeck_friction': 'stribeck_friction',
    'load_friction': 'load_friction',
    'position_rub': 'position_rub',
    'copper_loss': 'copper_loss',
    'iron_loss': 'iron_loss',
    'inverter_loss': 'inverter_loss',
    'idle': 'idle',
    'fan': 'fan',
    'line_resistance': 'line_resistance',
    'regeneration_efficiency': 'regeneration_efficiency',
    'regeneration_limit': 'regeneration_limit',
    'rotor_inertia': 'rotor',
    'spring': 'spring',
    'cogging': 'cogging_field',
}


def alone(name, strength=1.0):
    plant = Plant.load('ideal')
    others = {'spring': {'rotor_inertia': True}, 'field_weakening': {'copper_loss': True}}
    others['torque_loop'] = {'rotor_inertia': True, 'spring': True}
    return plant.with_effects(**others.get(name, {}), **{name: strength})


def swung(plant, duration=1.5, seed=1, load=None):
    """One drive swings a pendulum through random targets, its whole speed range."""
    load = Stand(inertia=0.05, mass=3.0, length=0.4) if load is None else load
    simulation = BalancedSimulation(plant, stand_world('LF_KFE', load))
    random = np.random.default_rng(seed)
    for _ in range(round(duration / 0.05)):
        simulation.hold(JointCommand(position=random.uniform(-2.0, 2.0, 1)))
        simulation.advance(100)
    return simulation


def paced(plant, duration=2.0, seed=0):
    """All twelve drives in motions as large as those of walking."""
    simulation = BalancedSimulation(plant, walking_world())
    random = np.random.default_rng(seed)
    phase = random.uniform(0.0, 2 * np.pi, 12)
    size = np.tile([0.1, 0.25, 0.4], 4)
    for _ in range(round(duration / 0.02)):
        swing = size * np.sin(2 * np.pi * 1.8 * simulation.time + phase)
        simulation.hold(JointCommand(position=DEFAULT_POSE + swing + random.normal(0, 0.02, 12)))
        simulation.advance(40)
    return simulation


@pytest.mark.parametrize('name', EFFECTS)
def test_energy_balances_with_each_effect_alone(name):
    balance = swung(alone(name)).energy_balance
    assert abs(balance.residual) < 0.005 * balance.turnover


@pytest.mark.parametrize('name', CHANNELS)
def test_an_effect_alone_moves_energy_through_its_own_channel_and_no_other(name):
    energy = swung(alone(name)).energy_balance.energy
    moved = {channel for channel, value in energy.items() if abs(value) > 1e-6}
    free = {'supply', 'shaft', 'capacitor', 'capacitor_resistance', 'supply_line', 'rotor'}
    free |= {'spring_damping'} if name == 'spring' else set()
    assert CHANNELS[name] in moved
    assert moved - free <= {CHANNELS[name]}


@pytest.mark.parametrize('unit', [0, 5])
def test_energy_balances_on_walking_motion_with_everything_on(unit):
    plant = Plant.load('anymal_c').with_effects(position_rub=True, fan=True).unit(unit)
    balance = paced(plant).energy_balance
    assert balance.supplied > 100.0
    assert abs(balance.residual) < 0.005 * balance.supplied
    assert all(value >= -1e-9 for value in balance.losses.values())


def test_work_at_the_joint_is_the_change_of_the_loads_mechanical_energy():
    load = Stand(inertia=0.05, mass=3.0, length=0.4)
    simulation = swung(Plant.load('anymal_c'), load=load)
    q, w = simulation.joint_position[0], simulation.joint_velocity[0]
    inertia = load.inertia + 1e-5 + load.mass * load.length**2
    held = 0.5 * inertia * w**2 + load.mass * 9.81 * load.length * (1.0 - np.cos(q))
    assert simulation.energy_balance.energy['shaft'] == pytest.approx(held, abs=0.02)


def test_power_at_the_meter_and_the_loss_before_it_are_what_the_supply_gives():
    simulation = BalancedSimulation(Plant.load('anymal_c'), stand_world('LF_HFE'))
    metered = 0.0
    for target in (0.8, -0.8) * 4:
        simulation.hold(JointCommand(position=np.array([target])))
        metered += simulation.advance(200).power.sum() * STEP
    energy = simulation.energy_balance.energy
    outside = sum(energy[name] for name in ('supply_line', 'capacitor', 'capacitor_resistance'))
    assert metered == pytest.approx(energy['supply'] - outside, rel=1e-6)


@pytest.mark.parametrize('name', ['copper_loss', 'coulomb_friction', 'iron_loss', 'idle'])
def test_twice_the_strength_is_about_twice_the_loss(name):
    once, twice = (swung(alone(name, s)).energy_balance.losses[CHANNELS[name]] for s in (0.2, 0.4))
    assert twice / once == pytest.approx(2.0, rel=0.15)


def test_results_do_not_depend_on_how_a_run_is_cut_into_blocks():
    plant = Plant.load('anymal_c').with_effects(fan=True)
    whole, cut = (Simulation(plant, walking_world()) for _ in range(2))
    command = JointCommand(position=DEFAULT_POSE + 0.1)
    powers = []
    for simulation, sizes in ((whole, [200]), (cut, [2, 3, 1, 94, 10, 27, 63])):
        simulation.hold(command)
        simulation.push(np.array([0.2, -0.3, 0.0]))
        powers.append(np.vstack([simulation.advance(size).power for size in sizes]))
    np.testing.assert_allclose(powers[0], powers[1], rtol=1e-9, atol=1e-9)
