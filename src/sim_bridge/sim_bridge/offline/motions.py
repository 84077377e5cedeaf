"""Motion files on the simulated stand: one drive, commanded at 400 Hz."""

import numpy as np
from drive_bench.motion.file import MotionFile
from drive_bench.motion.plan import SegmentPlayer
from drive_bench.motion.segment_path import Mounting, Ramps
from wattwalk_core.arrays import Floats

from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.simulation import Simulation


class MotionController:
    """Controller of a motion for the one drive of a stand, as planned by `drive_bench run`.

    The load hangs at 0 rad. Segments that end at a winding temperature use the simulated one.
    """

    period = 5
    velocity: Floats | None = None

    def __init__(
        self, motion: MotionFile, mounting: Mounting | None = None, ramps: Ramps | None = None
    ) -> None:
        """Make a controller; InputError for a motion that the load's mounting forbids."""
        self.motion = motion
        self.name = f'motion {motion.name}' + (f', {motion.mode} mode' if motion.mode else '')
        self._mounting, self._ramps = mounting or Mounting(), ramps or Ramps()
        self._player: SegmentPlayer | None = None
        self._last = 0.0

    @property
    def seconds(self) -> float:
        """Duration with the transitions between segments, s, from hanging."""
        return SegmentPlayer(self.motion, 0.0, self._mounting, self._ramps).plan.seconds

    def command(self, simulation: Simulation) -> JointCommand:
        """Return the present target."""
        position = float(simulation.joint_position[0])
        if self._player is None:
            self._player = SegmentPlayer(self.motion, position, self._mounting, self._ramps)
            self._last = simulation.time
        since, self._last = simulation.time - self._last, simulation.time
        winding = float(simulation.circuit.temperature.winding[0])
        target = self._player.step(since, position, winding)
        if target.mode == 'torque':
            return JointCommand(effort=np.array([target.effort]))
        speed = np.array([target.velocity])
        if target.mode == 'velocity':
            return JointCommand(velocity=speed)
        return JointCommand(position=np.array([target.position]), velocity=speed)

    def reset(self) -> None:
        """Plan again from the present position."""
        self._player = None
