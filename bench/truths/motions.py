"""Motions of D joints as knots at 200 Hz: position [K, D] in rad, torque at the joint in N·m.

Sizes follow the drive's limits, so that each motion exists for each scale of drive.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from wattwalk_core.arrays import Floats

RATE = 200.0  # Hz of the knots


@dataclass(frozen=True)
class Asked:
    """A motion that is asked for, of D joints over so many knots."""

    random: np.random.Generator
    knots: int
    speed: Floats  # rad/s [D], the drives' limits
    torque: Floats  # N·m [D]

    @property
    def drives(self) -> int:
        """Number of joints D."""
        return len(self.speed)

    @property
    def time(self) -> Floats:
        """S [K]."""
        return np.arange(self.knots) / RATE

    def smooth(self, values: Floats, seconds: float) -> Floats:
        """Gaussian smoothing over time."""
        return gaussian_filter1d(values, seconds * RATE, axis=0, mode='nearest', truncate=3.0)

    def wander(self, seconds: float, columns: int) -> Floats:
        """Smooth noise of unit size [K, columns] that changes within so many seconds."""
        coarse = max(int(seconds * RATE / 4), 1)
        count = self.knots // coarse + 8
        noise = gaussian_filter1d(self.random.standard_normal((count, columns)), 4.0, axis=0)
        noise /= max(float(noise.std()), 1e-9)
        at, known = np.arange(self.knots) / coarse + 2, np.arange(count)
        wide = np.stack([np.interp(at, known, column) for column in noise.T], axis=1)
        return self.smooth(wide, seconds / 8)

    def held(self, least: float, most: float, choose: Callable[[int], Floats]) -> Floats:
        """Values [K, columns] that change at once after random times between least and most, s."""
        lengths = self.random.uniform(least, most, int(self.knots / RATE / least) + 2)
        index = np.searchsorted(np.cumsum(lengths), self.time)
        return choose(len(lengths))[np.minimum(index, len(lengths) - 1)]


def walk(ask: Asked) -> tuple[Floats, Floats]:
    """Gait with changing commands: stance that bears, swing that hurries, cycles that differ."""
    r, d = ask.random, ask.drives
    legs = (d + 2) // 3
    command = ask.smooth(ask.held(2.0, 6.0, lambda n: r.uniform(-1, 1, (n, 3))), 0.3)
    pace = r.uniform(1.3, 2.1) * (1 + 0.15 * command[:, 2] + 0.05 * ask.wander(2.0, 1)[:, 0])
    phase = 2 * np.pi * np.cumsum(pace) / RATE
    stretch = np.abs(command[:, 0]) * 0.6 + 0.35
    q, tau = np.empty((ask.knots, d)), np.empty((ask.knots, d))
    kinds = r.uniform(0.85, 1.15, (8, d))
    alone = int(r.integers(3)) if d == 1 else 0
    for joint in range(d):
        leg, kind = divmod(joint + alone, 3)
        here = phase + (0.0, np.pi, np.pi, 0.0)[leg % 4] + 2 * np.pi * (leg // 4) / max(legs, 1)
        stance = 1 / (1 + np.exp(-9 * np.sin(here)))
        swing = np.clip(-np.sin(here), 0, None) ** 1.4
        land = np.exp(-((((here / (2 * np.pi)) % 1.0) - 0.04) ** 2) / 0.0008)
        k = kinds[:, joint]
        if kind == 0:
            angle = 0.07 * k[0] * np.sin(here + 0.4) + 0.14 * k[1] * command[:, 1] * np.sin(here)
            load = stance * (0.16 * k[2] + 0.07 * command[:, 1]) - 0.03
        elif kind == 1:
            angle = 0.4 + 0.40 * k[0] * stretch * np.cos(here) * np.tanh(3 * command[:, 0])
            angle += 0.10 * k[1] * swing
            load = stance * (0.11 * k[2] * np.sin(here - 0.6) - 0.05) + 0.06 * land
        else:
            angle = -0.8 - (0.40 * k[0] + 0.35 * stretch) * swing + 0.05 * np.sin(2 * here)
            load = stance * (0.30 * k[2] + 0.08 * stretch) - 0.04 + 0.12 * k[3] * land
        q[:, joint], tau[:, joint] = angle, load
    q += 0.008 * ask.wander(0.2, d)
    tau += 0.04 * ask.wander(0.15, d) + 0.04 * ask.wander(1.5, d)
    q = ask.smooth(q, 0.008) * (ask.speed / 7.5)
    return q, ask.smooth(tau, 0.005) * ask.torque


def ladder(ask: Asked) -> tuple[Floats, Floats]:
    """Constant speeds of both signs under constant loads of both signs."""
    r, d = ask.random, ask.drives
    speeds = np.array([0.0, 0.03, 0.08, 0.15, 0.3, 0.5, 0.7, 0.9])
    span = int(r.uniform(1.2, 2.5) * RATE)
    count = ask.knots // span + 2
    half = r.choice(speeds, (count // 2 + 1, d))
    sign = r.choice([-1.0, 1.0], half.shape)
    speed = np.stack([half * sign, -half * sign], axis=1).reshape(-1, d)[:count]
    load = r.choice([0.0, 0.1, 0.25, 0.4], (count, d)) * r.choice([-1.0, 1.0], (count, d))
    w = ask.smooth(np.repeat(speed, span, axis=0)[: ask.knots], 0.06) * ask.speed
    tau = ask.smooth(np.repeat(load, span, axis=0)[: ask.knots], 0.08) * ask.torque
    tau = tau + 0.004 * ask.torque * ask.wander(0.06, d)
    return np.cumsum(w, axis=0) / RATE, tau


def arm(ask: Asked) -> tuple[Floats, Floats]:
    """Moves from pose to pose with rests, gravity of a payload that is picked up and put down."""
    r, d = ask.random, ask.drives
    q, tau = np.empty((ask.knots, d)), np.empty((ask.knots, d))
    heavy = ask.smooth(ask.held(4.0, 12.0, lambda n: r.uniform(0.5, 1.0, (n, 1))), 0.15)[:, 0]
    for joint in range(d):
        angle, start, now = np.empty(ask.knots), 0, r.uniform(-1, 1)
        while start < ask.knots:
            goal = r.uniform(-1.6, 1.6)
            fastest = r.uniform(0.2, 0.9) * ask.speed[joint]
            length = max(int(1.9 * abs(goal - now) / fastest * RATE), int(0.25 * RATE))
            s = np.arange(1, length + 1) / length
            path = now + (goal - now) * s**3 * (10 - 15 * s + 6 * s * s)
            rest = np.full(int(r.choice([0.1, 0.5, 2.0]) * RATE), goal)
            both = np.concatenate([path, rest])[: ask.knots - start]
            angle[start : start + len(both)] = both
            start, now = start + len(both), goal
        share = r.uniform(0.25, 0.55) * (0.0 if r.random() < 0.2 else 1.0)
        pull = share * heavy * np.sin(angle + r.uniform(-1, 1))
        brisk = np.gradient(np.gradient(angle)) * RATE * RATE
        swing = r.uniform(0.05, 0.15) / (3.0 * ask.speed[joint])
        q[:, joint], tau[:, joint] = angle, (pull + swing * brisk) * ask.torque[joint]
    q += 2e-4 * ask.wander(0.15, d)
    return ask.smooth(q, 0.012), ask.smooth(tau, 0.008) + 0.006 * ask.torque * ask.wander(0.1, d)


def wheel(ask: Asked) -> tuple[Floats, Floats]:
    """Driving: turns on and on; speeds up, cruises, brakes, reverses, up and down slopes."""
    r, d = ask.random, ask.drives

    def goals(count: int) -> Floats:
        way = np.where(r.random((count, 1)) < 0.25, -0.5, 1.0)
        return way * r.choice([0.0, 0.2, 0.4, 0.6, 0.85], (count, 1))

    speed = ask.smooth(ask.held(2.0, 9.0, goals), 0.5) * (1 + 0.01 * ask.wander(3.0, 1))
    turn = 0.06 * ask.wander(4.0, 1) * r.choice([-1.0, 1.0], d)
    w = (speed + turn) * ask.speed
    rolling = 0.04 * np.tanh(w / (0.01 * ask.speed)) * (1 + 0.3 * (w / ask.speed) ** 2)
    slope = 0.12 * ask.smooth(ask.held(5.0, 20.0, lambda n: r.normal(0, 1, (n, 1))), 1.0)
    push = 0.25 * np.gradient(w, axis=0) * RATE / ask.speed
    rough = 0.02 * ask.wander(0.08, d) * np.minimum(np.abs(w) / (0.1 * ask.speed), 1.0)
    return np.cumsum(w, axis=0) / RATE, (rolling + slope + push + rough) * ask.torque


def stall(ask: Asked) -> tuple[Floats, Floats]:
    """Locked shaft under load that is held, ramped and taken off: steps and slow waves."""
    r, d = ask.random, ask.drives
    steps = ask.held(4.0, 20.0, lambda n: r.uniform(-0.6, 0.6, (n, d)) * (r.random((n, d)) < 0.8))
    wave = 0.12 * np.sin(2 * np.pi * 0.05 * ask.time[:, None] + r.uniform(0, 6, d))
    tau = ask.smooth(steps, 0.3) + wave + 0.003 * ask.wander(0.1, d)
    return 0.01 * tau, tau * ask.torque


def hopper(ask: Asked) -> tuple[Floats, Floats]:
    """Hops: short stances of high torque at changing speed, long flights, pauses."""
    r, d = ask.random, ask.drives
    hops = ask.held(3.0, 10.0, lambda n: r.uniform(0.6, 1.0, (n, 1)) * (r.random((n, 1)) < 0.85))
    size = ask.smooth(hops, 0.2)
    rate = r.uniform(1.8, 2.8) * (1 + 0.04 * ask.wander(1.0, 1)[:, 0])
    phase = np.cumsum(rate)[:, None] / RATE + r.uniform(-0.02, 0.02, d)
    part = phase % 1.0
    stance = np.exp(-(((part - 0.25) / 0.11) ** 4))
    push = np.clip((part - 0.13) / 0.24, 0, 1)
    reset = np.clip((part - 0.45) / 0.4, 0, 1)
    crouch = 1 - np.cos(2 * np.pi * push)
    back = np.sin(np.pi * reset) ** 2
    other = np.where(np.arange(d) % 2 == 0, 1.0, -0.8)
    q = other * size * (0.16 * crouch + 0.22 * back) * (ask.speed / 7.5)
    tau = (
        other
        * size
        * (0.75 * stance * (1 + 0.1 * ask.wander(0.8, d)) - 0.05 * np.sin(2 * np.pi * reset))
    )
    tau = tau + 0.02 * ask.wander(0.1, d)
    return ask.smooth(q, 0.008), ask.smooth(tau, 0.006) * ask.torque


MOTIONS: Mapping[str, Callable[[Asked], tuple[Floats, Floats]]] = {
    'walk': walk,
    'ladder': ladder,
    'arm': arm,
    'wheel': wheel,
    'stall': stall,
    'hopper': hopper,
}
