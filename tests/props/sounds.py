"""Test sounds: bursts of noise at known times, and recordings of a foot that lands at those."""

from collections.abc import Sequence

import numpy as np
from power_recordings.messages.samples import FootForceSamples, ImuSamples
from power_recordings.reading.reader import Recording

RATE = 16_000  # Hz
FLIGHT = 2.0 / 343.0  # s, of sound over 2 m
_CLAP = 24.0  # of a footstep's amplitude


def walking_sound(
    seconds: float,
    landings: Sequence[float],
    *,
    start: float = 0.0,
    claps: Sequence[float] = (),
    drift: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """
    Return footsteps and claps in steady noise as a microphone 2 m away records them [N].

    Levels mean nothing. landings, claps: s after the start of a recording of `seconds`; start: of
    the sound, on the same clock; drift: ppm by which the clock of the sound is slow.
    """
    random = np.random.default_rng(seed)
    clock = 1.0 + 1e-6 * drift
    sound = 2e-4 * random.standard_normal(round((seconds - start) / clock * RATE))
    tail = np.arange(round(0.3 * RATE)) / RATE
    bursts = [(t, 0.02, 0.02) for t in landings] + [(t, 0.02 * _CLAP, 0.004) for t in claps]
    for time, amplitude, decay in bursts:
        first = round((time + FLIGHT - start) / clock * RATE)
        if first < 0:
            continue
        part = sound[first : first + len(tail)]
        noise = amplitude * random.standard_normal(len(tail)) * np.exp(-tail / decay)
        part += noise[: len(part)]
    return sound


def footsteps(
    seconds: float, landings: Sequence[float] = (), knock: float | None = None
) -> Recording:
    """Return a recording of one foot, loaded with 400 N at each landing, and of an IMU."""
    time = np.arange(round(400 * seconds)) / 400
    force = np.zeros(len(time))
    for at in landings:
        inside = (time >= at) & (time < at + 0.2)
        force[inside] = 400.0 * np.clip((time[inside] - at) / 0.01, 0, 1)
    stamps = (1e9 * time).astype(np.int64)
    felt = np.zeros((len(time), 3), np.float32)
    felt[:, 2] = 9.81 + 0.02 * np.random.default_rng(0).standard_normal(len(time))
    if knock is not None:
        felt[round(400 * knock), 2] += 30.0
    still = np.zeros_like(felt)
    return Recording.in_memory(
        'made',
        {
            'foot_force': FootForceSamples(stamps, ('LF_FOOT',), force[:, None].astype('f4')),
            'imu': ImuSamples(stamps, np.zeros((len(time), 4), np.float32), still, felt),
        },
    )
