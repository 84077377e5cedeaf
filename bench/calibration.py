"""Coverage of the intervals of `power_calibration calibrate`, on the simulated bench.

One drive is simulated once; each seed then has a meter of its own (gains, offset, noise, clock)
and an analyser of its own (noise, clock), at 20 kHz. Printed: how many of the seeds have the
truth within the interval of 95 %, and how far off the estimates are.

    python bench/calibration.py [--seeds 20] [--seconds 20] [--motion chirp]
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from math import exp, pi
from pathlib import Path

import numpy as np
from drive_bench.motion.file import find_motion
from power_calibration.analyser.compare import compare_with_analyser
from power_calibration.analyser.comparison import AnalyserComparison
from power_calibration.analyser.curve import MeasuredDrive
from power_calibration.analyser.log import Log
from power_calibration.analyser.reference_fit import IntervalEstimate
from power_recordings.messages.samples import DriveSamples
from power_recordings.reading.reader import Recording
from rich.progress import track
from sim_bridge.instruments.analyser import Analyser, AnalyserParameters
from sim_bridge.offline.motions import MotionController
from sim_bridge.offline.run import OfflineRun
from sim_bridge.offline.telemetry import START_NS
from sim_bridge.plant.parameters import MeterParameters, Plant
from sim_bridge.plant.simulation import STEP, PlantBlock
from sim_bridge.plant.world import stand_world
from sim_bridge.sensors.sensors import DeviceClock, Meter
from wattwalk_core.arrays import Floats
from wattwalk_core.console import output, print_table

DRIVE = 'LF_KFE'


Estimated = tuple[IntervalEstimate, float, float, str]
"""An estimate, the truth, what to multiply both by, and the unit of that."""


def plant_blocks(motion: str, seconds: float, frequency: float | None = None) -> list[PlantBlock]:
    """Simulate a motion of one drive and return its blocks, before any meter or analyser."""
    blocks: list[PlantBlock] = []
    wanted = find_motion(motion).changed(frequency=frequency, seconds=seconds)
    played = MotionController(wanted.with_pull(0.0))
    run = OfflineRun(
        Plant.load('anymal_c'),
        stand_world(DRIVE),
        played,
        duration=min(played.seconds, 1.5 * seconds),
        seed=0,
        watch=blocks.append,
    )
    for _ in run:
        pass
    return blocks


def latency(meter: MeterParameters) -> float:
    """Return the delay of the meter's samples of slow signals, s."""
    keep = exp(-2.0 * pi * meter.bandwidth * STEP)
    return meter.delay + STEP * keep / (1.0 - keep)


def bandwidth(meter: MeterParameters) -> float:
    """Return the −3 dB frequency of a meter, Hz, from its filter, delay and step averages."""
    keep = exp(-2.0 * pi * meter.bandwidth * STEP)
    part = (meter.delay / STEP - 0.5) % 1.0
    frequency = np.arange(1.0, 1000.0, 0.5)
    turn = np.exp(-2j * pi * frequency * STEP)
    answer = np.abs((1.0 - keep) / (1.0 - keep * turn)) * np.abs(1.0 - part + part * turn)
    answer *= np.sinc(frequency * STEP)
    return float(frequency[np.argmax(answer < np.sqrt(0.5))])


def trial(
    blocks: Sequence[PlantBlock], seed: int
) -> tuple[AnalyserComparison, dict[str, Estimated]]:
    """Compare a random meter with a random analyser; return the result and `Estimated` by name."""
    random = np.random.default_rng([seed, 7])
    plant = Plant.load('anymal_c').unit(seed + 1)
    drift, shift, ours = (random.uniform(*ends) for ends in ((-80, 80), (-9000, 9000), (5, 30)))
    plant = replace(plant, meter=replace(plant.meter, clock_drift=float(ours)))
    parameters = plant.resolve([DRIVE])
    clock = DeviceClock.of(plant.meter)
    recording = _recording(plant, parameters, clock, blocks, random)
    analyser = Analyser(
        AnalyserParameters(rate=20_000.0, clock_offset=float(shift), clock_drift=float(drift)),
        clock,
        seed=seed,
    )
    for block in blocks:
        analyser.watch(block)
    names = ('time', 'voltage', 'current', 'power')
    log = Log.of(Path(f'analyser {seed}'), names, analyser.rows())
    measured = MeasuredDrive.of(recording, DRIVE)
    found = compare_with_analyser(measured, log)
    at = (found.fit.clock.centre + log.start - shift) / (1.0 + 1e-6 * drift)
    start = (measured.start_ns - START_NS) / 1e9
    errors = {name: float(values[0]) for name, values in parameters.items()}
    gain, offset = errors['current_gain'], errors['current_offset']
    late = at + latency(plant.meter) - start - found.fit.clock.centre
    channels = found.channels
    made = {
        'current gain': (channels['current'].gain, 1.0 / gain, 1e6, 'ppm'),
        'current offset': (channels['current'].offset, -offset / gain, 1e3, 'mA'),
        'time offset': (found.fit.offset, late, 1e6, 'µs'),
        'drift': (found.drift_ppm, float(drift), 1.0, 'ppm'),
    }
    if 'voltage' in channels:
        made['voltage gain'] = (channels['voltage'].gain, 1 / errors['voltage_gain'], 1e6, 'ppm')
        if not channels['voltage'].fixed:
            made['voltage offset'] = (channels['voltage'].offset, 0.0, 1e3, 'mV')
    if found.response is not None and found.response.cutoff is not None:
        made['bandwidth'] = (found.response.cutoff, bandwidth(plant.meter), 1.0, 'Hz')
    return found, made


def _recording(
    plant: Plant,
    parameters: dict[str, Floats],
    clock: DeviceClock,
    blocks: Sequence[PlantBlock],
    random: np.random.Generator,
) -> Recording:
    meter = Meter(plant, parameters, random)
    parts = [meter.read(block) for block in blocks]
    step = np.concatenate([part.step for part in parts])
    current = np.concatenate([part.current for part in parts]).astype(np.float32)
    samples = DriveSamples(
        stamp_ns=START_NS + clock.elapsed_ns(step),
        names=(DRIVE,),
        sequence=np.arange(len(step), dtype=np.uint64),
        device_time=clock.device_ns(step).astype(np.uint64),
        voltage=np.concatenate([part.voltage for part in parts]).astype(np.float32),
        current=current,
        temperature=np.full_like(current, np.nan),
        status=np.concatenate([part.status for part in parts]),
    )
    return Recording.in_memory('bench', {'drive_supply': samples})


def main() -> None:
    """Print a table of coverage and errors over all seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--motion', default='chirp')
    parser.add_argument('--frequency', type=float, metavar='HZ')
    options = parser.parse_args()
    blocks = plant_blocks(options.motion, options.seconds, options.frequency)
    rows: dict[str, list[Estimated]] = {}
    errors = []
    for seed in track(range(options.seeds), description='meters'):
        found, made = trial(blocks, seed)
        errors.append(found.errors[0])
        for name, row in made.items():
            rows.setdefault(name, []).append(row)
    cells = []
    for name, found_rows in rows.items():
        held = sum(value.low <= true <= value.high for value, true, _, _ in found_rows)
        scale, unit = found_rows[0][2], found_rows[0][3]
        off = scale * np.array([value.value - true for value, true, _, _ in found_rows])
        half = scale * np.array([0.5 * (value.high - value.low) for value, *_ in found_rows])
        spread = f'{np.sqrt(np.mean(off**2)):.3g} (mean {off.mean():+.2g})'
        share = f'{held} of {len(found_rows)}'
        cells.append((name, share, spread, f'{np.median(half):.3g}', unit))
    title = f'{options.motion}, {options.seconds:g} s, {options.seeds} meters'
    columns = ('', 'truth within', 'RMS error', 'half interval', 'unit')
    print_table(output(), columns, cells, title)
    before, after = np.mean(errors, axis=0)
    print(f'error of power at 400 Hz: {before:.3f} W before, {after:.3f} W after (RMS)')


if __name__ == '__main__':
    main()
