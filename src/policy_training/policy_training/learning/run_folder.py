"""Files of a training run: config, curves, checkpoints, TensorBoard events, policy."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import torch
from policy_runner.policies.by_name import EXPORTED, POLICIES
from torch.utils.tensorboard import SummaryWriter
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.tensors import read_state

from policy_training.config import TrainingConfig

CONFIG: Final = 'config.yaml'
CURVES: Final = 'curves.jsonl'
CHECKPOINT: Final = 'checkpoint.pt'
EVENTS: Final = 'tensorboard'


class RunFolder:
    """Files of one run.

    Checkpoints hold tensors and numbers only and are read without unpickling objects; each
    replaces the one before at once, so that a run that is killed goes on from its last one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._events: SummaryWriter | None = None

    @property
    def policy(self) -> Path:
        """Folder of the exported policy."""
        return self.path / EXPORTED

    def start(self, config: TrainingConfig) -> None:
        """Begin a run; InputError for a folder that holds one."""
        if (self.path / CONFIG).exists():
            raise InputError(
                f'{self.path} holds a run; give another folder, or --resume to go on with it'
            )
        self.path.mkdir(parents=True, exist_ok=True)
        config.save(self.path / CONFIG)

    def resume(self) -> tuple[TrainingConfig, dict[str, Any]]:
        """Return config and last checkpoint, and drop later curves; InputError without a run."""
        if not (self.path / CONFIG).exists():
            raise InputError(f'{self.path} holds no run to resume')
        config = TrainingConfig.load(self.path / CONFIG)
        state = read_checkpoint(self.path)
        rows = [row for row in read_curves(self.path) if row['iteration'] <= state['iteration']]
        write_whole(self.path / CURVES, ''.join(json.dumps(row) + '\n' for row in rows))
        return config, state

    def add(self, iteration: int, steps: int, values: Mapping[str, float]) -> None:
        """Append a row to the curves, in the folder and in TensorBoard.

        steps: policy steps of all robots so far; values: by name.
        """
        with (self.path / CURVES).open('a', encoding='utf-8') as stream:
            rounded = {name: float(f'{value:.6g}') for name, value in values.items()}
            stream.write(json.dumps({'iteration': iteration, 'steps': steps, **rounded}) + '\n')
        if self._events is None:
            self._events = SummaryWriter(str(self.path / EVENTS))
        for name, value in values.items():
            self._events.add_scalar(name, value, steps)

    def save(self, state: dict[str, Any]) -> None:
        """Replace the checkpoint by a learner's state."""
        part = self.path / f'{CHECKPOINT}.part'
        torch.save(state, part)
        os.replace(part, self.path / CHECKPOINT)

    def close(self) -> None:
        """Close TensorBoard's writer, which writes its last events; nothing if none was begun."""
        if self._events is not None:
            self._events.close()


def read_curves(run: Path) -> list[dict[str, float]]:
    """Return the rows of a run's curves without a line cut off by a kill; [] for no file."""
    path = run / CURVES
    rows: list[dict[str, float]] = []
    if path.exists():
        for line in path.read_text(encoding='utf-8').splitlines():
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError:
                break
    return rows


def policy_source(source: str) -> str:
    """Return the policy folder of a training run; names and other sources unchanged."""
    inner = Path(source) / EXPORTED
    return str(inner) if source not in POLICIES and inner.is_dir() else source


@contextmanager
def fitting_checkpoint() -> Iterator[None]:
    """Context that turns errors of loading another network's checkpoint into an InputError."""
    try:
        yield
    except (KeyError, RuntimeError, ValueError, TypeError, AttributeError) as error:
        raise InputError(
            f'the checkpoint does not fit this config ({type(error).__name__}: {error})'
        ) from error


def read_checkpoint(run: Path) -> dict[str, Any]:
    """Return the last checkpoint of a run; InputError if there is none or it is damaged."""
    path = run / CHECKPOINT
    state = read_state(path, 'checkpoint')
    parts = ('actor_state_dict', 'critic_state_dict', 'optimizer_state_dict')
    if not isinstance(state, dict) or not (
        all(isinstance(state.get(part), dict) for part in parts)
        and all(type(state.get(count)) is int for count in ('iteration', 'steps'))
    ):
        raise InputError(f'checkpoint {path} is none of this program')
    return state
