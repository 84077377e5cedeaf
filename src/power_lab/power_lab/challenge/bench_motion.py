"""A motion file on the simulated bench, with a pendulum as heavy as it asks for."""

from pathlib import Path

from drive_bench.motion.file import MotionFile
from drive_bench.motion.segment_path import JUMPS, Mounting
from sim_bridge.offline.motions import MotionController
from sim_bridge.plant.world import Stand

_GRAVITY = 9.81
_LENGTH = 0.45  # m, of the pendulum
_INERTIA = 0.03  # kg·m², of the disc beside it
_SPARE = 1.15  # the pendulum carries this much more than the largest load
_LEAST_LOAD = 3.0  # N·m, so that there is something to swing


class BenchMotion(MotionController):
    """
    The segments of a motion file as commands to the drive of a stand.

    The pendulum is as heavy as the largest load asks for. A held load is an angle at which the
    pendulum pulls as much; at speed the load swings between plus and minus the largest one. The
    node `drive_bench run` goes by the same plan, with ramps where this one jumps.
    """

    def __init__(self, path: Path) -> None:
        """InputError for a file that is no motion, with the entry that is wrong."""
        motion = MotionFile.load(path)
        self.load = max(_LEAST_LOAD, motion.strongest)
        super().__init__(motion, Mounting(_SPARE * self.load), JUMPS)
        self.name = f'motion {path.stem}'
        self.drives = motion.drives

    @property
    def seconds(self) -> float:
        """Length of all segments."""
        return self.motion.seconds

    @property
    def stand(self) -> Stand:
        """The pendulum that can put on the loads."""
        mass = _SPARE * self.load / (_GRAVITY * _LENGTH)
        return Stand(_INERTIA, mass, _LENGTH)
