"""A drive made of formulas, for tests that need aligned signals without a recording."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from power_estimator.drive_types import infer_types
from power_estimator.network.checkpoint import Checkpoint, NetworkConfig
from power_estimator.training.cross_validation import CrossValidation
from power_estimator.training.protocol import Protocol
from power_estimator.training.trainer_config import TrainerConfig
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter

RATE = 200.0
torch.set_num_threads(1)


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
    electrical = torque * velocity + 0.03 * lossy * torque**2 + 2 * lossy * np.abs(velocity) + 8
    power = low_passed(np.maximum(electrical, 0), 5.0) + 0.3 * rng.standard_normal(torque.shape)
    position = np.cumsum(velocity, axis=0) / RATE

    data = AlignedDataset.blank(
        RATE,
        names,
        start + np.arange(samples) / RATE,
        recording,
        position=position,
        velocity=velocity,
        torque=torque,
        command=position + error,
        power=power,
        voltage=48.0,
        current=power / 48.0,
        temperature=40.0,
    )
    return replace(
        data,
        segment=(np.arange(samples) * segments // samples).astype(np.int32),
        supply=(power.sum(axis=1) + 100).astype(np.float32),
    )


@pytest.fixture(scope='session')
def drives() -> Callable[..., AlignedDataset]:
    """Factory of synthetic drives; see make_drives."""
    return make_drives


def make_bag(
    folder: Path,
    seconds: float = 40.0,
    seed: int = 0,
    *,
    rate: float = 400.0,
    commanded: tuple[str, ...] = (),
    spoil: Callable[[dict[str, np.ndarray]], object] = lambda arrays: None,
    **options: object,
) -> Path:
    """
    A bag of synthetic drives: states at `rate`, commands 100 Hz, power 1 kHz, supply 100 Hz.

    spoil may change the arrays (stamps in ns and signals by name) before they are written.
    """
    data = make_drives(seconds + 0.1, seed=seed, **options)
    start = round(data.time[0] * 1e9)

    def stamps(rate: float) -> np.ndarray:
        return start + np.arange(round(seconds * rate)) * round(1e9 / rate)

    def at(values: np.ndarray, rate: float) -> np.ndarray:
        times = np.arange(round(seconds * rate)) / rate
        grid = np.arange(len(values)) / RATE
        columns = values.reshape(len(values), -1).T
        return np.stack([np.interp(times, grid, column) for column in columns], axis=1)

    commands, supplies, drawn = (stamps(rate) for rate in (100, 100, 1000))
    names = data.names
    commanded = commanded or names
    arrays = {
        'states': stamps(rate),
        'position': at(data.position, rate),
        'velocity': at(data.velocity, rate),
        'torque': at(data.torque, rate),
        'command': at(data.command, 100)[:, [names.index(n) for n in commanded]],
        'current': at(data.power, 1000) / 48,
    }
    arrays['voltage'] = np.full(arrays['current'].shape, 48.0)
    spoil(arrays)
    states = arrays['states']
    total = at(data.supply, 100)[:, 0]
    messages = {
        'joint_states': (
            cdr.JOINT_STATE,
            states,
            cdr.in_a_list(
                cdr.joint_state_block(
                    states, names, arrays['position'], arrays['velocity'], arrays['torque']
                )
            ),
        ),
        'joint_commands': (
            cdr.JOINT_STATE,
            commands,
            cdr.in_a_list(cdr.joint_state_block(commands, commanded, arrays['command'])),
        ),
        'drive_supply': (
            cdr.DRIVE_SUPPLY,
            drawn,
            cdr.in_a_list(
                *cdr.drive_supply_blocks(
                    drawn, 0, drawn.astype(np.uint64), names, arrays['voltage'], arrays['current']
                )
            ),
        ),
        'supply': (
            cdr.BATTERY_STATE,
            supplies,
            cdr.in_a_list(cdr.battery_block(supplies, np.full(len(total), 48.0), -total / 48)),
        ),
    }
    with BagWriter(folder) as bag:
        for topic, (type_name, times, encoded) in messages.items():
            handle = bag.add_topic(topic, type_name)
            for time, message in zip(times.tolist(), encoded, strict=True):
                bag.write(handle, time, message)
    return folder


@pytest.fixture(scope='session')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of two drives, LF_HAA and LF_HFE."""
    return make_bag(tmp_path_factory.mktemp('bags') / 'synthetic')


@pytest.fixture(scope='session')
def bags() -> Callable[..., Path]:
    """Factory of bags; see make_bag."""
    return make_bag


@pytest.fixture(scope='session')
def checkpoint() -> Checkpoint:
    """Small networks of HAA and HFE that were trained briefly."""
    data = make_drives(90.0)
    validation = CrossValidation(
        data,
        infer_types(data.names),
        network=NetworkConfig(hidden=24),
        training=TrainerConfig(epochs=10, batch=8, chunk=50),
        protocol=Protocol(folds=1),
    )
    trainers = {job: validation.trainer(job) for job in validation.jobs}
    for trainer in trainers.values():
        while not trainer.done:
            trainer.epoch()
    return validation.checkpoint(0, trainers)
