"""`ros2 run policy_training train`: train a policy by a config, into a run folder."""

import argparse
from typing import Any

import torch
import yaml
from wattwalk_core.errors import InputError

from policy_training.config import TrainingConfig
from policy_training.learning.run_folder import RunFolder, fitting_checkpoint, read_checkpoint
from policy_training.learning.training import make_learner, train


def run(options: argparse.Namespace) -> None:
    changes = _changes(options)
    _check_device(options.device)
    config = TrainingConfig.load(options.config).with_values({} if options.resume else changes)
    folder = RunFolder(options.output)
    state: dict[str, Any] | None = None
    if options.resume:
        config, state = folder.resume()
        config = config.with_values(changes)
    learner = make_learner(config, options.device)
    with fitting_checkpoint():
        if state is not None:
            learner.restore(state)
        elif options.source is not None:
            learner.take_networks(read_checkpoint(options.source))
    if not options.resume:
        folder.start(config)
    train(learner, folder, seconds=options.seconds)


def _check_device(device: str) -> None:
    kind = device.partition(':')[0]
    if kind not in ('cpu', 'cuda'):
        raise InputError(f'--device is {device!r}; give cpu or cuda')
    if kind == 'cuda' and not torch.cuda.is_available():
        raise InputError('--device cuda: torch sees no CUDA device here; leave it out')


def _changes(options: argparse.Namespace) -> dict[str, Any]:
    given: dict[str, Any] = {
        'seed': options.seed,
        'steps': options.steps,
        'power.model': options.power,
        'power.weight': options.weight,
        'physics.environments': options.environments,
        'physics.threads': options.threads,
    }
    changes = {key: value for key, value in given.items() if value is not None}
    for text in options.set:
        key, equals, value = text.partition('=')
        if not equals:
            raise InputError(f'--set {text!r} is not KEY=VALUE, such as random.push=1.2')
        changes[key] = _value(text, value)
    return changes


def _value(text: str, value: str) -> Any:
    """Return a value as YAML has it; 4e-4, text in YAML, as a number, and nothing as no text."""
    if not value:
        return ''
    try:
        return float(value) if 'e' in value.lower() else yaml.safe_load(value)
    except ValueError:
        return yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise InputError(f'--set {text!r}: the value cannot be read') from error
