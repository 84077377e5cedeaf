"""Features of what no formula explains: smooth functions of a drive's state and of time."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.signals.prepared import Prepared

_TURNS = 4 * np.pi  # rad, of a drive that turns on


@dataclass(frozen=True)
class Features:
    """Random Fourier features at N rows, each with the cause that it is a function of."""

    values: Floats  # [N, a]
    causes: tuple[str, ...]  # [a]


def smooth_features(prepared: Prepared) -> Features:
    """Sums of functions of one, two and all causes of each drive, and of time."""
    s, random = prepared.signals, np.random.default_rng(0)
    parts: list[tuple[str, Floats]] = []
    few = 1.0 if s.torque.shape[1] == 1 else 0.5
    for d in range(s.torque.shape[1]):
        own = _state(prepared, d)
        alone = [name for name in ('torque', 'speed', 'position') if name in own]
        parts += [(name, fourier(random, own[name], 5, 0.7)) for name in alone]
        pair = np.concatenate([own['torque'], own['speed']], axis=1)
        parts.append(('torque and speed', fourier(random, pair, round(12 * few), 1.0)))
        every = np.concatenate(list(own.values()), axis=1)
        parts.append(('several at once', fourier(random, every, round(20 * few), 1.6)))
    if not prepared.steady:  # operating points are in no order
        time = prepared.time - prepared.time[0]
        waves = np.arange(1, int(np.clip(time[-1] / 15, 1, 20)) + 1)
        parts.append(('time', np.cos(np.pi * waves * time[:, None] / time[-1]) / waves))
    causes = tuple(cause for cause, values in parts for _ in range(values.shape[1]))
    return Features(np.concatenate([values for _, values in parts], axis=1), causes)


def _state(prepared: Prepared, drive: int) -> Mapping[str, Floats]:
    """Reduced signals of a drive by cause, over their rms [N, 1]."""
    s = prepared.signals
    own = {
        name: prepared.reduced(values[:, drive : drive + 1])
        for name, values in (
            ('torque', s.torque),
            ('speed', s.velocity),
            ('acceleration', s.acceleration),
            ('torque rate', s.torque_rate),
        )
    }
    own = {n: np.clip(x / (np.sqrt(np.mean(x**2)) + 1e-12), -6, 6) for n, x in own.items()}
    at = s.position[:, drive]
    if np.isfinite(at).all() and np.ptp(at) < _TURNS:
        centred = (at - at.mean()) / (at.std() + 1e-9)
        own['position'] = prepared.reduced(centred[:, None])
    return own


def fourier(random: np.random.Generator, inputs: Floats, count: int, length: float) -> Floats:
    """Random Fourier features of a smooth function of inputs [N, k] → [N, 2·count]."""
    phase = inputs @ random.normal(0.0, 1.0 / length, (inputs.shape[1], count))
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1) / np.sqrt(count)
