"""Who commands the joints in an offline run."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from policy_runner.commands import RandomCommands
from policy_runner.trot import TROTS, ScriptedTrot
from power_daq.cli import InputError

from sim_bridge.drive import JointCommand
from sim_bridge.robot import DEFAULT_POSE
from sim_bridge.sensors import into_base
from sim_bridge.simulation import STEP, Simulation

Floats = NDArray[np.float64]
_DOWN = np.array([0.0, 0.0, -1.0])
CONTROLLERS = (*TROTS, 'stand')


class Controller(Protocol):
    """Commands every `period` steps of 0.5 ms; velocity is that of the base asked for, or None."""

    name: str
    period: int
    velocity: Floats | None

    def command(self, simulation: Simulation) -> JointCommand:
        """What to hold from now on."""
        ...

    def reset(self) -> None:
        """Start anew, after a fall."""
        ...


class Trot:
    """The scripted trot at 100 Hz, walking by random velocity commands."""

    def __init__(self, name: str, seed: int, rate: float = 100.0) -> None:
        """name: one of policy_runner's trots. seed: of the commands. rate: Hz."""
        if name not in TROTS:
            raise InputError(f'no controller {name!r}; there are {", ".join(CONTROLLERS)}')
        self.name = name
        self.period = round(1.0 / rate / STEP)
        self.velocity: Floats | None = np.zeros(3)
        self._commands = RandomCommands(seed)
        self._trot = ScriptedTrot(TROTS[name])

    def command(self, simulation: Simulation) -> JointCommand:
        """Targets for the joints from the robot's state, rad."""
        base = simulation.base[None]
        attitude = base[:, 3:7]
        down_and_velocity = np.vstack((_DOWN, base[:, 7:10]))
        gravity, velocity = into_base(attitude, down_and_velocity)
        time = simulation.time
        self.velocity = self._commands(time)
        return JointCommand(
            position=self._trot.step(
                time, self.velocity, simulation.joint_position, gravity, base[0, 10:13], velocity
            )
        )

    def reset(self) -> None:
        """Ramp in from the pose that comes next."""
        self._trot.reset()


class Stand:
    """Holds the default pose."""

    name = 'stand'
    period = 20
    velocity: Floats | None = None

    def command(self, simulation: Simulation) -> JointCommand:
        """The default pose, rad."""
        return JointCommand(position=DEFAULT_POSE)

    def reset(self) -> None:
        """Nothing to forget."""


def make_controller(name: str, seed: int) -> Controller:
    """A controller by name; InputError for one that is not there."""
    return Stand() if name == 'stand' else Trot(name, seed)
