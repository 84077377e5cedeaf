"""Blend of two learned policies into one folder."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from policy_runner.policies.folder import FALLBACK, Fallback, read_folder, write_folder
from policy_runner.policies.observations import Observation
from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError
from wattwalk_core.tensors import Tensors

_FIRST: Final = 'layer0.weight'
_SAME: Final = ('rate', 'joints', 'default_pose', 'gains', 'action', 'network')


def blend_policies(first: Path, second: Path, fallback: Fallback, folder: Path, name: str) -> None:
    """Write a policy that acts as the first, and as the second where `fallback` says so.

    What both observe has to be the same, but one may observe more than the other, such as a gait
    clock; the observation is that one's, or the first's. InputError names what differs.
    """
    contract, tensors = read_folder(first)
    other, more = read_folder(second)
    for path, own in ((first, contract), (second, other)):
        if own.network.fallback is not None:
            raise InputError(f'{path} has a fallback already; blend policies of one network')
    for key in _SAME:
        if getattr(contract, key) != getattr(other, key):
            raise InputError(f'{first} and {second} differ in {key}; a blend needs both alike')
    seen = contract.observation
    if set(seen.names) < set(other.observation.names):
        seen = other.observation
    try:
        tensors = _with_inputs(tensors, contract.observation, seen)
        more = _with_inputs(more, other.observation, seen)
    except InputError as error:
        raise InputError(f'{first} and {second} {error}; a blend needs both alike') from None
    blend = replace(
        contract,
        name=name,
        observation=seen,
        network=replace(contract.network, fallback=fallback),
        training={
            'policy': {'name': contract.name, **contract.training},
            'fallback': {'name': other.name, **other.training},
        },
    )
    write_folder(folder, blend, {**tensors, **{FALLBACK + key: v for key, v in more.items()}})


def _with_inputs(tensors: Tensors, own: Observation, wanted: Observation) -> dict[str, Singles]:
    """Return a network of other inputs; those that it does not know have no weight."""
    weights = np.zeros((len(tensors[_FIRST]), wanted.size), np.float32)
    scales = {term.name: term.scale for term in wanted.terms}
    for term in own.terms:
        if term.name not in scales or not np.array_equal(term.scale, scales[term.name]):
            raise InputError(f'differ in observation {term.name!r}')
        weights[:, wanted.part(term.name)] = tensors[_FIRST][:, own.part(term.name)]
    if own.clip != wanted.clip:
        raise InputError('differ in observation.clip')
    return {**tensors, _FIRST: weights}
