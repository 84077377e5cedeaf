"""Learned policies on the robot, by their contract."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import numpy as np
from wattwalk_core.anymal import FOOT_RADIUS, GRAVITY, JOINT_NAMES, ROBOT_MASS
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError

from policy_runner.policies.folder import Contract, read_folder
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.kinematics import forward
from policy_runner.policies.velocity_commands import CommandRateLimiter
from wattwalk_core import anymal

_FUNCTIONS: Final[Mapping[str, Callable[[Singles], Singles]]] = {
    'elu': lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0))),
    'relu': lambda x: np.maximum(x, 0),
    'tanh': np.tanh,
}


class Perceptron:
    """Perceptron of the layers `layer0`, `layer1`, … of a policy folder; the last is linear."""

    def __init__(self, tensors: Mapping[str, Singles], activation: str) -> None:
        self._layers = [
            (np.ascontiguousarray(tensors[f'layer{i}.weight'].T), tensors[f'layer{i}.bias'])
            for i in range(len(tensors) // 2)
        ]
        self._activate = _FUNCTIONS[activation]

    def __call__(self, observation: Singles) -> Singles:
        """Return actions [..., outputs] for observations [..., inputs]."""
        x = observation
        for weight, bias in self._layers[:-1]:
            x = self._activate(x @ weight + bias)
        weight, bias = self._layers[-1]
        return np.asarray(x @ weight + bias)


Network = Callable[[Singles], Singles]  # observations [..., size] to actions [..., 12]


_SETTLING: Final = 0.25  # s, in which the legs correct the accelerometer; best of 2 on 24 walks
_BLIND_SETTLING: Final = 0.04  # s, the same without an accelerometer
_RISE: Final = 0.006  # m above the lowest foot at which a foot counts half
_BEARS: Final = (0.0, 0.5)  # of the weight, on a foot that swings and on one that stands


class BaseVelocity:
    """Complementary filter: integration of the accelerometer, corrected by stance feet.

    A foot that stands moves, seen from the base, as the ground does; the lowest foot stands, and
    so does one that is hardly higher, unless the torques of its leg say that it bears no weight.
    """

    def __init__(self) -> None:
        self._time: float | None = None
        self.velocity = np.zeros(3)

    def update(self, time: float, inputs: Inputs) -> Floats:
        """Return the velocity in the base's frame, m/s [3], at a time, s.

        Acceleration and effort among the inputs are used where they are known.
        """
        dt = 0.0 if self._time is None else min(max(time - self._time, 0.0), _LONGEST_STEP)
        self._time = time
        gravity, rate, effort = inputs.gravity, inputs.spin, inputs.effort
        legs = forward(inputs.position)
        turning = inputs.velocity.reshape(4, 3)
        down = FOOT_RADIUS * gravity
        soles = legs.feet + down
        swept = np.einsum('nij,nj->ni', legs.jacobian, turning)
        rolling = np.cross(_shank_rates(legs.angles, turning), down)
        by_leg = -(swept + rolling + np.cross(rate, soles))
        depth = soles @ gravity
        weight = np.exp2(-np.square((depth.max() - depth) / _RISE))
        if len(effort) and np.isfinite(effort).all():
            weight = _that_bear(weight, legs.jacobian, effort.reshape(4, 3), gravity)
        acceleration = inputs.acceleration
        guess = self.velocity
        if acceleration is not None:
            guess = guess + dt * (acceleration + GRAVITY * gravity - np.cross(rate, guess))
        settling = _BLIND_SETTLING if acceleration is None else _SETTLING
        share = 1.0 - np.exp(-dt / settling)
        self.velocity = guess + share * (weight @ by_leg / weight.sum() - guess)
        return self.velocity


def _that_bear(weight: Floats, jacobian: Floats, torque: Floats, gravity: Floats) -> Floats:
    """Return weights of feet [4] without those that bear none by torques, N·m [4, 3].

    All are kept where no foot bears any. The legs' own weight is left out.
    """
    try:
        force = np.linalg.solve(np.swapaxes(jacobian, 1, 2), torque[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return weight
    low, high = _BEARS
    share = force @ gravity / (ROBOT_MASS * GRAVITY)
    bears = weight * np.clip((share - low) / (high - low), 0.0, 1.0)
    return bears if bears.sum() > 0.1 else weight


def _shank_rates(angles: Floats, turning: Floats) -> Floats:
    """Return the angular velocity of each shank in the base, rad/s [4, 3]; round feet roll."""
    haa, pitching = angles[:, 0], turning[:, 1] + turning[:, 2]
    return np.column_stack([turning[:, 0], pitching * np.cos(haa), pitching * np.sin(haa)])


_STAND_UP: Final = 1.5  # s
_LONGEST_STEP: Final = 0.1  # s by which the command advances in one step
_EARLY: Final = 0.25  # share of a period by which a step may come early


class LearnedPolicy:
    """Learned policy: stands up to the default pose, then acts at the contract's rate.

    Called more often than that, it holds its targets. A base velocity that is not measured is
    estimated from legs and IMU.
    """

    def __init__(self, contract: Contract, network: Network) -> None:
        """network: observation [size] to action [12]. InputError for gains the drives lack."""
        own = [anymal.POSITION_GAIN, anymal.VELOCITY_GAIN]
        for joint in contract.joints:
            gains = [contract.gains[joint].stiffness, contract.gains[joint].damping]
            if not np.allclose(gains, own, rtol=0.01):
                raise InputError(
                    f'policy {contract.name!r} was made for gains {gains} of {joint}; '
                    f'the drives have {own}'
                )
        self.contract = contract
        self.rate = contract.rate
        self.ramp = _STAND_UP
        self._network = network
        self._order = np.array([JOINT_NAMES.index(joint) for joint in contract.joints])
        self._pose = contract.ordered(contract.default_pose)
        self._scale = contract.ordered(contract.action.scale)
        self.reset()

    @classmethod
    def load(cls, path: Path) -> 'LearnedPolicy':
        """Load a folder; InputError for a bad one."""
        contract, tensors = read_folder(path)
        return cls(contract, Perceptron(tensors, contract.network.activation))

    def reset(self) -> None:
        """Reset; the next step begins to stand up from the measured pose."""
        self._start: tuple[float, Floats] | None = None  # s, and the pose, rad [12]
        self._due = -np.inf
        self._acted: float | None = None
        self._targets = np.zeros(12)
        self._action = np.zeros(12)
        self._limiter = CommandRateLimiter(self.contract.observation.command_rate_limit)
        self._velocity = BaseVelocity()
        self._standing_up = True

    def take_over(self) -> float:
        """Reset; the next step acts at once, on a robot that stands or walks."""
        self.reset()
        self._standing_up = False
        return 0.0

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Return joint targets, rad [12]; command: m/s, m/s, rad/s [3]."""
        estimate = self._velocity.update(time, inputs)
        velocity = estimate if base_velocity is None else base_velocity
        if self._start is None:
            self._start = time, inputs.position.copy()
        elapsed, first = time - self._start[0], self._start[1]
        if self._standing_up and elapsed < self.ramp:
            share = 0.5 - 0.5 * np.cos(np.pi * min(elapsed / (0.8 * self.ramp), 1.0))
            return first + share * (self._in_robot_order(self._pose) - first)
        if time >= self._due - _EARLY / self.rate:
            late = time - self._due > 1.0 / self.rate
            self._due = time + 1.0 / self.rate if late else self._due + 1.0 / self.rate
            since = 1.0 / self.rate if self._acted is None else time - self._acted
            self._acted = time
            self._targets = self._act(command, inputs, velocity, min(since, _LONGEST_STEP))
        return self._targets

    def _act(self, command: Floats, inputs: Inputs, velocity: Floats, seconds: float) -> Floats:
        limited = self._limiter.advance(seconds, np.asarray(command, np.float64)[None])
        observation = self.contract.observation.assemble(
            {
                'base_velocity': velocity,
                'angular_velocity': inputs.spin,
                'gravity': inputs.gravity,
                'command': limited[0],
                'joint_position': inputs.position[self._order] - self._pose,
                'joint_velocity': inputs.velocity[self._order],
                'last_action': self._action,
            }
        )
        clip = self.contract.action.clip
        self._action = np.clip(self._network(observation), -clip, clip).astype(np.float64)
        return self._in_robot_order(self._pose + self._scale * self._action)

    def _in_robot_order(self, values: Floats) -> Floats:
        ordered = np.empty(12)
        ordered[self._order] = values
        return ordered
