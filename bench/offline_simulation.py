"""Speed of offline simulation to a bag on one core, as a multiple of real time.

Ratios count CPU time, so that they are those of one core whatever else runs. Also printed: what
share of a core the plant takes when it runs in real time, without the node around it.

    python bench/offline_simulation.py [--seconds 30] [--keep BAG]
"""

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ['OMP_NUM_THREADS'] = '1'

import mujoco
from power_daq.bus.description import BusDescription
from rich.console import Console
from rich.table import Table
from sim_bridge.live.frames import FrameEncoder
from sim_bridge.live.real_time import BLOCK
from sim_bridge.offline.run import run_offline, simulate_recording, walking_run
from sim_bridge.plant import simulation as simulation_module
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import STEP, Simulation
from sim_bridge.plant.world import walking_world
from sim_bridge.sensors.blocks import Instruments
from wattwalk_core.anymal import DEFAULT_POSE

TARGET = 5.0
LIVE_TARGET = 0.6
RIGID_TARGET = 2.0


def bag_ratio(seconds: float, terrain: str, path: Path) -> float:
    """Simulated time over CPU time of a recording with all drives and pushes."""
    begin = time.process_time()
    run_offline(path, duration=seconds, seed=1, terrain=terrain, pushes=True)
    return seconds / (time.process_time() - begin)


def memory_ratio(seconds: float) -> float:
    """The same into memory."""
    run = walking_run(Plant.load('anymal_c'), duration=seconds, seed=1)
    begin = time.process_time()
    simulate_recording(run)
    return seconds / (time.process_time() - begin)


class TimedSteps:
    """The module mujoco, whose `mj_step` counts the seconds that it takes."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(mujoco, name)

    def mj_step(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Step."""
        begin = time.thread_time()
        mujoco.mj_step(model, data)
        self.seconds += time.thread_time() - begin


def rigid_body_ratio(seconds: float) -> float:
    """CPU time of a walk into memory over that of the rigid bodies' steps alone."""
    run = walking_run(Plant.load('anymal_c'), duration=seconds, seed=1)
    steps, former = TimedSteps(), simulation_module.mujoco
    simulation_module.mujoco = steps
    begin = time.process_time()
    simulate_recording(run)
    spent = time.process_time() - begin
    simulation_module.mujoco = former
    return spent / steps.seconds


def live_share(seconds: float) -> float:
    """Share of a core that plant, instruments and frames take in blocks of the live node."""
    simulation = Simulation(Plant.load('anymal_c'), walking_world())
    instruments = Instruments(simulation, 0)
    encoder = FrameEncoder(BusDescription.load(), simulation.joints, instruments.clock)
    simulation.hold(JointCommand(position=DEFAULT_POSE))
    begin = time.process_time()
    for _ in range(round(seconds / STEP / BLOCK)):
        encoder.encode(instruments.read(simulation.advance(BLOCK)))
    return (time.process_time() - begin) / seconds


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, epilog='example: make bench')
    parser.add_argument('--seconds', type=float, default=30.0, help='simulated time of each run')
    parser.add_argument('--keep', type=Path, metavar='BAG', help='keep the bag of flat ground')
    options = parser.parse_args()
    table = Table('what', 'reached', 'target', 'ratio', title='offline simulation, 12 drives')
    with tempfile.TemporaryDirectory(prefix='wattwalk') as folder:
        for terrain in ('flat', 'rough'):
            path = Path(folder) / terrain
            if terrain == 'flat' and options.keep is not None:
                path = options.keep
            reached = bag_ratio(options.seconds, terrain, path)
            cells = f'{reached:.1f} × real time', f'{TARGET:.0f} ×', f'{reached / TARGET:.2f}'
            table.add_row(f'walk on {terrain} ground to a bag', *cells)
    reached = memory_ratio(options.seconds)
    table.add_row('walk on flat ground to memory', f'{reached:.1f} × real time', '', '')
    reached = rigid_body_ratio(options.seconds)
    cells = f'{reached:.1f} × mj_step', f'{RIGID_TARGET:.0f} ×', f'{RIGID_TARGET / reached:.2f}'
    table.add_row('walk to memory against rigid bodies alone', *cells)
    share = live_share(min(options.seconds, 10.0))
    cells = f'{share:.0%} of a core', f'under {LIVE_TARGET:.0%}', f'{LIVE_TARGET / share:.2f}'
    table.add_row('plant, meter and frames in real time', *cells)
    Console().print(table)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
