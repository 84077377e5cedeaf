"""Distillation of a large network into a small one, cheap enough for rewards in training."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from wattwalk_core.errors import InputError

from power_estimator.drive_types import assign
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.recordings import TrainingSet, describe
from power_estimator.scores import r2
from power_estimator.training.cross_validation import CrossValidation
from power_estimator.training.protocol import Protocol
from power_estimator.training.trainer_config import TrainerConfig

TEACHER, STUDENT = 'teacher', 'student'


@dataclass(frozen=True)
class DistillationResult:
    """Scores of teacher and student on samples that neither was trained on."""

    smoothed: tuple[JudgedModel, ...]  # teacher and student against measured power
    live: tuple[JudgedModel, ...]  # the same with the features that a live node forms
    imitation: Mapping[str, float]  # R² of the student against the teacher, by drive type


def validation_of(
    teacher: PowerPredictionNetwork, given: TrainingSet, *, hidden: int, training: TrainerConfig
) -> CrossValidation:
    """Return the training of a student on the teacher's outputs for the recordings' signals.

    The recordings are split as for the teacher, so that its test part is new to the student too.
    hidden: units of the student. InputError for recordings that are too short or drives unknown
    to the teacher.
    """
    config, about = teacher.checkpoint.config, teacher.checkpoint.training
    if hidden >= config.hidden:
        raise InputError(f'hidden = {hidden} is not below the {config.hidden} of the teacher')
    if about.get('fold', 0) != 0:
        raise InputError('the teacher is not of fold 0; give the run folder it belongs to')
    return CrossValidation.of(
        given,
        teacher.types,
        network=replace(config, hidden=hidden),
        training=training,
        protocol=Protocol(about.get('segments', 6), 1, config.history),
        targets=teacher.predict(given.data),
    )


def compared(
    teacher: PowerPredictionNetwork,
    student: PowerPredictionNetwork,
    given: TrainingSet,
    recordings: Loaded,
) -> DistillationResult:
    """Judge both against measured power where neither was trained, by smoothed and live features.

    given: what the student was trained on; recordings: the same, to be judged on.
    """
    live = given.as_live().drives(recordings.data.names)
    smoothed, as_live = (
        Judge(own).compare([teacher, student], types=student.types)
        for own in (recordings, replace(recordings, smoothed=live))
    )
    columns = assign(recordings.data.names, student.types)
    imitation = {
        kind: r2(*(judged.estimated[:, columns[kind]] for judged in smoothed))
        for kind in smoothed[0].types
    }
    return DistillationResult(smoothed, as_live, imitation)


def in_order_of(teacher: PowerPredictionNetwork, bags: Sequence[Path]) -> list[Path]:
    """Sort recordings in the order of the teacher's training; new ones come last."""
    order = {r.sha256: i for i, r in enumerate(teacher.checkpoint.recordings)}
    return sorted(bags, key=lambda bag: order.get(describe(bag).sha256, len(order)))
