"""
A simulated microphone beside the simulated robot: pressure over time from a recording.

It exists so that programs that listen can be tried without a robot. What a foot, a gear or a fan
sounds like is assumed; its levels say nothing about real robots.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.reading.reader import Recording
from scipy.signal import butter, lfilter, sosfilt
from wattwalk_core.errors import InputError

from sim_bridge.plant.config_fields import bounded, check

Floats = NDArray[np.float64]

COMMENT = 'simulated microphone (ros2 run sim_bridge sound); no real robot was heard'
SPEED_OF_SOUND = 343.0  # m/s
_REFERENCE = 20e-6  # Pa
_TOUCH, _OFF = 20.0, 5.0  # N
_RISE = 0.03  # s after the touch in which its harshness is judged
_HARSH = 50e3  # N/s, for which impact_pressure is given
_RING = 0.3  # s
_MODES = ((640.0, 0.018), (1450.0, 0.009))  # Hz, s: how a leg rings
_BLOCK = 0.5  # s


@dataclass(frozen=True)
class Microphone:
    """Sources and microphone; pressures are RMS at 1 m from the robot."""

    distance: float = bounded(2.0, 0.1, 100.0, 'm', 'from robot to microphone')
    full_scale: float = bounded(120.0, 60.0, 160.0, 'dB SPL', 'of a sine at full scale')
    impact_pressure: float = bounded(0.5, 0.0, 100.0, 'Pa', 'of a foot loaded with 50 kN/s')
    impact_decay: float = bounded(0.025, 0.001, 0.2, 's', 'of a foot impact')
    gear_pressure: float = bounded(0.015, 0.0, 100.0, 'Pa', 'of a gear at 80 N·m and 7.5 rad/s')
    gear_ratio: float = bounded(50.0, 1.0, 1000.0, '', 'of motor to joint')
    gear_teeth: float = bounded(16.0, 1.0, 500.0, '', 'that mesh per turn of the motor')
    fan_pressure: float = bounded(0.004, 0.0, 100.0, 'Pa', 'of the fan')
    room_pressure: float = bounded(0.0006, 0.0, 100.0, 'Pa', 'of the room, at the microphone')
    clap_pressure: float = bounded(12.0, 0.0, 1000.0, 'Pa', 'of a clap beside the robot')

    def __post_init__(self) -> None:
        check(self, 'microphone')

    @property
    def unit(self) -> float:
        """Pa for a sample of 1."""
        return float(np.sqrt(2.0) * _REFERENCE * 10.0 ** (self.full_scale / 20.0))


@dataclass(frozen=True)
class Motion:
    """
    What makes sound in a recording; times in s after its start.

    touches [E]: when a foot lands. harshness [E]: the largest rate of its force, N/s. time [N],
    speed rad/s and torque N·m [N, D] of the joints.
    """

    seconds: float
    touches: Floats
    harshness: Floats
    time: Floats
    speed: Floats
    torque: Floats


def motion_of(recording: Recording) -> Motion:
    """What makes sound in a recording; InputError without foot_force or joint_states."""
    start = recording.start_ns
    feet, joints = recording.foot_force(), recording.joint_states()
    time = (feet.stamp_ns - start) / 1e9
    found = [_touches(time, force) for force in np.nan_to_num(feet.force.astype(float)).T]
    touches, harshness = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(touches)
    return Motion(
        seconds=recording.duration,
        touches=touches[order],
        harshness=harshness[order],
        time=(joints.stamp_ns - start) / 1e9,
        speed=np.nan_to_num(joints.velocity.astype(float)),
        torque=np.nan_to_num(joints.effort.astype(float)),
    )


def _touches(time: Floats, force: Floats) -> tuple[Floats, Floats]:
    """When a foot that was off the ground is loaded, and how harshly."""
    at, harshness, aloft = [], [], bool(force[0] < _OFF)
    slope = np.gradient(force, time)
    for index, value in enumerate(force.tolist()):
        if aloft and value > _TOUCH:
            aloft = False
            rise = (time >= time[index] - 0.01) & (time <= time[index] + _RISE)
            at.append(time[index])
            harshness.append(max(0.0, float(slope[rise].max())))
        elif value < _OFF:
            aloft = True
    return np.array(at), np.array(harshness)


def pressure(
    motion: Motion,
    microphone: Microphone,
    rate: int,
    *,
    seed: int = 0,
    start: float = 0.0,
    claps: Sequence[float] = (),
    drift: float = 0.0,
) -> Iterator[Floats]:
    """
    Pressure at the microphone, Pa, in blocks [n] of half a second at a rate in Hz.

    start: s after the recording's start at which the sound begins; it ends with the recording.
    claps: s after the recording's start. drift: ppm by which the clock of the sound is slow.
    InputError where nothing is left.
    """
    count = int((motion.seconds - start) / (1.0 + 1e-6 * drift) * rate)
    if count <= 0:
        raise InputError(
            f'--start is {start:g} s, but the recording ends at {motion.seconds:.1f} s'
        )
    random = np.random.default_rng(seed)
    away = microphone.distance / SPEED_OF_SOUND
    bangs = _Bangs(microphone, rate, np.random.default_rng((seed, 1)))
    landed = zip(motion.touches.tolist(), motion.harshness.tolist(), strict=True)
    events = [(t + away, h / _HARSH, False) for t, h in landed]
    events += [(t + away, 1.0, True) for t in claps]
    bangs.plan(sorted(((t - start) / (1.0 + 1e-6 * drift), s, c) for t, s, c in events))
    gears, fan = _Gears(motion, microphone, rate), _Fan(rate, random)
    size = round(_BLOCK * rate)
    for first in range(0, count, size):
        index = np.arange(first, min(first + size, count))
        time = start + index / rate * (1.0 + 1e-6 * drift) - away
        robot = bangs.take(first, len(index)) + gears.take(time)
        robot += microphone.fan_pressure * fan.take(time)
        room = microphone.room_pressure * random.standard_normal(len(index))
        yield robot / microphone.distance + room


class _Bangs:
    """Impacts and claps, each a burst that decays; what reaches into the next block is kept."""

    def __init__(self, microphone: Microphone, rate: int, random: np.random.Generator) -> None:
        self._microphone, self._rate, self._random = microphone, rate, random
        self._events: list[tuple[int, float, bool]] = []
        self._tail = np.zeros(0)
        high = min(6000.0, 0.45 * rate)
        self._band = butter(2, (150.0, high), 'bandpass', fs=rate, output='sos')

    def plan(self, events: Sequence[tuple[float, float, bool]]) -> None:
        self._events = [(round(t * self._rate), s, c) for t, s, c in events if t >= 0.0]

    def take(self, first: int, count: int) -> Floats:
        sound = np.zeros(max(count + round(_RING * self._rate) + 1, len(self._tail)))
        sound[: len(self._tail)] = self._tail
        while self._events and self._events[0][0] < first + count:
            at, strength, clap = self._events.pop(0)
            burst = self._burst(clap) * strength
            sound[at - first : at - first + len(burst)] += burst
        self._tail = sound[count:]
        return sound[:count]

    def _burst(self, clap: bool) -> Floats:
        time = np.arange(round(_RING * self._rate)) / self._rate
        noise = sosfilt(self._band, self._random.standard_normal(len(time)))
        noise /= np.sqrt(np.mean(np.square(noise)))
        if clap:
            return np.asarray(self._microphone.clap_pressure * noise * np.exp(-time / 0.004))
        sound = noise * np.exp(-time / self._microphone.impact_decay)
        for frequency, decay in _MODES:
            turn = 2.0 * np.pi * (frequency * time + self._random.random())
            sound += 0.7 * np.sin(turn) * np.exp(-time / decay)
        return np.asarray(self._microphone.impact_pressure * sound)


class _Gears:
    """A whine per joint: its pitch follows the motor's speed, its level torque and speed."""

    def __init__(self, motion: Motion, microphone: Microphone, rate: int) -> None:
        self._motion, self._rate = motion, rate
        self._mesh = microphone.gear_ratio * microphone.gear_teeth / (2.0 * np.pi)
        self._pressure = microphone.gear_pressure
        self._turn = np.arange(motion.speed.shape[1]) / 7.0

    def take(self, time: Floats) -> Floats:
        motion, sound = self._motion, np.zeros(len(time))
        inside = (time >= motion.time[0]) & (time <= motion.time[-1])
        for joint in range(motion.speed.shape[1]):
            speed = np.abs(np.interp(time, motion.time, motion.speed[:, joint])) * inside
            torque = np.abs(np.interp(time, motion.time, motion.torque[:, joint]))
            turn = self._turn[joint] + np.cumsum(speed * self._mesh) / self._rate
            self._turn[joint] = turn[-1] % 1.0
            loud = np.sqrt(0.05 + torque / 80.0) * speed / 7.5
            sound += loud * (np.sin(2 * np.pi * turn) + 0.4 * np.sin(4 * np.pi * turn))
        return np.asarray(np.sqrt(2.0) * self._pressure * sound)


class _Fan:
    """A steady rush with the tone of its blades; RMS 1."""

    def __init__(self, rate: int, random: np.random.Generator) -> None:
        self._random = random
        pole = float(np.exp(-2.0 * np.pi * 1000.0 / rate))
        self._b, self._a = [np.sqrt(1.0 - pole * pole)], [1.0, -pole]
        self._state = np.zeros(1)

    def take(self, time: Floats) -> Floats:
        noise = self._random.standard_normal(len(time))
        rush, self._state = lfilter(self._b, self._a, noise, zi=self._state)
        return np.asarray((rush + 0.7 * np.sin(2.0 * np.pi * 330.0 * time)) / np.sqrt(1.245))


def calibrator(
    level: float, microphone: Microphone, rate: int, seconds: float, seed: int = 0
) -> Iterator[Floats]:
    """A tone of 1 kHz at a level in dB SPL as this microphone hears it, Pa, a second a block."""
    random = np.random.default_rng(seed)
    amplitude = np.sqrt(2.0) * _REFERENCE * 10.0 ** (level / 20.0)
    for first in range(0, round(seconds * rate), rate):
        index = np.arange(first, min(first + rate, round(seconds * rate)))
        tone = amplitude * np.sin(2.0 * np.pi * 1000.0 * index / rate)
        yield tone + microphone.room_pressure * random.standard_normal(len(index))
