"""A motion recorded with one drive of the simulated bench."""

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import limits_of
from drive_bench.motion.segment_path import JUMPS, Mounting
from sim_bridge.offline.motions import MotionController
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.world import Stand, stand_world
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError

from power_lab.challenge.challenge import Challenge, unseal
from power_lab.diagnose.next_recording import SPARE, Motion

_GRAVITY = 9.81
_LENGTH = 0.45  # m, of the pendulum
_INERTIA = 0.03  # kg·m², of the disc beside it
_LEAST_LOAD = 3.0  # N·m, so that there is something to swing


def record_motion(
    file: Path,
    output: Path,
    plant: Plant,
    *,
    drive: str = '',
    challenge: Path | None = None,
    unit: int = 0,
    seed: int = 0,
    overwrite: bool = False,
    progress: bool = False,
) -> tuple[str, float]:
    """Simulate a motion file on one drive of the bench into a bag; return drive and seconds.

    The drive is on a stand with a pendulum, heavy enough for the largest load. A static load is
    the angle at which it pulls as much; at speed the load swings between plus and minus the
    largest one. `drive_bench run` follows the same plan, with ramps where this one jumps.

    drive: by default the first that the motion names; challenge: bag whose sealed robot replaces
    the plant's unit. InputError for a file that is no motion, with the entry that is wrong, and
    for a drive that the bench does not have.
    """
    from sim_bridge.offline.run import OfflineRun, write_bag  # the simulated bus

    motion = MotionFile.load(file)
    drive = drive or (motion.drives[0] if motion.drives else JOINT_NAMES[0])
    if drive not in JOINT_NAMES:
        raise InputError(f'the bench has no drive {drive!r}; it has {", ".join(JOINT_NAMES)}')
    if challenge is not None:
        plant = Challenge.of(unseal(challenge)).plant(plant)
    else:
        plant = plant.unit(unit)
    pull = SPARE * max(_LEAST_LOAD, motion.strongest)
    world = stand_world(drive, Stand(_INERTIA, pull / (_GRAVITY * _LENGTH), _LENGTH))
    controller = MotionController(motion, Mounting(pull), JUMPS)
    controller.name = f'motion {file.stem}'
    run = OfflineRun(plant, world, controller, duration=motion.seconds, seed=seed)
    name = str(unit) if challenge is None else f'challenge {challenge.name}'
    card = run.card('bench', notes='simulated drive with a pendulum on a stand', unit=name)
    write_bag(output, run, card, overwrite=overwrite, progress=progress)
    return drive, motion.seconds


_TRIED = 4.0  # s of motion, from which the time for all of it is told
_LEAST = 1.0  # s of a segment


def shortened(motion: Motion, seconds: float) -> Motion:
    """Motion cut to about `seconds` by one factor; waves keep a period, other segments 1 s."""
    factor = min(seconds / max(motion.seconds, 1e-9), 1.0)

    def cut(segment: Mapping[str, Any]) -> dict[str, Any]:
        before = float(segment['seconds'])
        least = max(_LEAST, 1.0 / float(segment.get('frequency') or _LEAST))
        return {**segment, 'seconds': min(before, max(round(factor * before, 1), least))}

    return replace(motion, segments=tuple(cut(segment) for segment in motion.segments))


def record_on_bench(
    proposed: Motion,
    drive: str,
    file: Path,
    output: Path,
    riddle: Path | None,
    tell: Callable[[str], None],
) -> None:
    """Fit a motion to its drive's limits, save it to `file` and record it to the bag `output`.

    riddle: bag of a challenge whose robot is used; tell: takes a line with the expected time.
    """
    motion = proposed.within(limits_of(proposed.drives, None))
    motion.save(file)
    plant = Plant.load('anymal_c')
    with tempfile.TemporaryDirectory() as scratch:
        trial = Path(scratch) / 'trial.yaml'
        first = replace(motion, segments=motion.segments[:1])
        shortened(first, _TRIED).save(trial)
        began = time.monotonic()
        how: dict[str, Any] = {'drive': drive, 'challenge': riddle}
        _, seconds = record_motion(trial, Path(scratch) / 'trial', plant, **how)
        needed = (time.monotonic() - began) / seconds * motion.seconds
    takes = f'{needed:.0f} s' if needed < 90 else f'{needed / 60:.0f} min'
    tell(
        f'recording {motion.seconds:.0f} s of {drive} on the simulated bench, which takes about '
        f'{takes}'
    )
    record_motion(file, output, plant, **how)
