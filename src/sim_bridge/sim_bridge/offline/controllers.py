"""Controllers of offline runs."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from policy_runner.policies.by_name import POLICIES, Policy, load_policy
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.velocity_commands import CommandRange, RandomCommands, SteadyCommand
from wattwalk_core.anymal import DEFAULT_POSE
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.simulation import STEP, Simulation
from sim_bridge.sensors.sensors import BodyReadings, JointReadings, into_base

_DOWN = np.array([0.0, 0.0, -1.0])
CONTROLLERS = (*POLICIES, 'stand')
"""Names of controllers; the folder of a learned policy names one, too."""


class Controller(Protocol):
    """Source of joint commands, one every `period` steps of 0.5 ms.

    velocity: commanded for the base, vx, vy m/s and yaw rate rad/s [3], or None.
    """

    name: str
    period: int
    velocity: Floats | None

    def command(self, simulation: Simulation) -> JointCommand:
        """Return the command to hold from now on."""

    def reset(self) -> None:
        """Reset, after a fall."""


class PolicyWalk:
    """A policy with the true state as input, at its own rate as in `policy_runner run`.

    It takes over at once, since the robot stands already.
    """

    def __init__(self, name: str, policy: Policy, commands: Callable[[float], Floats]) -> None:
        """Make a walk; commands: maps time, s, to vx, vy in m/s and yaw rate in rad/s, [3]."""
        self.name = name
        self.period = round(1.0 / policy.rate / STEP)
        self.velocity: Floats | None = np.zeros(3)
        self._commands = commands
        self._policy = policy
        self._inputs = Inputs()
        policy.take_over()

    def command(self, simulation: Simulation) -> JointCommand:
        """Return joint targets for the robot's state, rad."""
        return self._act(simulation.time, self._look(simulation))

    def reset(self) -> None:
        """Reset, after a fall."""
        self._policy.take_over()

    def _look(self, simulation: Simulation) -> Floats:
        """Take the true state; return the velocity of the base, m/s [3]."""
        base, inputs = simulation.base[None], self._inputs
        gravity, velocity = into_base(base[:, 3:7], np.vstack((_DOWN, base[:, 7:10])))
        inputs.position, inputs.velocity = simulation.joint_position, simulation.joint_velocity
        inputs.gravity, inputs.spin = gravity, base[0, 10:13]
        return velocity

    def _act(self, time: float, velocity: Floats | None) -> JointCommand:
        self.velocity = self._commands(time)
        targets = self._policy.step(time, self.velocity, self._inputs, velocity)
        return JointCommand(position=targets)


class SensedWalk(PolicyWalk):
    """A policy whose inputs are sensor readings, one joint sample old, as on the robot.

    The base's velocity is not among them; legs and IMU estimate it.
    """

    _fresh = False
    _on_the_bus: tuple[JointReadings, BodyReadings] | None = None

    def sense(self, joints: JointReadings, body: BodyReadings | None) -> None:
        """Take new readings; the policy sees all but the last sample, which is in transit."""
        if body is None or not len(joints.step):
            return
        if len(joints.step) > 1:
            self._take(joints, body, -2)
        elif self._on_the_bus is not None:
            self._take(*self._on_the_bus, -1)
        self._on_the_bus = joints, body

    def _take(self, joints: JointReadings, body: BodyReadings, row: int) -> None:
        inputs = self._inputs
        inputs.position, inputs.velocity = joints.position[row], joints.velocity[row]
        inputs.effort = joints.torque[row]
        inputs.on_imu(
            int(body.step[row]),
            body.orientation[row],
            body.rate[row],
            0.0,
            body.acceleration[row],
        )
        self._fresh = True

    def command(self, simulation: Simulation) -> JointCommand:
        """Return joint targets, rad, from the sensed state; before any, from the true one."""
        if not self._fresh:
            self._look(simulation)
        return self._act(simulation.time, None)

    def reset(self) -> None:
        """Reset, after a fall."""
        super().reset()
        self._inputs.effort = np.zeros(0)
        self._fresh, self._on_the_bus = False, None


class StandController:
    """Controller that holds the default pose."""

    name = 'stand'
    period = 20
    velocity: Floats | None = None

    def command(self, simulation: Simulation) -> JointCommand:
        """Return the default pose, rad."""
        return JointCommand(position=DEFAULT_POSE)

    def reset(self) -> None:
        """Do nothing."""


def make_controller(
    name: str,
    seed: int,
    velocity: Sequence[float] | None = None,
    *,
    fastest: Sequence[float] | None = None,
    trust_code: bool = False,
) -> Controller:
    """Make a controller by name, or by a policy's folder; InputError for one that is not there.

    velocity: vx, vy in m/s, yaw rate in rad/s to hold; random ones from the seed if None.
    fastest: of the random ones, those of `CommandRange` if None. trust_code: run a TorchScript
    file.
    """
    if velocity is None:
        span = CommandRange() if fastest is None else CommandRange.up_to(fastest)
        commands: Callable[[float], Floats] = RandomCommands(seed, span)
    else:
        commands = SteadyCommand(velocity)
    if name == 'stand':
        return StandController()
    if name not in CONTROLLERS and not Path(name).exists():
        raise InputError(
            f'no controller {name!r}; there are {", ".join(CONTROLLERS)}, or give a policy folder'
        )
    return PolicyWalk(name, load_policy(name, trust_code=trust_code), commands)
