"""Power Prediction Network as a power model, windowed and with carried state."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError

from power_estimator.drive_types import assign, owners
from power_estimator.model import Needs
from power_estimator.network.checkpoint import Checkpoint
from power_estimator.network.features import FEATURES, features
from power_estimator.network.lstm import LstmBank
from power_estimator.network.out_of_distribution import Guard
from power_estimator.scores import block_means


class PowerPredictionNetwork:
    """LSTM from position error (rad), torque (N·m) and speed (rad/s) to watts, one per drive type.

    It is the network of the paper's Section II-A. `predict` returns W [T, D] and carries the
    LSTM's state from sample to sample; `WindowedNetwork` starts each window from a state of zero.
    """

    def __init__(self, checkpoint: Checkpoint, name: str = 'ppn') -> None:
        self.checkpoint = checkpoint
        self.name = name
        self.types = tuple(network.type for network in checkpoint.networks)
        self._networks = {n.type.name: (n.weights, n.scaling) for n in checkpoint.networks}

    @property
    def needs(self) -> Needs:
        """Inputs at the network's rate, with a memory of its history."""
        config = self.checkpoint.config
        inputs = dict.fromkeys(FEATURES, '')
        return Needs(inputs, config.rate, smooth=True, memory=config.history / config.rate)

    @classmethod
    def load(cls, path: Path) -> 'PowerPredictionNetwork':
        """Load a run folder, a file or a shipped network by name; InputError names the fault."""
        return cls(Checkpoint.load(path))

    def stream(self, drives: Sequence[str]) -> LstmBank:
        """Return the networks of the drives with carried state; InputError if none is known."""
        columns = assign(drives, self.types)
        if not any(columns.values()):
            patterns = ', '.join(p for t in self.types for p in t.patterns)
            raise InputError(
                f'{self.name} knows drives named {patterns}; the input has {", ".join(drives)}'
            )
        return LstmBank(self._networks, columns, len(drives))

    def range_of(self, drives: Sequence[str]) -> tuple[Singles, Singles]:
        """Return the lowest and highest features [D, 3] in training; NaN for unknown drives."""
        unknown = (np.nan,) * len(FEATURES)
        found = owners(drives, self.checkpoint.networks)
        low = np.array([n.low if n else unknown for n in found], np.float32)
        return low, np.array([n.high if n else unknown for n in found], np.float32)

    def guard(self, drives: Sequence[str]) -> Guard:
        """Return the out-of-distribution test of the drives."""
        found = owners(drives, self.checkpoint.networks)
        return Guard(n.out_of_distribution if n else None for n in found)

    def interval(self, power: Singles, drives: Sequence[str]) -> tuple[Singles, Singles]:
        """Return the lowest and highest power to be expected of estimates, W [N, D] at 50 Hz.

        NaN for drives of no known type and for networks without intervals.
        """
        low = np.full(power.shape, np.nan, np.float32)
        high = low.copy()
        columns = assign(drives, self.types)
        for network in self.checkpoint.networks:
            own = columns[network.type.name]
            if network.intervals is not None and own:
                low[:, own], high[:, own] = network.intervals.around(power[:, own])
        return low, high

    def predict(self, data: AlignedDataset) -> Singles:
        """Return the power in W [T, D], with the state carried from sample to sample.

        NaN for drives of no known type, where a feature is missing and for warm_up samples after.
        Data at a multiple of the network's rate is averaged down and the estimate held; InputError
        for another rate.
        """
        config = self.checkpoint.config
        times = round(data.rate / config.rate)
        if times < 1 or abs(data.rate - times * config.rate) > 1e-3 * config.rate:
            raise InputError(
                f'{self.name} runs at {config.rate:g} Hz or a multiple; '
                f'{", ".join(data.recordings)} is aligned to {data.rate:g} Hz'
            )
        x = features(data)
        if times == 1:
            return self._estimates(x, list(data.segments()), data.names)
        result = np.full(x.shape[:2], np.nan, np.float32)
        for run in data.segments():
            rows = block_means(x, [run], times)
            power = self._estimates(rows, [slice(0, len(rows))], data.names)
            held = np.repeat(power, times, axis=0)
            result[run.start : run.start + len(held)] = held
        return result

    def _estimates(self, x: Singles, stretches: Sequence[slice], drives: Sequence[str]) -> Singles:
        """Watts [N, D] of features [N, D, 3] at the network's rate, with carried state."""
        bank = self.stream(drives)
        borders = np.zeros(len(x), bool)
        borders[[stretch.start for stretch in stretches if stretch.start < len(x)]] = True
        good = np.all(np.isfinite(x), axis=2)
        fresh = good & (borders[:, None] | ~np.vstack([good[:1], good[:-1]]))
        power = bank.run(np.where(good[..., None], x, 0), fresh)
        index = np.arange(len(x))[:, None]
        since = index - np.maximum.accumulate(np.where(fresh, index, 0), axis=0)
        power[~good | (since < self.checkpoint.config.warm_up)] = np.nan
        return power


class WindowedNetwork(PowerPredictionNetwork):
    """Network in the paper's form: each block of outputs from 0.3 s of history and a zero state.

    NaN where the window reaches over the start of a gap-free stretch.
    """

    def _estimates(self, x: Singles, stretches: Sequence[slice], drives: Sequence[str]) -> Singles:
        block = self.checkpoint.config.block
        result = np.full(x.shape[:2], np.nan, np.float32)
        for run in stretches:
            ends = np.arange(run.start + block, run.stop + 1, block)
            rows = slice(run.start, run.start + block * len(ends))
            for name, columns in assign(drives, self.types).items():
                for column in columns:
                    result[rows, column] = self._windows(name, x[:, column], ends, run.start)
        return result

    def _windows(self, name: str, x: Singles, ends: NDArray[np.intp], start: int) -> Singles:
        """Watts of blocks that end at rows of x [N, 3], one after another."""
        config = self.checkpoint.config
        result = np.full((len(ends), config.block), np.nan, np.float32)
        inside = np.flatnonzero(ends - start >= config.history)
        for part in np.array_split(inside, max(1, len(inside) // 512)):
            rows = ends[part] - config.history + np.arange(config.history)[:, None]
            bank = LstmBank({name: self._networks[name]}, {name: range(len(part))}, len(part))
            if len(part):
                result[part] = bank.run(x[rows])[-config.block :].T
        return result.ravel()
