"""Speed of offline simulation, alignment and import on one core.

Ratios of simulation and alignment count CPU time, so that they are those of one core whatever else
runs. An import is that of a seeded log, of a table and of a bag, by a process of its own, with its
peak memory. Also printed: what share of a core the plant takes when it runs in real time, without
the node around it.

    python bench/speed.py [--only simulation alignment import] [--seconds 120] [--mb 1000]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from unittest.mock import patch

os.environ['OMP_NUM_THREADS'] = '1'

import mujoco
import numpy as np
from power_daq.bus.description import BusDescription
from power_recordings.alignment.align import load_aligned
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter
from sim_bridge.live.real_time import BLOCK, FrameEncoder
from sim_bridge.offline.run import run_offline, simulate_recording, walking_run
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import STEP, Simulation
from sim_bridge.plant.world import walking_world
from sim_bridge.sensors.blocks import Instruments
from wattwalk_core.anymal import DEFAULT_POSE
from wattwalk_core.arrays import Floats
from wattwalk_core.console import output, print_table
from wattwalk_core.yaml_file import dump_yaml

TO_BAG, RIGID, LIVE, ALIGNED, IMPORTED = 5.0, 2.0, 0.6, 200.0, 100.0  # goals
DRIVES = 12
_RATE = 1000  # Hz of a log
_ROWS = 20_000
_UNITS = {'position': 'rad', 'velocity': 'rad/s', 'torque': 'N*m', 'voltage': 'V', 'current': 'A'}
Row = tuple[str, str, str, str]  # what, reached, goal, ratio


def cpu_seconds(call: Callable[[], object]) -> float:
    """Return the CPU time of a call, s."""
    begin = time.process_time()
    call()
    return time.process_time() - begin


def rigid_body_ratio(seconds: float) -> float:
    """Return the CPU time of a simulated walk over that of its rigid-body steps alone."""
    run = walking_run(Plant.load('anymal_c'), duration=seconds, seed=1)
    step, stepping = mujoco.mj_step, 0.0

    def timed(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        nonlocal stepping
        begin = time.thread_time()
        step(model, data)
        stepping += time.thread_time() - begin

    with patch.object(mujoco, 'mj_step', timed):
        spent = cpu_seconds(lambda: simulate_recording(run))
    return spent / stepping


def live_share(seconds: float) -> float:
    """Return the share of a core that plant, instruments and bus frames take in real time."""
    simulation = Simulation(Plant.load('anymal_c'), walking_world())
    instruments = Instruments(simulation, 0)
    encoder = FrameEncoder(BusDescription.load(), simulation.joints, instruments.clock)
    simulation.hold(JointCommand(position=DEFAULT_POSE))
    blocks = range(round(seconds / STEP / BLOCK))

    def play() -> None:
        for _ in blocks:
            encoder.encode(instruments.read(simulation.advance(BLOCK)))

    return cpu_seconds(play) / seconds


def simulated(folder: Path, seconds: float) -> Iterator[Row]:
    """Yield rows on simulated walks to bags, to memory and in real time."""
    for terrain in ('flat', 'rough'):
        options = {'duration': seconds, 'seed': 1, 'terrain': terrain, 'pushes': True}
        path = folder / terrain
        reached = seconds / cpu_seconds(lambda p=path, o=options: run_offline(p, **o))
        cells = f'{reached:.1f} × real time', f'{TO_BAG:.0f} ×', f'{reached / TO_BAG:.2f}'
        yield f'walk on {terrain} ground to a bag', *cells
    run = walking_run(Plant.load('anymal_c'), duration=seconds, seed=1)
    reached = seconds / cpu_seconds(lambda: simulate_recording(run))
    yield 'walk on flat ground to memory', f'{reached:.1f} × real time', '', ''
    reached = rigid_body_ratio(seconds)
    cells = f'{reached:.1f} × mj_step', f'{RIGID:.0f} ×', f'{RIGID / reached:.2f}'
    yield 'walk to memory against rigid bodies alone', *cells
    share = live_share(min(seconds, 10.0))
    cells = f'{share:.0%} of a core', f'under {LIVE:.0%}', f'{LIVE / share:.2f}'
    yield 'plant, meter and frames in real time', *cells


def aligned(folder: Path, seconds: float) -> Iterator[Row]:
    """Yield rows on the alignment of a walk, from bag to dataset."""
    path = run_offline(folder / 'walk', duration=seconds, seed=0)
    load_aligned([path])
    for rate, smooth in ((200.0, True), (200.0, False), (50.0, False)):
        how = 'Savitzky-Golay' if smooth else 'unsmoothed'
        reached = seconds / cpu_seconds(
            lambda r=rate, s=smooth: load_aligned([path], rate=r, smooth=s)
        )
        cells = f'{reached:.0f} × real time', f'{ALIGNED:.0f} ×', f'{reached / ALIGNED:.2f}'
        yield f'bag to dataset, {rate:.0f} Hz, {how}', *cells


def _signals(rng: np.random.Generator, first: int) -> Floats:
    """Time, then position, velocity, torque, voltage and current by drive, [rows, 1 + 5·D]."""
    t = (first + np.arange(_ROWS)) / _RATE
    rate = 2 * np.pi * np.linspace(0.5, 2, DRIVES)  # rad/s
    phase = t[:, None] * rate
    velocity, torque = rate * np.cos(phase), np.sin(3 * phase) + rng.normal(0, 0.01, phase.shape)
    current = (torque * velocity + 2 * torque**2 + 1) / 48
    voltage = 48 - 0.1 * current
    parts = np.stack([np.sin(phase), velocity, torque, voltage, current], axis=2)
    return np.concatenate([t[:, None], parts.reshape(_ROWS, -1)], axis=1)


def make_csv(path: Path, size: int) -> str:
    """Write a CSV table of at least `size` bytes and return its import map as YAML."""
    rng = np.random.default_rng(0)
    names = ('pos', 'vel', 'torque', 'volt', 'amp')
    row = '%.3f,' + ','.join(['%.6f'] * (5 * DRIVES)) + '\n'
    with path.open('w') as file:
        file.write('t,' + ','.join(f'{n}{d}' for d in range(DRIVES) for n in names) + '\n')
        first = 0
        while file.tell() < size:
            table = _signals(rng, first)
            file.write((row * _ROWS) % tuple(table.ravel().tolist()))
            first += _ROWS
    return _map({'column': 't', 'unit': 's'}, 'D*', [f'{name}*' for name in names])


def _map(time: dict[str, str], drives: str, columns: Sequence[str]) -> str:
    """Return an import map as YAML; columns: of the quantities of _UNITS."""
    signals = {
        quantity: {'from': column, 'unit': unit}
        for (quantity, unit), column in zip(_UNITS.items(), columns, strict=True)
    }
    return dump_yaml({'format': 'import/1', 'time': time, 'drives': {drives: signals}})


def make_bag(path: Path, size: int) -> str:
    """Write a bag of at least `size` bytes of messages and return its import map as YAML."""
    rng = np.random.default_rng(0)
    names = tuple(f'D{i}' for i in range(DRIVES))
    with BagWriter(path, flush_period=10.0) as bag:
        joints = bag.add_topic('joint_states', cdr.JOINT_STATE)
        supply = bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY)
        first = 0
        while bag.size < size:
            table = _signals(rng, first)
            stamps = np.rint(1e18 + table[:, 0] * 1e9).astype(np.int64)
            columns = table[:, 1:].reshape(_ROWS, DRIVES, 5)
            *motion, voltage, current = np.moveaxis(columns, 2, 0)
            states = cdr.in_a_list(cdr.joint_state_block(stamps, names, *motion))
            device = stamps.astype(np.uint64)
            blocks = cdr.drive_supply_blocks(stamps, first, device, names, voltage, current)
            watts = cdr.in_a_list(*blocks)
            for stamp, state, watt in zip(stamps.tolist(), states, watts, strict=True):
                bag.write(joints, stamp, state)
                bag.write(supply, stamp, watt)
            first += _ROWS
    fields = [f'/joint_states:{name}[*]' for name in ('position', 'velocity', 'effort')]
    fields += [f'/drive_supply:{name}[*]' for name in ('voltage', 'current')]
    return _map({'stamp': 'header'}, '*', fields)


def imported(folder: Path, megabytes: float) -> Iterator[Row]:
    """Yield rows on the import of a table and of a bag, each by a separate process."""
    code = 'from power_recordings.commands.arguments import import_logs as run; exit(run())'
    mapping = folder / 'map.yaml'
    every_core = {name: own for name, own in os.environ.items() if name != 'OMP_NUM_THREADS'}
    for kind, make in (('csv', make_csv), ('bag', make_bag)):
        log = folder / f'log.{kind}'
        mapping.write_text(make(log, round(megabytes * 1e6)))
        files = [log] if log.is_file() else list(log.iterdir())
        size = sum(file.stat().st_size for file in files) / 1e6
        words = [str(log), '--map', str(mapping), '-o', str(folder / f'imported_{kind}')]
        begin = time.perf_counter()
        command, silent = [sys.executable, '-c', code, *words], subprocess.DEVNULL
        process = subprocess.Popen(command, env=every_core, stdout=silent)
        _, status, used = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f'the import of {log} ended with {os.waitstatus_to_exitcode(status)}')
        seconds = time.perf_counter() - begin
        busy, peak = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
        reached = f'{size / seconds:.0f} MB/s, CPU {busy:.1f} s, peak {peak:.0f} MB'
        goal = f'{IMPORTED:.0f} MB/s, 1000 MB' if kind == 'csv' else ''
        ratio = f'{size / seconds / IMPORTED:.2f}' if kind == 'csv' else ''
        yield f'{kind} of {size:.0f} MB, {DRIVES} drives', reached, goal, ratio


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    kinds = ('simulation', 'alignment', 'import')
    parser.add_argument('--only', nargs='+', choices=kinds, default=kinds)
    parser.add_argument('--seconds', type=float, help='of each walk, instead of 30 and 120')
    parser.add_argument('--mb', type=float, default=100.0, help='size of a log to import')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='wattwalk') as name:
        folder = Path(name)
        for kind in options.only:
            if kind == 'import':
                rows = imported(folder, options.mb)
            else:
                work, usual = (simulated, 30.0) if kind == 'simulation' else (aligned, 120.0)
                rows = work(folder, options.seconds or usual)
            print_table(output(), (kind, 'reached', 'goal', 'ratio'), list(rows))


if __name__ == '__main__':
    main()
