"""Each effect: sign, symmetry, zero when off, and figures that one can check by hand."""

from dataclasses import replace

import numpy as np
import pytest
from energy_balance import friction_parts
from sim_bridge.plant.circuit import Bus, Circuit
from sim_bridge.plant.drive import Drives, JointCommand, friction_table
from sim_bridge.plant.drive_steps import friction_torque
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import STEP, Simulation
from sim_bridge.plant.world import Stand, stand_world

DRIVE = ('LF_KFE',)
SPEEDS = np.linspace(-8.0, 8.0, 161)[:, None]


def ideal(**effects):
    return Plant.load('ideal').with_effects(**effects)


def drag(plant, velocity, motor=0.0, position=0.0):
    velocity = np.asarray(velocity, dtype=float)
    friction = friction_table(plant, plant.resolve(DRIVE), STEP)
    like = np.ones_like(velocity)
    return sum(friction_parts(friction, position * like, velocity, motor * like).values())


def flow(plant, motor, speed, voltage=48.0, time=0.0):
    circuit = Circuit(plant, DRIVE, plant.resolve(DRIVE))
    motor, speed = np.broadcast_arrays(np.atleast_2d(motor), np.atleast_2d(speed))
    times = np.full(len(motor), time)
    return circuit.solve(motor * 1.0, speed * 1.0, np.zeros(motor.shape), voltage, times)


@pytest.mark.parametrize('name', ['coulomb', 'viscous', 'stribeck', 'load'])
def test_friction_opposes_motion_and_is_zero_at_rest_and_when_off(name):
    effect = f'{name}_friction'
    force = drag(ideal(**{effect: True}), SPEEDS, motor=10.0)
    assert (force * SPEEDS >= 0.0).all()
    assert force[80] == 0.0
    assert abs(force).max() > 0.05
    assert not drag(ideal(), SPEEDS, motor=10.0).any()


@pytest.mark.parametrize('name', ['coulomb', 'viscous', 'stribeck', 'load'])
def test_friction_mirrors_when_the_whole_motion_is_mirrored(name):
    plant = ideal(**{f'{name}_friction': True})
    forward, backward = drag(plant, SPEEDS, 10.0), drag(plant, -SPEEDS, -10.0)
    np.testing.assert_allclose(forward, -backward)


def test_coulomb_friction_is_its_parameter_away_from_standstill():
    plant = ideal(coulomb_friction=True)
    assert drag(plant, [[1.0]]) == pytest.approx(plant.parameters('LF_KFE').coulomb, rel=1e-3)


def test_viscous_friction_starts_linear_and_thins_with_speed():
    plant = ideal(viscous_friction=True)
    slow, fast = drag(plant, [[0.01]]) / 0.01, drag(plant, [[8.0]]) / 8.0
    assert slow == pytest.approx(plant.parameters('LF_KFE').viscous, rel=1e-3)
    assert 0.7 * slow < fast < 0.95 * slow


def test_stribeck_friction_fades_with_speed():
    force = drag(ideal(stribeck_friction=True), [[0.2], [1.0], [4.0]])
    assert force[0] > 3 * force[1] > 9 * force[2] > 0.0


def test_load_friction_is_stronger_when_the_motor_drives_than_when_it_is_driven():
    plant = ideal(load_friction=True)
    driving, driven = drag(plant, [[2.0]], 20.0), drag(plant, [[2.0]], -20.0)
    share, skew = (
        getattr(plant.parameters('LF_KFE'), n) for n in ('load_friction', 'load_asymmetry')
    )
    assert driving == pytest.approx(20.0 * share * (1 + skew), rel=1e-6)
    assert driven == pytest.approx(20.0 * share * (1 - skew), rel=1e-6)


def test_a_rub_is_felt_at_its_angles_only():
    plant = ideal(position_rub=True)
    angle = plant.parameters('LF_KFE').rub_angle
    assert drag(plant, [[1.0]], position=angle) > 20 * drag(plant, [[1.0]], position=0.0)
    assert drag(plant, [[1.0]], position=angle) == drag(plant, [[1.0]], position=-angle)


def test_drag_in_the_loop_is_the_sum_of_its_parts():
    plant = Plant.load('anymal_c').with_effects(position_rub=True)
    drives = Drives(plant, DRIVE, STEP, 1)
    random = np.random.default_rng(0)
    for _ in range(20):
        position, velocity, motor = random.normal(0.0, (1.0, 3.0, 30.0))[:, None]
        out = np.empty(1)
        friction_torque(drives.friction, position, velocity, motor, out)
        parts = friction_parts(drives.friction, position, velocity, motor)
        np.testing.assert_allclose(out, sum(parts.values()), rtol=1e-12)


def test_an_ideal_drive_draws_its_shaft_power():
    np.testing.assert_allclose(flow(ideal(), 20.0, SPEEDS).link, 20.0 * SPEEDS, atol=1e-6)


def test_copper_loss_at_standstill_is_resistance_times_current_squared():
    plant = ideal(copper_loss=True)
    p = plant.parameters('LF_KFE')
    current = 20.0 / p.torque_constant * (1.0 + p.saturation * (20.0 / p.torque_limit) ** 2)
    assert flow(plant, 20.0, 0.0).link[0, 0] == pytest.approx(p.resistance * current**2)
    assert 4.0 < p.resistance * current**2 < 12.0


def test_a_warm_winding_wastes_more_by_the_coefficient_of_copper():
    plant = ideal(copper_loss=True, winding_heating=True)
    circuit = Circuit(plant, DRIVE, plant.resolve(DRIVE))
    circuit.temperature.winding[:] = 85.0
    arguments = np.full((1, 1), 20.0), np.zeros((1, 1)), np.zeros((1, 1)), 48.0, np.zeros(1)
    cold = flow(ideal(copper_loss=True), 20.0, 0.0).copper
    assert circuit.solve(*arguments).copper / cold == pytest.approx(1.0 + 0.0039 * 60.0)


def test_windings_heat_to_where_heat_flows_out_as_fast_as_it_comes():
    plant = ideal(copper_loss=True)
    circuit = Circuit(plant, DRIVE, plant.resolve(DRIVE))
    p = plant.parameters('LF_KFE')
    for _ in range(20_000):
        circuit.temperature.heat[0] += 10.0
        circuit.temperature.settle(1.0, 1)
    rise = 10.0 / p.housing_conductance
    assert circuit.temperature.housing[0] == pytest.approx(plant.sensors.ambient + rise, abs=0.1)
    between = circuit.temperature.winding[0] - circuit.temperature.housing[0]
    assert between == pytest.approx(10.0 / p.winding_conductance, abs=0.1)


def test_iron_loss_is_even_in_speed_and_grows_between_linear_and_quadratic():
    loss = flow(ideal(iron_loss=True), 0.0, SPEEDS).link[:, 0]
    np.testing.assert_allclose(loss, loss[::-1], atol=1e-9)
    assert loss[80] == pytest.approx(0.0, abs=1e-6)
    assert 2.0 < loss[160] / loss[120] < 4.0
    assert 0.5 < loss[160] < 6.0


def test_inverter_loss_is_even_in_torque_and_has_a_device_drop():
    loss = flow(ideal(inverter_loss=True), np.array([[-20.0], [-1.0], [1.0], [20.0]]), 0.0).link
    assert loss[0] == pytest.approx(loss[3])
    p = Plant.load('ideal').parameters('LF_KFE')
    drop = p.device_drop + p.switching_share * 48.0
    assert loss[2] == pytest.approx(drop / p.torque_constant, rel=0.02)


def test_idle_draw_is_there_at_rest_and_grows_a_little_with_voltage():
    plant = ideal(idle=True)
    low, nominal = (flow(plant, 0.0, 0.0, voltage=v).link[0, 0] for v in (40.0, 48.0))
    assert nominal == pytest.approx(8.2)
    assert 0.9 * nominal < low < nominal


def test_regeneration_loses_a_share_of_what_comes_back_and_nothing_else():
    plant = ideal(regeneration_efficiency=True)
    efficiency = plant.parameters('LF_KFE').regeneration_efficiency
    link = flow(plant, np.array([[20.0], [-20.0]]), 2.0).link[:, 0]
    np.testing.assert_allclose(link, [40.0, -40.0 * efficiency], rtol=1e-6)


def test_field_weakening_costs_power_at_top_speed_and_nothing_at_walking_speed():
    plant = ideal(field_weakening=True, copper_loss=True)
    assert not flow(plant, 20.0, np.linspace(-5.0, 5.0, 21)[:, None]).weakening.any()
    fast, faster = flow(plant, 20.0, np.array([[9.0], [9.6]])).weakening[:, 0]
    assert faster > fast > 1.0
    assert not flow(ideal(copper_loss=True), 20.0, 9.6).weakening.any()
    sagged = flow(plant, 20.0, 9.0, voltage=44.0).weakening[0, 0]
    assert sagged > fast


def test_a_fan_runs_in_time_whatever_the_joint_does():
    plant = ideal(fan=True)
    period = plant.parameters('LF_KFE').fan_period
    powers = [flow(plant, 0.0, 0.0, time=t).link[0, 0] for t in np.linspace(0.0, period, 60)]
    assert max(powers) == pytest.approx(plant.parameters('LF_KFE').fan, rel=0.02)
    assert min(powers) < 0.1
    again = flow(plant, 50.0, 0.0, time=3 * period).fan
    assert again == pytest.approx(flow(plant, 0.0, 0.0, time=0.0).fan)


def test_line_resistance_costs_current_squared_and_sags_the_bus():
    plant = ideal(line_resistance=True)
    bus = Bus(plant, plant.resolve(DRIVE), STEP)
    result = bus.solve(np.full((400, 1), 480.0))
    current = result.power[-1, 0] / result.voltage[-1]
    assert result.line[-1, 0] == pytest.approx(0.1 * current**2, rel=1e-3)
    assert result.voltage[-1] == pytest.approx(48.0 - plant.supply.resistance * current, rel=1e-3)
    assert result.power[-1, 0] == pytest.approx(480.0 + result.line[-1, 0])


def test_without_line_resistance_the_bus_stays_at_the_supplys_voltage():
    bus = Bus(ideal(), ideal().resolve(DRIVE), STEP)
    assert bus.solve(np.full((40, 1), 480.0)).voltage == pytest.approx(48.0, abs=2e-3)


@pytest.mark.parametrize('in_drives', [True, False])
def test_the_supply_takes_nothing_back_and_choppers_burn_what_is_too_much(in_drives):
    plant = Plant.parse(
        {'effects': {'line_resistance': False}, 'supply': {'brake_in_drives': in_drives}}
    )
    drives = ('LF_HAA', 'LF_HFE', 'LF_KFE')
    bus = Bus(plant, plant.resolve(drives), STEP)
    result = bus.solve(np.tile([-60.0, -30.0, 20.0], (4000, 1)))
    assert (result.supply_current >= 0.0).all()
    assert result.voltage.max() == pytest.approx(52.0)
    np.testing.assert_allclose(result.burned[-1], [70.0 * 2 / 3, 70.0 / 3, 0.0])
    metered = result.power[-1]
    burned_behind_the_meter = result.burned[-1] * in_drives
    np.testing.assert_allclose(metered, np.array([-60.0, -30.0, 20.0]) + burned_behind_the_meter)


def test_drives_may_feed_each_other_without_the_choppers():
    plant = ideal(regeneration_limit=True)
    bus = Bus(plant, plant.resolve(('A', 'B')), STEP)
    result = bus.solve(np.tile([-60.0, 100.0], (400, 1)))
    assert not result.burned.any()
    np.testing.assert_allclose(result.power, np.tile([-60.0, 100.0], (400, 1)))
    assert result.supply_current[-1] == pytest.approx(40.0 / 48.0, rel=1e-3)


def test_without_the_limit_the_supply_takes_power_back():
    bus = Bus(ideal(), ideal().resolve(DRIVE), STEP)
    result = bus.solve(np.full((400, 1), -96.0))
    assert result.supply_current[-1] == pytest.approx(-2.0, rel=1e-3)


def test_torque_is_limited_by_the_drive_and_at_speed_by_the_voltage():
    drives = Drives(ideal(), DRIVE, STEP, 1)
    drives.hold(JointCommand(effort=np.array([200.0])))
    out = np.empty(1)
    torques = []
    for speed in (0.0, 7.0, 9.0, 12.0):
        drives.step(0, np.zeros(1), np.array([speed]), out)
        torques.append(out[0])
    p = ideal().parameters('LF_KFE')
    at_9 = p.torque_constant / p.resistance * (0.95 * 48.0 - p.torque_constant * 9.0)
    assert torques[:2] == [80.0, 80.0]
    assert torques[2] == pytest.approx(at_9)
    assert torques[3] < 0.0


def test_a_position_command_follows_the_gains_of_the_paper_and_nan_damps():
    drives = Drives(ideal(), ('LF_HAA', 'LF_HFE'), STEP, 1)
    out = np.empty(2)
    drives.hold(JointCommand(position=np.array([0.5, np.nan])))
    drives.step(0, np.array([0.1, 0.1]), np.array([1.0, 1.0]), out)
    np.testing.assert_allclose(out, [80.0 * 0.4 - 2.0 * 1.0, -2.0])


def test_velocity_and_torque_commands_reach_the_joint():
    simulation = Simulation(Plant.load('anymal_c'), stand_world('LF_KFE'))
    simulation.hold(JointCommand(velocity=np.array([3.0])))
    assert simulation.advance(400).velocity[-1] == pytest.approx(3.0, abs=1.5)
    drives = Drives(ideal(), DRIVE, STEP, 1)
    drives.hold(JointCommand(effort=np.array([12.5])))
    out = np.empty(1)
    drives.step(0, np.zeros(1), np.ones(1), out)
    assert out[0] == 12.5


def test_reported_torque_holds_a_pendulum_against_gravity():
    load = Stand(inertia=0.02, mass=3.0, length=0.4)
    simulation = Simulation(Plant.load('anymal_c'), stand_world('LF_KFE', load))
    simulation.hold(JointCommand(position=np.array([0.9])))
    for _ in range(10):
        block = simulation.advance(400)
    held = load.mass * 9.81 * load.length * np.sin(simulation.joint_position[0])
    assert block.torque[-1, 0] == pytest.approx(held, rel=0.02)


def test_a_spring_lets_the_rotor_lead_the_joint_by_torque_over_stiffness():
    plant = Plant.load('anymal_c')
    simulation = Simulation(plant, stand_world('LF_KFE', Stand(mass=3.0, length=0.4)))
    simulation.hold(JointCommand(position=np.array([1.2])))
    for _ in range(10):
        block = simulation.advance(400)
    lead = simulation.drives.rotor[0] - simulation.joint_position[0]
    stiffness = plant.parameters('LF_KFE').spring_stiffness
    assert lead == pytest.approx(block.torque[-1, 0] / stiffness, rel=0.02)


def test_cogging_is_periodic_and_does_no_work_over_a_period():
    plant = ideal(cogging=True)
    drives = Drives(plant, DRIVE, STEP, 100)
    period = 2 * np.pi / plant.parameters('LF_KFE').cogging_order
    out = np.empty(1)
    for row, angle in enumerate(np.linspace(0.0, period, 100, endpoint=False)):
        drives.step(row, np.array([angle]), np.ones(1), out)
    assert abs(drives.trace.cogging.mean()) < 1e-9
    assert drives.trace.cogging.max() == pytest.approx(0.25, rel=1e-2)


def test_a_drive_at_rest_stays_at_rest_under_dry_friction():
    plant = Plant.load('anymal_c').with_effects(coulomb_friction=3.0, spring=False)
    simulation = Simulation(plant, stand_world('LF_KFE'))
    simulation.hold(JointCommand(position=np.array([0.02])))
    for _ in range(4):
        block = simulation.advance(400)
    assert abs(block.velocity[-100:]).max() < 0.02
    assert np.ptp(block.torque[-100:]) < 0.05


def fitted_at_the_joint(plant, drive, inertia=0.1, amplitude=0.15):
    """Armature, damping and dry friction that a chirp of targets shows, as PACE fits them."""
    simulation = Simulation(plant, stand_world(drive, Stand(inertia=inertia)))
    time = np.arange(0.0, 20.0, 0.005)
    targets = amplitude * np.sin(2 * np.pi * (0.3 * time + 0.0925 * time**2))  # 0.3 to 4 Hz
    blocks = []
    for target in targets:
        simulation.hold(JointCommand(position=np.array([target])))
        blocks.append(simulation.advance(10).position[:, 0])
    position = np.concatenate(blocks)
    velocity = np.gradient(position, STEP)
    acceleration = np.gradient(velocity, STEP)
    target = np.roll(np.repeat(targets, 10), round(plant.command_delay / STEP))
    rest = 80.0 * (target - position) - 2.0 * velocity - inertia * acceleration
    table = np.column_stack([acceleration, velocity, np.tanh(velocity / 0.05)])
    rows = slice(2000, -200)
    return np.linalg.lstsq(table[rows], rest[rows], rcond=None)[0]


def test_a_chirp_finds_the_rotor_of_a_drive_without_a_torque_loop():
    plant = Plant.load('anymal_c').with_effects(cogging=False)
    armature, damping, dry = fitted_at_the_joint(plant, 'LF_KFE')
    assert armature == pytest.approx(0.0675, rel=0.1)
    assert damping < 2.4
    assert 1.7 < dry < 1.7 + 0.8 + 0.06 * 10.0


@pytest.mark.parametrize('drive', ['LF_HAA', 'LF_HFE', 'LF_KFE'])
def test_joints_of_the_published_plant_show_what_is_published_of_anymals(drive):
    armature, damping, dry = fitted_at_the_joint(Plant.load('anymal_c_published'), drive)
    assert 0.039 < armature < 0.089
    assert 4.3 < damping < 5.5
    assert abs(dry) < 0.1


def test_friction_of_the_output_side_is_worn_and_switched_off_as_viscous_friction():
    plant = Plant.load('anymal_c_published')
    worn = replace(plant, wear={'LF_KFE': {'viscous_friction': 2.0}})
    off = plant.with_effects(viscous_friction=False)
    for changed, expected in ((plant, 4.6), (worn, 9.2), (off, 0.0)):
        simulation = Simulation(changed, stand_world('LF_KFE'))
        assert simulation.world.model.dof_damping.tolist() == [expected]
