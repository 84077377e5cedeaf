"""Cross-validated networks from aligned recordings, one per drive type."""

import threading
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Bools, Singles
from wattwalk_core.errors import InputError

from power_estimator.drive_types import DriveType, assign
from power_estimator.judge.judge import Judge
from power_estimator.judge.result import JudgedModel
from power_estimator.loader import PLAIN, load_model
from power_estimator.model import PowerModel
from power_estimator.network.checkpoint import (
    Checkpoint,
    Intervals,
    Network,
    NetworkConfig,
    TrainingRecording,
)
from power_estimator.network.features import features
from power_estimator.network.out_of_distribution import OutOfDistributionScore
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import PROXIES
from power_estimator.recordings import TrainingSet, check_complete
from power_estimator.scores import block_means
from power_estimator.training.protocol import Part, Protocol, rows_of, runs
from power_estimator.training.run_folder import NetworkRunFolder
from power_estimator.training.trainer import Tracks, Trainer
from power_estimator.training.trainer_config import TrainerConfig


@dataclass(frozen=True)
class Job:
    """Task to train the network of one drive type in one fold."""

    type: DriveType
    fold: int

    @property
    def name(self) -> str:
        """Name in files and progress bars."""
        return f'{self.type.name}-{self.fold}'


class CrossValidation:
    """Training and test of one network per drive type and fold (Section II-A).

    data: smoothed signals for targets and scores. others: further features [T, D, 3] of the same
    samples (as the live node forms them), which training mixes in. targets: W [T, D], by default
    the measured power, else a teacher's output. InputError for data without a usable drive.
    """

    def __init__(
        self,
        data: AlignedDataset,
        types: Sequence[DriveType],
        *,
        network: NetworkConfig | None = None,
        training: TrainerConfig | None = None,
        protocol: Protocol | None = None,
        others: Sequence[Singles] = (),
        recordings: Sequence[TrainingRecording] = (),
        targets: Singles | None = None,
    ) -> None:
        network = network or NetworkConfig()
        protocol = protocol or Protocol(margin=network.history)
        if protocol.margin < network.history:
            raise ValueError('the margin between parts is shorter than the history')
        if abs(data.rate - network.rate) > 1e-3 * network.rate:
            raise InputError(f'data at {data.rate:g} Hz, the network wants {network.rate:g} Hz')
        check_complete(data)
        self.data = data
        self._targets = data.power if targets is None else targets
        self.config = network
        self.training = training or TrainerConfig()
        self.protocol = protocol
        self._views = np.stack([features(data), *others])
        self.recordings = recordings
        measured = np.isfinite(data.power) & np.isfinite(self._views).all(axis=(0, 3))
        self._columns = {
            name: [c for c in columns if measured[:, c].any()]
            for name, columns in assign(data.names, types).items()
        }
        self.types = tuple(t for t in types if self._columns[t.name])
        if not self.types:
            raise InputError(
                f'{", ".join(data.recordings)}: no drive has measured power together with '
                f'position, command, torque and speed'
            )
        self._measured = measured
        self._segments = {t.name: self._usable(t) for t in self.types}
        self.jobs = tuple(Job(t, fold) for fold in range(protocol.folds) for t in self.types)

    @classmethod
    def of(cls, given: TrainingSet, types: Sequence[DriveType], **how: Any) -> Self:
        """Mix the live features of a training set in; how: as for the constructor."""
        return cls(given.data, types, others=[given.live], recordings=given.recordings, **how)

    def labels(self, job: Job) -> NDArray[np.int8]:
        """Return the `Part` (train, validation, test, unused) of each sample [T] for a job."""
        return self.protocol.labels(self._segments[job.type.name], job.fold)

    def trainer(self, job: Job) -> Trainer:
        """Return a new trainer of the job's network."""
        seed = np.random.SeedSequence(
            [self.training.seed, job.fold, zlib.crc32(job.type.name.encode())]
        )
        try:
            return Trainer(
                Tracks.join(self._stretches(job, Part.TRAIN, self.training.chunk)),
                Tracks.join(self._stretches(job, Part.VALIDATION, self.config.warm_up + 8)),
                hidden=self.config.hidden,
                warm_up=self.config.warm_up,
                block=self.config.block,
                config=replace(self.training, seed=int(seed.generate_state(1)[0]) >> 1),
            )
        except InputError as error:
            where = self._where(self._segments[job.type.name] >= 0)
            raise InputError(f'{where}: {job.type.name}: {error}') from None

    def restored(self, job: Job, state: Mapping[str, NDArray[np.floating]]) -> Trainer:
        """Return a job's trainer in a state of `Trainer.state`; InputError if it does not fit."""
        trainer = self.trainer(job)
        try:
            trainer.restore(state)
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise InputError(
                f'the state of {job.name} does not fit ({type(error).__name__}); start another run'
            ) from None
        return trainer

    def train(
        self,
        job: Job,
        folder: NetworkRunFolder,
        progress: Callable[[Trainer], None] = lambda trainer: None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> Trainer:
        """Train a job from the state in the folder, if any; the state of each epoch is kept there.

        progress: called after each epoch; stopped: asked before each.
        """
        kept = folder.load_state(job.name)
        if kept is None:
            trainer = self.trainer(job)
        else:
            trainer = self.restored(job, kept)
            progress(trainer)
        while not trainer.done and not stopped():
            trainer.epoch()
            folder.save_state(job.name, trainer.state())
            progress(trainer)
        return trainer

    def run(
        self,
        folder: NetworkRunFolder,
        progress: Callable[[str, Trainer], None] = lambda job, trainer: None,
        workers: int = 2,
    ) -> dict[Job, Trainer]:
        """Train all jobs on `workers` threads, each on one core; states are kept in the folder.

        progress: called with a job's name after each epoch. Ctrl-C ends at the next epoch; the
        state reached stays in the folder.
        """
        stop = threading.Event()

        def work(job: Job) -> Trainer:
            torch.set_num_threads(1)
            return self.train(job, folder, partial(progress, job.name), stop.is_set)

        torch.set_num_threads(1)
        with ThreadPoolExecutor(workers) as pool:
            futures = {pool.submit(work, job): job for job in self.jobs}
            try:
                for future in as_completed(futures):
                    future.result()
            finally:
                stop.set()
                pool.shutdown(cancel_futures=True)
        return {job: future.result() for future, job in futures.items()}

    def checkpoint(self, fold: int, trainers: Mapping[Job, Trainer]) -> Checkpoint:
        """Return a fold's networks with their training ranges, intervals and held-out spans."""
        networks = []
        held_out: dict[str, list[slice]] = {}
        for job, trainer in trainers.items():
            if job.fold != fold:
                continue
            labels = self.labels(job)
            columns = self._columns[job.type.name]
            used = (labels == Part.TRAIN)[:, None] & self._measured[:, columns]
            x = self._views[:, :, columns][:, used].reshape(-1, self._views.shape[3])
            low, high = x.min(axis=0), x.max(axis=0)
            if self.training.mirror:
                high = np.maximum(high, -low)
                low = -high
            network = Network(
                job.type,
                trainer.scaling,
                (float(low[0]), float(low[1]), float(low[2])),
                (float(high[0]), float(high[1]), float(high[2])),
                trainer.best,
            )
            intervals = self._intervals(network, labels)
            score = self._out_of_distribution(job)
            networks.append(replace(network, intervals=intervals, out_of_distribution=score))
            held_out[job.type.name] = list(runs(labels, self.data.segment, Part.TEST))
        about = {**asdict(self.training), **asdict(self.protocol), 'fold': fold}
        recordings = tuple(
            replace(r, held_out={t: self._spans(runs_, i) for t, runs_ in held_out.items()})
            for i, r in enumerate(self.recordings)
        )
        return Checkpoint(
            self.config, tuple(networks), recordings, about, version('power_estimator')
        )

    def test(self, checkpoint: Checkpoint, judge: Judge) -> tuple[JudgedModel, ...]:
        """Judge a fold's networks, which come first, all proxies and the plain model.

        They are judged on the fold's test part; judge: of the recordings that were trained on.
        """
        models: list[PowerModel] = [PowerPredictionNetwork(checkpoint)]
        models += [load_model(name) for name in (*PROXIES, PLAIN)]
        return judge.compare(models, types=self.types, supply=True)

    def _intervals(self, network: Network, labels: NDArray[np.int8]) -> Intervals | None:
        ppn = PowerPredictionNetwork(Checkpoint(self.config, (network,)))
        names = [self.data.names[c] for c in self._columns[network.type.name]]
        data = rows_of(self.data.drives(names), labels, Part.VALIDATION)
        stretches = list(data.segments())
        measured, estimated = (
            block_means(power, stretches, self.config.block)
            for power in (data.power, ppn.predict(data))
        )
        return Intervals.fit(measured, estimated)

    def _out_of_distribution(self, job: Job) -> OutOfDistributionScore | None:
        block = self.config.block
        found = [
            x[:, : x.shape[1] // block * block].reshape(-1, block, x.shape[2])
            for x, _ in self._stretches(job, Part.TRAIN, block)
        ]
        if not found:
            return None
        return OutOfDistributionScore.fit(np.concatenate(found), self.training.mirror)

    def _where(self, rows: Bools) -> str:
        """Names of the recordings of some rows [T]."""
        return ', '.join(self.data.recordings[i] for i in np.unique(self.data.recording[rows]))

    def _usable(self, kind: DriveType) -> NDArray[np.int32]:
        used = np.asarray(self._measured[:, self._columns[kind.name]].any(axis=1), np.bool_)
        if np.count_nonzero(used) < self.protocol.minimum():
            need = self.protocol.minimum() / self.data.rate
            raise InputError(
                f'{self._where(used)}: {kind.name} was measured for '
                f'{np.count_nonzero(used) / self.data.rate:.1f} s; training needs {need:.0f} s'
            )
        return np.where(used, self.data.segment, -1)

    def _stretches(self, job: Job, part: Part, shortest: int) -> list[tuple[Singles, Singles]]:
        labels = self.labels(job)
        found = []
        for column in self._columns[job.type.name]:
            usable = self._measured[:, column] & np.isfinite(self._targets[:, column])
            there = np.where(usable, labels, Part.UNUSED)
            found += [
                (self._views[:, run, column], self._targets[run, column])
                for run in runs(there, self.data.segment, part, shortest)
            ]
        return found

    def _spans(
        self, stretches: Sequence[slice], recording: int
    ) -> tuple[tuple[float, float], ...]:
        return tuple(
            (float(self.data.time[s.start]), float(self.data.time[s.stop - 1]))
            for s in stretches
            if self.data.recording[s.start] == recording
        )
