"""A motion recorded with one drive of the simulated bench."""

from pathlib import Path

from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError

from power_lab.challenge.bench_motion import BenchMotion
from power_lab.challenge.challenge import Challenge, unseal


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
    """
    Record a motion file into a bag; return the drive and the seconds.

    drive: the first that the motion names, where none is given. challenge: its robot takes the
    place of the plant's unit. InputError for a drive that the bench does not have.
    """
    from sim_bridge.offline.run import OfflineRun, write_bag  # the simulated bus
    from sim_bridge.plant.world import stand_world

    motion = BenchMotion(file)
    drive = drive or (motion.drives[0] if motion.drives else JOINT_NAMES[0])
    if drive not in JOINT_NAMES:
        raise InputError(f'the bench has no drive {drive!r}; it has {", ".join(JOINT_NAMES)}')
    if challenge is not None:
        plant = Challenge.of(unseal(challenge)).plant(plant)
    else:
        plant = plant.unit(unit)
    run = OfflineRun(
        plant, stand_world(drive, motion.stand), motion, duration=motion.seconds, seed=seed
    )
    name = str(unit) if challenge is None else f'challenge {challenge.name}'
    card = run.card('bench', notes='simulated drive with a pendulum on a stand', unit=name)
    write_bag(output, run, card, overwrite=overwrite, progress=progress)
    return drive, motion.seconds
