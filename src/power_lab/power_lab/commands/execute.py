"""`ros2 run power_lab execute`: the recording that a diagnosis asked for, on the bench."""

from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command

from power_lab.commands import options as common


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'execute',
        'Record the motion that diagnose asked for (--motion) with one drive of the simulated '
        'bench.',
        'example: ros2 run power_lab execute next.yaml --drive LF_KFE -o bags/next',
        effects=False,
    )
    add = parser.add_argument
    add('motion', type=Path, metavar='MOTION.yaml', help='written by diagnose --motion')
    add('-o', '--output', type=Path, required=True, metavar='BAG', help='folder to write')
    add('--drive', metavar='NAME', help='default: the first that the motion names')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    add('--challenge', type=Path, metavar='BAG', help='the robot of a challenge, still sealed')
    add('--unit', type=int, default=0, metavar='N', help='unit of the plant')
    add('--seed', type=int, default=0, help='of the noise')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    options = parser.parse_args(args)

    from drive_bench.motion.file import MotionFile
    from sim_bridge.plant.parameters import Plant

    plant = Plant.load(options.plant)
    MotionFile.load(options.motion)

    from power_lab.challenge.bench_recording import record_motion

    drive, seconds = record_motion(
        options.motion,
        options.output,
        plant,
        drive=options.drive or '',
        challenge=options.challenge,
        unit=options.unit,
        seed=options.seed,
        overwrite=options.overwrite,
        progress=True,
    )
    print(f'wrote {options.output}: {seconds:.0f} s of {drive}')
    return 0
