"""A drive made of formulas, for tests that need aligned signals without a recording."""

from collections.abc import Callable

import numpy as np
import pytest
from power_daq.recording.aligned import AlignedDataset

RATE = 200.0


def low_passed(x: np.ndarray, frequency: float) -> np.ndarray:
    """First-order low-pass along the rows."""
    a = np.exp(-2 * np.pi * frequency / RATE)
    y = np.zeros_like(x)
    for t in range(1, len(x)):
        y[t] = a * y[t - 1] + (1 - a) * x[t]
    return y


def make_drives(
    seconds: float = 60.0,
    names: tuple[str, ...] = ('LF_HAA', 'LF_HFE'),
    seed: int = 0,
    segments: int = 1,
    start: float = 1000.0,
    recording: str = 'synthetic',
) -> AlignedDataset:
    """
    Drives with friction, copper loss and a power meter that lags by 30 ms (memory).

    Torque, speed and error wander at random; every other drive is twice as lossy.
    """
    rng = np.random.default_rng(seed)
    samples, drives = round(seconds * RATE), len(names)
    wander = low_passed(rng.standard_normal((samples, 3 * drives)), 3.0)
    wander /= wander.std(axis=0)
    torque, velocity, error = 15 * wander[:, :drives], 2 * wander[:, drives : 2 * drives], None
    error = 0.02 * wander[:, 2 * drives :] + torque / 80
    lossy = 1 + np.arange(drives) % 2
    electrical = (
        torque * velocity + 0.03 * lossy * torque**2 + 2 * lossy * np.abs(velocity) + 8
    )
    power = low_passed(np.maximum(electrical, 0), 5.0) + 0.3 * rng.standard_normal(torque.shape)
    position = np.cumsum(velocity, axis=0) / RATE

    def f(x: np.ndarray) -> np.ndarray:
        return x.astype(np.float32)

    voltage = np.full(torque.shape, 48.0)
    return AlignedDataset(
        rate=RATE,
        names=names,
        time=start + np.arange(samples) / RATE,
        segment=(np.arange(samples) * segments // samples).astype(np.int32),
        position=f(position),
        velocity=f(velocity),
        torque=f(torque),
        command=f(position + error),
        power=f(power),
        voltage=f(voltage),
        current=f(power / voltage),
        temperature=f(np.full(torque.shape, 40.0)),
        supply=f(power.sum(axis=1) + 100),
        recordings=(recording,),
        recording=np.zeros(samples, np.int32),
    )


@pytest.fixture(scope='session')
def drives() -> Callable[..., AlignedDataset]:
    """Factory of synthetic drives; see make_drives."""
    return make_drives
