"""Folder of a training run."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.files import write_whole
from wattwalk_core.tensors import SIZE, read_tensors
from wattwalk_core.yaml_file import dump_yaml, read_yaml

from power_estimator.network.checkpoint import FILE, Checkpoint, TrainingRecording
from power_estimator.training.trainer import Trainer

CONFIG = 'config.yaml'
RECORDINGS = 'recordings.yaml'
TABLE = 'table.json'
CURVES = 'curves.json'


class NetworkRunFolder:
    """Files of a training run.

    config.yaml, recordings.yaml (cards and hashes), curves.json, table.json, model.safetensors
    (fold 0) and folds/N.safetensors. During a run state/ holds the state that --resume continues
    from.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._state = path / 'state'
        self._folds = path / 'folds'

    def open(
        self, config: Mapping[str, Any], recordings: Sequence[TrainingRecording], *, resume: bool
    ) -> None:
        """Start a run, or continue the one in this folder if resume is true.

        InputError, to start: if the folder exists or cannot be made; to resume: if it holds no
        run, or one with other settings or recordings.
        """
        cards = [asdict(recording) for recording in recordings]
        if resume:
            self._require_same(config, cards)
        elif self.path.exists():
            raise InputError(f'{self.path} exists already: give --resume or another folder')
        try:
            for folder in (self._state, self._folds):
                folder.mkdir(parents=True, exist_ok=resume)
        except OSError as error:
            raise InputError(f'{self.path} cannot be made: {error.strerror}') from None
        if not resume:
            self._yaml(RECORDINGS, cards)
            self._yaml(CONFIG, config)

    def _require_same(self, config: Mapping[str, Any], cards: list[dict[str, Any]]) -> None:
        for file, now in ((CONFIG, config), (RECORDINGS, cards)):
            try:
                before = read_yaml(self.path / file, 'run')
            except InputError as error:
                raise InputError(f'{self.path} is no run to resume: {error}') from None
            if isinstance(before, dict) and isinstance(now, Mapping):
                for key, value in now.items():
                    if before.get(key) != value:
                        raise InputError(
                            f'{self.path} was started with {key} = {quoted(before.get(key))}, '
                            f'not {quoted(value)}; resume it as it was or start another'
                        )
            elif before != json.loads(json.dumps(now)):
                raise InputError(f'{self.path} was started on other recordings: see {file}')

    def save_state(self, job: str, tensors: Mapping[str, NDArray[np.generic]]) -> None:
        """Write the state of a job, arrays by name; RecordingError if it cannot be written."""
        content = save({key: np.ascontiguousarray(value) for key, value in tensors.items()})
        write_whole(self._state / f'{job}.safetensors', content)

    def load_state(self, job: str) -> dict[str, NDArray[Any]] | None:
        """Return arrays of a job's state, None before its start; InputError for a damaged file."""
        file = self._state / f'{job}.safetensors'
        if not file.exists():
            return None
        try:
            return read_tensors(file, 'state', 2 * SIZE).tensors
        except InputError as error:
            raise InputError(f'{error}; remove it to redo its fold') from None

    def save_model(self, fold: int, checkpoint: Checkpoint) -> None:
        """Write the networks of a fold; those of fold 0 are the run's model, too."""
        checkpoint.save(self._folds / f'{fold}.safetensors')
        if fold == 0:
            checkpoint.save(self.path / FILE)

    def save_json(self, file: str, content: Mapping[str, Any]) -> None:
        """Write content to a file of the run as JSON; ValueError for NaN."""
        write_whole(self.path / file, json.dumps(content, indent=1, allow_nan=False) + '\n')

    def finish(self, trainers: Mapping[Any, Trainer] | None = None) -> None:
        """Write the curves of trainers by job, and remove the files that only --resume needs."""
        if trainers is not None:
            curves = {j.name: [asdict(e) for e in t.history] for j, t in trainers.items()}
            self.save_json(CURVES, curves)
        for file in self._state.glob('*.safetensors'):
            file.unlink()
        self._state.rmdir()
        if not any(self._folds.iterdir()):
            self._folds.rmdir()

    def _yaml(self, file: str, content: Any) -> None:
        write_whole(self.path / file, dump_yaml(json.loads(json.dumps(content))))
