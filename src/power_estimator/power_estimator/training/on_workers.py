"""Training of a cross-validation's networks on the workers of a task engine."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import torch
from numpy.typing import NDArray
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

from power_estimator.drive_types import DriveType
from power_estimator.network.checkpoint import NetworkConfig
from power_estimator.recordings import TrainingSet, training_set
from power_estimator.training.cross_validation import CrossValidation, Job
from power_estimator.training.protocol import Protocol
from power_estimator.training.run_folder import NetworkRunFolder
from power_estimator.training.trainer import Trainer
from power_estimator.training.trainer_config import TrainerConfig

CODE = ('power_estimator', 'power_recordings')
_given = lru_cache(maxsize=1)(training_set)  # that of a worker's next task, too


@dataclass(frozen=True)
class NetworkTask:
    """All that a worker needs to train one network; all machines must share its paths."""

    paths: tuple[Path, ...]
    drives: tuple[str, ...]
    hashes: tuple[str, ...]
    types: tuple[DriveType, ...]
    network: NetworkConfig
    training: TrainerConfig
    protocol: Protocol
    job: Job
    folder: Path

    @classmethod
    def of(
        cls, given: TrainingSet, validation: CrossValidation, job: Job, folder: NetworkRunFolder
    ) -> Self:
        """Return the task of one job of a cross-validation."""
        return cls(
            tuple(path.resolve() for path in given.paths),
            tuple(given.drives),
            tuple(recording.sha256 for recording in given.recordings),
            validation.types,
            validation.config,
            validation.training,
            validation.protocol,
            job,
            folder.path.resolve(),
        )

    def __str__(self) -> str:
        return f'the network {self.job.name}'


def train_network(task: NetworkTask) -> dict[str, NDArray[Any]]:
    """Train a network from the state in its run's folder, and return its last state.

    Each epoch is kept there, so that a task whose worker was lost goes on. InputError for a
    recording that differs from that of the command.
    """
    torch.set_num_threads(1)
    given = _given(task.paths, task.drives)
    for path, own, told in zip(task.paths, given.recordings, task.hashes, strict=True):
        if own.sha256 != told:
            raise InputError(f'{path} is another recording here than where the command runs')
    validation = CrossValidation.of(
        given, task.types, network=task.network, training=task.training, protocol=task.protocol
    )
    return validation.train(task.job, NetworkRunFolder(task.folder)).state()


def engine_of(place: Workplace) -> AbstractContextManager[TaskEngine | None]:
    """Return a context with the engine of a scheduler, or with None where none was given.

    On one machine networks are trained on threads: they share the recordings' signals, which each
    process would hold for itself, and report each epoch.
    """
    return TaskEngine(place) if place.scheduler else nullcontext()


def train_on_workers(
    engine: TaskEngine,
    given: TrainingSet,
    validation: CrossValidation,
    folder: NetworkRunFolder,
    progress: Callable[[str, Trainer], None],
) -> dict[Job, Trainer]:
    """Train all jobs of a cross-validation by the engine; return trainers by job.

    progress: called with the name and trainer of each job that ends.
    """
    tasks = [NetworkTask.of(given, validation, job, folder) for job in validation.jobs]
    trainers: dict[Job, Trainer] = {}
    for place, state in engine.completed(train_network, tasks, CODE):
        job = validation.jobs[place]
        trainers[job] = validation.restored(job, state)
        progress(job.name, trainers[job])
    return {job: trainers[job] for job in validation.jobs}
