"""Measured walks: a policy on a task, by the simulated power meter, supply, joints and feet."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from policy_runner.policies.by_name import load_policy
from power_recordings.alignment.align import align
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.reading.reader import Recording
from sim_bridge.offline.controllers import PolicyWalk, SensedWalk
from sim_bridge.offline.run import OfflineRun
from sim_bridge.offline.telemetry import gather
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import Simulation
from sim_bridge.plant.terrain import FLAT, rough
from sim_bridge.plant.world import stand_world, walking_world
from wattwalk_core.anymal import JOINT_NAMES, ROBOT_MASS
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError

from policy_training.evaluation.tasks import TASKS, Task

RAW_RATE: Final = 400.0  # Hz
_SMOOTHING: Final = 1.0  # s, over which velocity is averaged to see whether it is steady
_STEADY: Final = np.array([0.1, 0.1, 0.15])  # m/s, m/s, rad/s around the median
_AFTER: Final = 1.5  # s for which a command must have held


@dataclass(frozen=True)
class MeasuredWalk:
    """Measurements of a policy on a task: T samples at 200 Hz, R at 400 Hz."""

    policy: str
    task: Task
    data: AlignedDataset  # smoothed as the power models want it
    raw: AlignedDataset  # the same at 400 Hz and not smoothed
    velocity: Floats  # vx, vy m/s, yaw rate rad/s [T, 3], of data
    foot_force: Floats  # N [R, 4], of raw
    steady: Bools  # [T] of data, where the velocity is constant
    raw_steady: Bools  # [R], the same of raw
    falls: int
    mass: float  # kg
    recording: Recording


def measure_walk(
    source: str,
    task: Task,
    plant: Plant,
    *,
    duration: float,
    seed: int,
    on_rough: bool = False,
    ideal: bool = False,
    trust_code: bool = False,
) -> MeasuredWalk:
    """Run a policy (a name or a folder) on a task and measure it.

    Offline, through the wire's quantisation and the meter, as a recording would have it. Only
    stretches of constant velocity are marked as steady (Section II-B). ideal: the policy is given
    the true state, with the velocity of the base, in place of what the sensors read. InputError
    for a policy that is not there.
    """
    world = walking_world(rough(seed) if on_rough else FLAT)
    walk = PolicyWalk if ideal else SensedWalk
    controller = walk(source, load_policy(source, trust_code=trust_code), task)
    telemetry = list(OfflineRun(plant, world, controller, duration=duration, seed=seed))
    recording = gather(f'{source} {task.name}', telemetry, world.joints, world.joints)
    falls = sum(event.kind == 'fall' for part in telemetry for event in part.events)
    return walk_of(recording, source, task, falls=falls, mass=world.mass)


def walk_of(
    recording: Recording, policy: str, task: Task, *, falls: int, mass: float
) -> MeasuredWalk:
    """Measure the walk in a recording; falls: counted elsewhere; mass: of the robot, kg."""
    data = align(recording)
    raw = align(recording, rate=RAW_RATE, smooth=False)
    velocity, raw_velocity = _velocity(recording, data.time), _velocity(recording, raw.time)
    forces = recording.foot_force()
    return MeasuredWalk(
        policy=policy,
        task=task,
        data=data,
        raw=raw,
        velocity=velocity,
        foot_force=values_at(raw.time, forces.stamp_ns * 1e-9, forces.force),
        steady=_steady(data, velocity, _held(recording, data.time, task)),
        raw_steady=_steady(raw, raw_velocity, _held(recording, raw.time, task)),
        falls=falls,
        mass=mass,
        recording=recording,
    )


def recorded_walk(path: Path, policy: str) -> MeasuredWalk:
    """Return the walk of a bag of the running nodes; its task is the most frequent command.

    InputError for a bag that lacks a topic, or never commands to move.
    """
    recording = Recording.open(path)
    commands = np.round(np.asarray(recording.cmd_vel().velocity, np.float64), 3) + 0.0
    rows, counts = np.unique(
        commands[np.abs(commands).max(axis=1) > 0], axis=0, return_counts=True
    )
    if not len(rows):
        raise InputError(f'{path}: cmd_vel never asks the robot to move')
    vx, vy, yaw = rows[np.argmax(counts)].tolist()
    known = {task.command: task.name for task in TASKS}
    task = Task(known.get((vx, vy, yaw), f'{vx:g},{vy:g},{yaw:g}'), (vx, vy, yaw))
    return walk_of(recording, policy, task, falls=_falls(recording), mass=ROBOT_MASS)


def columns_of(data: AlignedDataset, kind: str) -> list[int]:
    """Return the columns of the drives of a joint type, such as `KFE`."""
    return [i for i, name in enumerate(data.names) if name.endswith(kind)]


def idle_power(plant: Plant) -> float:
    """Return the power of the twelve drives at rest for 0.4 s, W, at the meter's terminals."""
    total = 0.0
    for joint in JOINT_NAMES:
        simulation = Simulation(plant, stand_world(joint))
        simulation.hold(JointCommand())
        total += float(np.mean([simulation.advance(400).power.mean() for _ in range(2)]))
    return total


def _velocity(recording: Recording, time: Floats) -> Floats:
    odometry = recording.odom()
    seconds = odometry.stamp_ns * 1e-9
    planar, turning = odometry.linear_velocity[:, :2], odometry.angular_velocity[:, 2]
    return values_at(time, seconds, np.column_stack([planar, turning]))


def values_at(time: Floats, seconds: NDArray[np.floating], values: NDArray[np.floating]) -> Floats:
    """Return values [N, C], of seconds [N], at times [T], s, by linear interpolation [T, C]."""
    return np.column_stack([np.interp(time, seconds, column) for column in values.T])


def _held(recording: Recording, time: Floats, task: Task) -> Bools:
    """Mark samples at which the task's command has been in force for 1.5 s [T]."""
    commands = recording.cmd_vel()
    seconds = commands.stamp_ns * 1e-9
    same = np.isclose(commands.velocity, task.command, atol=1e-3).all(axis=1)
    if same.all():
        return np.asarray(time - seconds[0] > _AFTER)
    broken = seconds[~same]
    latest = np.searchsorted(broken, time, side='right') - 1
    since = np.where(latest >= 0, broken[np.maximum(latest, 0)], seconds[0])
    given = np.searchsorted(seconds, time, side='right') > 0
    return np.asarray(given & (time - since > _AFTER))


def _steady(data: AlignedDataset, velocity: Floats, held: Bools) -> Bools:
    width = max(1, round(_SMOOTHING * data.rate))
    kernel = np.ones(width) / width
    smooth = np.column_stack([np.convolve(v, kernel, mode='same') for v in velocity.T])
    inner = np.zeros(len(velocity), bool)
    inner[width // 2 : len(velocity) - width // 2] = True
    usable = held & inner
    if not usable.any():
        return usable
    away = np.abs(smooth - np.median(smooth[usable], axis=0))
    return np.asarray(usable & (away < _STEADY).all(axis=1))


def _falls(recording: Recording) -> int:
    """Count how often the base tilts by more than a radian."""
    x, y, _, _ = recording.odom().orientation.T.astype(np.float64)
    down = 1.0 - 2.0 * (x * x + y * y) < np.cos(1.0)
    return int((np.diff(down.astype(np.int8)) == 1).sum())
