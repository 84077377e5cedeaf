"""Commands of the live simulation and of offline runs: the same instants, the same targets."""

import numpy as np
import pytest
import rclpy
from policy_runner.nodes.run import PolicyRunner
from policy_runner.nodes.run_options import Options
from power_daq.bus.description import BusDescription
from sim_bridge.live.real_time import FrameEncoder, LivePlant
from sim_bridge.offline.controllers import make_controller
from sim_bridge.offline.run import OfflineRun
from sim_bridge.offline.telemetry import START_NS
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import STEP, Simulation
from sim_bridge.plant.world import walking_world
from sim_bridge.sensors.blocks import Instruments

SECONDS = 3.0
VELOCITY = (0.5, 0.0, 0.2)


@pytest.fixture
def runner_period(ros_domain):
    """Steps between two commands of `policy_runner run`, by the name of its policy."""
    rclpy.init()
    nodes = []

    def period(name):
        nodes.append(PolicyRunner(Options(policy=name)))
        return round(nodes[-1].period / STEP)

    yield period
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def live(name, period):
    """Instants in ns and targets of a robot stepped as in real time, commanded every period."""
    simulation = Simulation(Plant.load('anymal_c'), walking_world())
    instruments = Instruments(simulation, 1)
    encoder = FrameEncoder(BusDescription.load(), simulation.joints, instruments.clock)
    plant = LivePlant(
        simulation,
        instruments,
        encoder,
        lambda frames: None,
        lambda samples: None,
        now=lambda: simulation.time,
    )
    controller, steps, targets = make_controller(name, 0, VELOCITY), [], []
    while simulation.time < SECONDS:
        command = controller.command(simulation)
        steps.append(simulation.steps)
        targets.append(command.position)
        plant.command(command)
        plant.advance(period)
    return instruments.clock.elapsed_ns(np.array(steps)), np.array(targets)


@pytest.mark.parametrize('name', ['trot', 'baseline'])
def test_a_policy_commands_the_same_targets_at_the_same_instants_live_and_offline(
    runner_period, name
):
    instants, targets = live(name, runner_period(name))
    plant = Plant.load('anymal_c')
    run = OfflineRun(
        plant, walking_world(), make_controller(name, 0, VELOCITY), duration=SECONDS, seed=1
    )
    rows = [telemetry.topics['joint_commands'] for telemetry in run]
    stamps = np.concatenate([row.stamp_ns for row in rows]) - START_NS
    np.testing.assert_array_equal(stamps, instants)
    offline = np.concatenate([row.values['position'] for row in rows])
    np.testing.assert_allclose(offline, targets, atol=1e-9)
