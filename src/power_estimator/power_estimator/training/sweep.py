"""Sweep over hidden units and history: R² and computing cost."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from statistics import fmean, pstdev
from typing import Any

from numpy.typing import NDArray
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError
from wattwalk_core.files import read_bytes, write_whole
from wattwalk_core.yaml_file import SIZE

from power_estimator.drive_types import DriveType
from power_estimator.evaluation.cost import sample_cost
from power_estimator.judge.estimator import JudgeSettings
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel
from power_estimator.network.checkpoint import Checkpoint, NetworkConfig
from power_estimator.network.ppn import PowerPredictionNetwork, WindowedNetwork
from power_estimator.recordings import TrainingSet
from power_estimator.training.cross_validation import CrossValidation, Job
from power_estimator.training.on_workers import CODE, NetworkTask, train_network
from power_estimator.training.protocol import Protocol
from power_estimator.training.run_folder import NetworkRunFolder
from power_estimator.training.trainer import Trainer
from power_estimator.training.trainer_config import TrainerConfig

RESULT = 'point.json'
CHOSEN = NetworkConfig()
_SAMPLES_IN_A_BATCH = 800  # as many as the default training updates on
_SHORTEST_CHUNK = 20


@dataclass(frozen=True)
class SweepPoint:
    """Point of a sweep: hidden units and history of a network; history None: carried state."""

    hidden: int
    history: int | None = None  # samples

    @property
    def name(self) -> str:
        """Name of the point's folder."""
        return f'{self.hidden}_{"carried" if self.history is None else self.history}'

    def network(self) -> NetworkConfig:
        """Return the shape of the network; InputError for units or a history out of range."""
        if self.history is None:
            return replace(CHOSEN, hidden=self.hidden)
        warm_up = min(CHOSEN.warm_up, self.history // 2)
        return replace(CHOSEN, hidden=self.hidden, history=self.history, warm_up=warm_up)

    def training(self, base: TrainerConfig) -> TrainerConfig:
        """Return the settings of the training, for carried state or windows of the history.

        Batches have about as many samples at every history.
        """
        if self.history is None:
            return base
        chunk = max(_SHORTEST_CHUNK, self.history)
        batch = max(1, round(_SAMPLES_IN_A_BATCH / chunk))
        return replace(base, chunk=chunk, batch=batch, reset_probability=1.0)


def points(hidden: Sequence[int], history: Sequence[float]) -> tuple[SweepPoint, ...]:
    """Return the points of a sweep: units with carried state, and histories (s) at 100 units.

    100 units with carried state and with 0.3 s are always among them.
    """
    units = sorted({*hidden, CHOSEN.hidden})
    samples = sorted({*(round(h * CHOSEN.rate) for h in history), CHOSEN.history})
    found = [SweepPoint(n) for n in units] + [SweepPoint(CHOSEN.hidden, n) for n in samples]
    for point in found:
        point.network()
    return tuple(found)


@dataclass(frozen=True)
class Result:
    """R² of a point on held-out data, and its computing cost."""

    point: SweepPoint
    r2: Mapping[str, tuple[float, float]]  # mean and spread over folds, by drive type
    us_per_sample: float  # of twelve drives
    epochs: float = 0.0  # in the mean

    def content(self) -> dict[str, Any]:
        """Return the result as content of JSON, with the history in s."""
        history = self.point.history
        return {
            'hidden': self.point.hidden,
            'history': None if history is None else history / CHOSEN.rate,
            'form': 'carried' if history is None else 'windowed',
            'types': {k: {'r2': mean, 'r2_std': std} for k, (mean, std) in self.r2.items()},
            'us_per_sample': self.us_per_sample,
            'epochs': self.epochs,
        }

    @classmethod
    def load(cls, file: Path, point: SweepPoint) -> 'Result':
        """Read a point's result; InputError says whether the file is damaged or cannot be read."""
        data = read_bytes(file, 'point', SIZE)
        try:
            found = json.loads(data)
            scores = {k: (float(v['r2']), float(v['r2_std'])) for k, v in found['types'].items()}
            return cls(point, scores, float(found['us_per_sample']), float(found['epochs']))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            raise InputError(f'{file} is damaged; remove it to redo the point') from None


class Sweep:
    """Training and test of several sizes and histories, all on the same held-out samples.

    A finished point leaves `points/NAME/point.json` and is not repeated.
    """

    def __init__(
        self,
        given: TrainingSet,
        types: Sequence[DriveType],
        wanted: Sequence[SweepPoint],
        training: TrainerConfig,
        *,
        recordings: Loaded,
        folds: int = 1,
        segments: int = 6,
    ) -> None:
        """recordings: those of the training set, as they are judged on."""
        self._given = given
        self._types = tuple(types)
        self._wanted = tuple(wanted)
        self._training = training
        longest = max(point.network().history for point in wanted)
        self._protocol = Protocol(segments, folds, longest)
        settling = max(JudgeSettings.settling, longest / CHOSEN.rate)
        self._judge = Judge(recordings, settings=JudgeSettings(settling=settling))

    def run(
        self,
        path: Path,
        progress: Callable[[str, Trainer], None],
        workers: int = 1,
        engine: TaskEngine | None = None,
    ) -> Iterator[Result]:
        """Yield the results of all points in order; Ctrl-C keeps the networks in training.

        With an engine, networks of all points are trained at the same time, and progress is called
        for ended ones; else `workers` networks of one point are.
        """
        folders = {p: NetworkRunFolder(path / 'points' / p.name) for p in self._wanted}
        pending = [p for p in self._wanted if not (folders[p].path / RESULT).exists()]
        for point in pending:
            folders[point].open({}, (), resume=folders[point].path.exists())
        states: Iterator[Mapping[str, NDArray[Any]]] | None = None
        if engine is not None and pending:
            tasks = [task for point in pending for task in self._tasks(point, folders[point])]
            states = engine.in_order(train_network, tasks, CODE)
        for point, folder in folders.items():
            file = folder.path / RESULT
            if point not in pending:
                yield Result.load(file, point)
                continue
            validation = self.validation(point)

            def show(job: str, trainer: Trainer, point: SweepPoint = point) -> None:
                progress(f'{point.name} {job}', trainer)

            if states is None:
                trainers = validation.run(folder, show, workers)
            else:
                trainers = {}
                for job in validation.jobs:
                    trainers[job] = validation.restored(job, next(states))
                    show(job.name, trainers[job])
            result = self._test(point, validation, trainers)
            folder.finish()
            write_whole(file, json.dumps(result.content(), indent=1) + '\n')
            yield result

    def _tasks(self, point: SweepPoint, folder: NetworkRunFolder) -> list[NetworkTask]:
        return [
            replace(
                NetworkTask.of(self._given, self._first, job, folder),
                network=point.network(),
                training=point.training(self._training),
            )
            for job in self._first.jobs
        ]

    @cached_property
    def _first(self) -> CrossValidation:
        """Cross-validation of the first point, whose drive types and folds are those of all."""
        return self.validation(self._wanted[0])

    @property
    def jobs(self) -> Sequence[Job]:
        """Networks to train at each point: one Job per drive type and fold, the same for all."""
        return self._first.jobs

    def validation(self, point: SweepPoint) -> CrossValidation:
        """Return the cross-validation of a point."""
        network, training = point.network(), point.training(self._training)
        return CrossValidation.of(
            self._given, self._types, network=network, training=training, protocol=self._protocol
        )

    def _test(
        self, point: SweepPoint, validation: CrossValidation, trainers: Mapping[Job, Trainer]
    ) -> Result:
        scores: dict[str, list[float]] = {}
        for fold in range(self._protocol.folds):
            checkpoint = validation.checkpoint(fold, trainers)
            for kind, score in self.judged(point, checkpoint).types.items():
                scores.setdefault(kind, []).append(score.r2)
        return Result(
            point,
            {kind: (fmean(found), pstdev(found)) for kind, found in scores.items()},
            sample_cost(point.hidden, point.history),
            fmean(len(trainer.history) for trainer in trainers.values()),
        )

    def judged(self, point: SweepPoint, checkpoint: Checkpoint) -> JudgedModel:
        """Return the scores of a point's networks on the test part of their fold."""
        form = PowerPredictionNetwork if point.history is None else WindowedNetwork
        (found,) = self._judge.compare([form(checkpoint)], types=self._types)
        return found
