"""The compiled steps are those of the same functions that Python interprets."""

import numpy as np
import pytest
from sim_bridge.plant import circuit, drive, drive_steps
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import Simulation
from sim_bridge.plant.world import Stand, stand_world, walking_world
from wattwalk_core.anymal import DEFAULT_POSE

PLANT = Plant.load('anymal_c').unit(3).with_effects(position_rub=True, fan=True)


def swayed(plant):
    """Sums and means of ten blocks of 20 ms in which all drives sway."""
    simulation, rows = Simulation(plant, walking_world()), []
    for _ in range(10):
        sway = 0.2 * np.sin(2 * np.pi * 1.8 * simulation.time + np.arange(12))
        simulation.hold(JointCommand(position=DEFAULT_POSE + sway))
        rows.append(figures(simulation.advance(40)))
    return np.array(rows)


def swung(plant):
    """The same of one drive that swings a pendulum behind its spring, with full torque."""
    world = stand_world('LF_KFE', Stand(inertia=0.05, mass=3.0, length=0.4))
    simulation, rows = Simulation(plant.with_effects(spring=True), world), []
    for index in range(10):
        simulation.hold(JointCommand(position=np.array([2.0 * (-1) ** index])))
        rows.append(figures(simulation.advance(100)))
    return np.array(rows)


def figures(block):
    position, power = block.position[-1].sum(), block.power.mean()
    return [position, power, block.voltage.mean(), block.temperature.mean()]


@pytest.mark.parametrize('moved', [swayed, swung])
def test_compiled_and_interpreted_steps_differ_by_rounding_alone(moved, monkeypatch):
    compiled = moved(PLANT)
    for module, name in (
        (drive, 'drive_step'),
        (drive_steps, 'friction_torque'),
        (circuit, 'circuit_steps'),
        (circuit, 'bus_steps'),
    ):
        monkeypatch.setattr(module, name, getattr(module, name).py_func)
    np.testing.assert_allclose(moved(PLANT), compiled, rtol=1e-11)


def test_the_steps_are_those_that_numpy_once_computed_up_to_rounding():
    first, last = swayed(PLANT)[[0, -1]]
    expected = (
        [1.2236002953540659e-03, 19.862058251575881, 47.758330851098137, 33.000340876400728],
        [-3.1667599954236070e-02, 14.595967833687942, 47.817530289685649, 33.008601675325593],
    )
    np.testing.assert_allclose([first, last], expected, rtol=1e-10)
    expected = [0.21665756258117691, 518.20025203637806, 47.453923742737580, 34.096789467647142]
    np.testing.assert_allclose(swung(PLANT)[-1], expected, rtol=1e-10)


def test_equal_runs_are_equal_to_the_bit():
    np.testing.assert_array_equal(swayed(PLANT), swayed(PLANT))
