"""Animated picture of the simulated robot walking beside the watts of its drives.

example: MUJOCO_GL=egl python docs/pictures/walk_beside_watts.py -o walk_beside_watts.webp
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from policy_training.evaluation.video import Clip, write_video
from power_estimator.loader import load_model
from sim_bridge.offline.run import simulate_recording, walking_run
from sim_bridge.plant.parameters import Plant
from wattwalk_core.command import command

STRIDES = 10 / 1.9  # s, ten strides of the trot: a loop


@command
def main(args: Sequence[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='F.webp')
    parser.add_argument('--policy', default='trot', help='that walks (trot)')
    parser.add_argument('--model', default='ppn:bags/ppn_small')
    options = parser.parse_args(args)
    clip = Clip(start=4.0, seconds=STRIDES, frames=96)
    run = walking_run(
        Plant.load('anymal_c'),
        duration=clip.start + clip.seconds + 0.5,
        seed=5,
        controller=options.policy,
        velocity=(0.6, 0.0, 0.0),
    )
    count = write_video(options.output, simulate_recording(run), clip, load_model(options.model))
    print(f'{options.output}: {count} frames, {options.output.stat().st_size / 1e6:.2f} MB')


if __name__ == '__main__':
    raise SystemExit(main())
