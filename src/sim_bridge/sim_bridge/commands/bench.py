"""`ros2 run sim_bridge bench`: record one simulated drive in a motion on a stand."""

import argparse

from drive_bench.motion.file import Load, find_motion
from drive_bench.motion.segment_path import Mounting
from wattwalk_core.errors import InputError

from sim_bridge.instruments.analyser import Analyser, AnalyserParameters, check_output
from sim_bridge.offline.motions import MotionController
from sim_bridge.offline.run import OfflineRun, write_bag
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.world import Stand, stand_world
from sim_bridge.sensors.sensors import DeviceClock


def run(options: argparse.Namespace) -> None:
    """Simulate a motion on the stand and write its bag, with options as of `bench`."""
    wanted = find_motion(options.motion, options.mode)
    plant = Plant.load(options.plant, options.unit)
    if options.load is not None and options.mass:
        raise InputError('--load and --mass say the same; give one of the two')
    load = Load(options.mass, options.length) if options.load is None else Load.of(options.load)
    stand = Stand(options.inertia, load.mass, load.length)
    changed = wanted.changed(options.amplitude, options.frequency, options.duration)
    motion = MotionController(changed.with_pull(load.pull), Mounting(load.pull))
    world = stand_world(options.drive, stand)
    analyser = None
    if options.analyser is not None:
        check_output(options.analyser)
        given = AnalyserParameters(
            rate=options.analyser_rate,
            clock_offset=options.analyser_offset,
            clock_drift=options.analyser_drift,
        )
        analyser = Analyser(given, DeviceClock.of(plant.meter), seed=options.seed)
    watch = None if analyser is None else analyser.watch
    run = OfflineRun(plant, world, motion, duration=motion.seconds, seed=options.seed, watch=watch)
    card = run.card('bench', notes='simulated drive on a stand')
    write_bag(options.output, run, card, overwrite=options.overwrite, progress=True)
    print(f'wrote {options.output}')
    if analyser is not None:
        print(f'wrote {options.analyser}: {analyser.save(options.analyser)} rows')
        print(
            f'next: ros2 run power_calibration calibrate {options.output} '
            f'--reference {options.analyser} -o calibration.yaml --report calibration.html'
        )
