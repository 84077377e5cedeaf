"""`ros2 run sim_bridge bench`: record one simulated drive in a motion on a stand."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from drive_bench.motion.library import MOTIONS, find_motion, listing
from drive_bench.motion.load import Load
from drive_bench.motion.segments import UNITS
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.command import command, command_parser, own_arguments
from wattwalk_core.errors import InputError

from sim_bridge.commands.sim import load_plant

if TYPE_CHECKING:
    from sim_bridge.instruments.analyser import Analyser
    from sim_bridge.plant.parameters import Plant
    from sim_bridge.plant.world import Stand

_EPILOG = f"""motions:
{listing()}

They are those of `ros2 run drive_bench run`, which runs them on a drive.

examples:
  ros2 run sim_bridge bench sine -o bags/sine
  ros2 run sim_bridge bench ladder --mode velocity --duration 40 -o bags/ladder
  ros2 run sim_bridge bench holds --load 4kg@0.3m --drive RH_HFE -o bags/holds
  ros2 run sim_bridge bench sine --frequency 4.0371 --unit 3 -o bags/fig2 --analyser fig2.csv
"""


def parse(args: Sequence[str]) -> argparse.Namespace:
    """Return the options of the command from its own arguments."""
    parser = command_parser(
        'sim_bridge bench',
        'Record one simulated drive on a stand, as fast as the machine can.',
        _EPILOG,
    )
    add = parser.add_argument
    add('motion', metavar='MOTION', help=f'{", ".join(MOTIONS)}, or a motion/1 file')
    add('-o', '--output', type=Path, required=True, metavar='BAG', help='folder to write')
    add('--mode', choices=tuple(UNITS), help='one that the motion has; default: its first')
    add('--amplitude', type=float, metavar='X', help='in the unit of the mode')
    add('--frequency', type=float, metavar='HZ')
    add('--duration', type=float, metavar='S', help='of each segment with an amplitude')
    add('--drive', choices=JOINT_NAMES, default='LF_KFE', metavar='NAME', help='such as LF_KFE')
    add('--inertia', type=float, default=0.02, metavar='J', help='of the disc it turns, kg·m²')
    add('--load', metavar='KG@M', help='weight on an arm, such as 4kg@0.3m')
    add('--mass', type=float, default=0.0, metavar='M', help='of the same weight, kg')
    add('--length', type=float, default=0.3, metavar='L', help='of its arm, m')
    add('--seed', type=int, default=0, help='of the noise')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    add('--unit', type=int, metavar='N', help='draw the spread of another unit')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    add = parser.add_argument_group('a power analyser beside the meter').add_argument
    add('--analyser', type=Path, metavar='FILE.csv', help='write what it logs')
    add('--analyser-rate', type=float, default=20_000.0, metavar='HZ', help='rows per second')
    add('--analyser-offset', type=float, default=0.0, metavar='S', help='its clock at the start')
    add('--analyser-drift', type=float, default=0.0, metavar='PPM', help='of its clock')
    return parser.parse_args(args)


def _analyser(options: argparse.Namespace, plant: 'Plant') -> 'Analyser | None':
    if options.analyser is None:
        return None

    from sim_bridge.instruments.analyser import Analyser, AnalyserParameters, check_output
    from sim_bridge.sensors.meter import DeviceClock

    check_output(options.analyser)
    parameters = AnalyserParameters(
        rate=options.analyser_rate,
        clock_offset=options.analyser_offset,
        clock_drift=options.analyser_drift,
    )
    return Analyser(parameters, DeviceClock.of(plant.meter), seed=options.seed)


def _stand(options: argparse.Namespace) -> 'Stand':
    from sim_bridge.plant.world import Stand

    if options.load is None:
        return Stand(options.inertia, options.mass, options.length)
    if options.mass:
        raise InputError('--load and --mass say the same; give one of the two')
    load = Load.of(options.load)
    return Stand(options.inertia, load.mass, load.length)


@command
def main(args: Sequence[str] | None = None) -> int:
    """Write the bag that the arguments ask for."""
    options = parse(own_arguments(args))

    find_motion(options.motion, options.mode)

    from drive_bench.motion.segment_path import Mounting

    from sim_bridge.offline.motions import MotionController, bench_motion
    from sim_bridge.offline.run import OfflineRun, write_bag
    from sim_bridge.plant.world import stand_world

    plant, stand = load_plant(options.plant, options.unit), _stand(options)
    pull = Load(stand.mass, stand.length).pull
    wanted = bench_motion(
        options.motion,
        options.mode,
        amplitude=options.amplitude,
        frequency=options.frequency,
        seconds=options.duration,
        pull=pull,
    )
    motion = MotionController(wanted, Mounting(pull))
    world = stand_world(options.drive, stand)
    analyser = _analyser(options, plant)
    run = OfflineRun(
        plant,
        world,
        motion,
        duration=motion.seconds,
        seed=options.seed,
        watch=None if analyser is None else analyser.watch,
    )
    card = run.card('bench', notes='simulated drive on a stand')
    write_bag(options.output, run, card, overwrite=options.overwrite, progress=True)
    print(f'wrote {options.output}')
    if analyser is not None:
        print(f'wrote {options.analyser}: {analyser.save(options.analyser)} rows')
        print(
            f'next: ros2 run power_calibration calibrate {options.output} '
            f'--reference {options.analyser} -o calibration.yaml --report calibration.html'
        )
    return 0
