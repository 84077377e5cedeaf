"""`ros2 run sim_bridge sound`: a sound file of a recording, by a simulated microphone."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray
from power_recordings.reading.reader import Recording
from rclpy.utilities import remove_ros_args
from rich.console import Console
from rich.progress import track
from wattwalk_core.command import command
from wattwalk_core.errors import InputError
from wattwalk_core.files import advice

from sim_bridge.microphone import COMMENT, Microphone, calibrator, motion_of, pressure

Floats = NDArray[np.float64]

_FORMATS = {
    ('.wav', '16'): 'PCM_16',
    ('.wav', '24'): 'PCM_24',
    ('.wav', 'float'): 'FLOAT',
    ('.flac', '16'): 'PCM_16',
    ('.flac', '24'): 'PCM_24',
}
_EPILOG = """\
A simulated microphone: what feet, gears and fan sound like is assumed, and the levels say nothing
about real robots. It is there to try `ros2 run power_daq sound`.

examples:
  ros2 run sim_bridge sound bags/walk_small -o walk.wav
  ros2 run sim_bridge sound bags/walk_1 -o walk.flac --start -3 --clap 1.5 --drift 40
  ros2 run sim_bridge sound --calibrator 94 -o tone.wav
"""


def parse(args: Sequence[str]) -> argparse.Namespace:
    """Options of the command; ROS arguments must be gone from args."""
    parser = argparse.ArgumentParser(
        prog='ros2 run sim_bridge sound',
        description='A sound file of a recording, as a simulated microphone hears the robot.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add('bag', nargs='?', type=Path, metavar='BAG', help='with foot_force and joint_states')
    add('-o', '--output', type=Path, required=True, metavar='F', help='.wav or .flac')
    add('--calibrator', type=float, metavar='DB', help='a tone of 1 kHz at that level instead')
    add('--seed', type=int, default=0, help='of all noises')
    add('--rate', type=int, default=48_000, metavar='HZ')
    add('--bits', choices=('16', '24', 'float'), default='24')
    add('--distance', type=float, default=2.0, metavar='M', help='to the microphone (2 m)')
    add('--full-scale', type=float, default=120.0, metavar='DB', help='as a sine (120 dB SPL)')
    add('--start', type=float, default=0.0, metavar='S', help="of the sound, after the bag's")
    add('--clap', type=float, nargs='+', default=[], metavar='S', help="after the bag's start")
    add(
        '--drift',
        type=float,
        default=0.0,
        metavar='PPM',
        help='the clock of the sound is slow',
    )
    options = parser.parse_args(args)
    if (options.bag is None) == (options.calibrator is None):
        raise InputError('give a BAG, or --calibrator DB')
    if (options.output.suffix, options.bits) not in _FORMATS:
        raise InputError(f'-o is {options.output}; expected .wav, or .flac of 16 or 24 bits')
    if not 8_000 <= options.rate <= 192_000:
        raise InputError(f'--rate is {options.rate}; it must lie in 8000..192000 Hz')
    if abs(options.drift) > 1000.0:
        raise InputError(f'--drift is {options.drift:g}; it must lie in -1000..1000 ppm')
    if options.seed < 0:
        raise InputError(f'--seed is {options.seed}; it must not be negative')
    return options


def write_sound(
    path: Path, blocks: Iterator[Floats], microphone: Microphone, rate: int, bits: str
) -> int:
    """Write blocks of pressure, Pa, whole or not at all; how many samples were cut at the top."""
    temporary = path.with_name(f'.part-{path.name}')
    cut = 0
    try:
        with soundfile.SoundFile(
            temporary, 'w', rate, 1, _FORMATS[path.suffix, bits], format=path.suffix[1:].upper()
        ) as file:
            file.comment = COMMENT
            for block in blocks:
                samples = block / microphone.unit
                cut += int(np.sum(np.abs(samples) > 1.0))
                file.write(np.clip(samples, -1.0, 1.0))
        temporary.replace(path)
    except (OSError, soundfile.LibsndfileError) as error:
        temporary.unlink(missing_ok=True)
        why = advice(error) if isinstance(error, OSError) else str(error)
        raise InputError(f'cannot write {path}: {why}') from None
    return cut


@command
def main(args: Sequence[str] | None = None) -> int:
    """Write the sound file."""
    given = list(sys.argv if args is None else ['sound', *args])
    options = parse(remove_ros_args(given)[1:])
    microphone = Microphone(distance=options.distance, full_scale=options.full_scale)
    if options.calibrator is not None:
        blocks = calibrator(options.calibrator, microphone, options.rate, 10.0, options.seed)
    else:
        motion = motion_of(Recording.open(options.bag))
        total = 2.0 * (motion.seconds - options.start)
        blocks = track(
            pressure(
                motion,
                microphone,
                options.rate,
                seed=options.seed,
                start=options.start,
                claps=options.clap,
                drift=options.drift,
            ),
            description=f'listening to {options.bag.name}',
            total=max(total, 1.0),
            console=Console(stderr=True),
            transient=True,
        )
    cut = write_sound(options.output, blocks, microphone, options.rate, options.bits)
    if cut:
        print(f'{cut} samples are clipped: give a higher --full-scale')
    print(f'{options.output}: a simulated microphone; its levels say nothing about real robots')
    if options.calibrator is None:
        print(f'next: ros2 run power_daq sound {options.output} --recording {options.bag}')
    return 0
