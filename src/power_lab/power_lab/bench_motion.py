"""Executes a motion file on the simulated bench: one drive that swings a pendulum."""

from pathlib import Path

import numpy as np
from policy_runner.errors import InputError as MotionError
from policy_runner.excitation import MotionFile
from policy_runner.motion_plan import Mounting, Plan
from power_daq.cli import InputError
from sim_bridge.drive import JointCommand
from sim_bridge.simulation import Simulation
from sim_bridge.world import Stand

_GRAVITY = 9.81
_LENGTH = 0.45  # m, of the pendulum
_INERTIA = 0.03  # kg·m², of the disc beside it
_SPARE = 1.15  # the pendulum carries this much more than the largest load
_LEAST_LOAD = 3.0  # N·m, so that there is something to swing


class BenchMotion:
    """
    The segments of a motion file as commands to the drive of a stand, at 400 Hz.

    The pendulum is as heavy as the largest load asks for. A held load is an angle at which the
    pendulum pulls as much; at speed the load swings between plus and minus the largest one. The
    node `policy_runner excite` goes by the same plan, with ramps where this one jumps.
    """

    period = 5
    velocity = None

    def __init__(self, path: Path) -> None:
        """InputError for a file that is no motion, with the entry that is wrong."""
        try:
            self._motion = MotionFile.load(path)
        except MotionError as error:
            raise InputError(str(error)) from error
        self.name = f'motion {path.stem}'
        self.drives = self._motion.drives
        self.load = max(_LEAST_LOAD, self._motion.strongest)
        self._plan: Plan | None = None

    @property
    def seconds(self) -> float:
        """Length of all segments."""
        return self._motion.seconds

    @property
    def stand(self) -> Stand:
        """The pendulum that can put on the loads."""
        mass = _SPARE * self.load / (_GRAVITY * _LENGTH)
        return Stand(_INERTIA, mass, _LENGTH)

    def command(self, simulation: Simulation) -> JointCommand:
        """The target now."""
        if self._plan is None:
            start = float(simulation.joint_position[0])
            self._plan = Plan(self._motion, start, Mounting(_SPARE * self.load))
        target = self._plan.at(simulation.time)
        return JointCommand(
            position=np.array([target.position]), velocity=np.array([target.velocity])
        )

    def reset(self) -> None:
        """Plan anew from where the drive is."""
        self._plan = None
