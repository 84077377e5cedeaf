"""Verdict of an evaluation: sentences that compare each policy with the first."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from policy_training.evaluation.robustness import LIMITS

_AXES = ('vx', 'vy', 'yaw')


def verdict(entries: Sequence[Mapping[str, Any]], trials: Mapping[str, Any]) -> list[str]:
    """Return a sentence per policy and task, and one per policy on its robustness."""
    names = list(dict.fromkeys(entry['name'] for entry in entries))
    sentences = []
    for name in names[1:]:
        for entry in (e for e in entries if e['name'] == name):
            same = (e for e in entries if e['name'] == names[0] and e['task'] == entry['task'])
            first = next(same, None)
            if first is not None:
                sentences.append(_compare(entry, first))
    for name, found in trials.items():
        how = ', '.join(f'{key} {found["mean_error"][key]:.2f}' for key in _AXES)
        says = 'follows its commands' if found['following'] else 'does not follow its commands'
        sentences.append(
            f'{name} {says}: {found["falls"]} falls in {found["robots"]} × '
            f'{found["seconds"]:.0f} s on rough ground with pushes; off by {how} on average.'
        )
    return sentences


def _compare(entry: Mapping[str, Any], first: Mapping[str, Any]) -> str:
    who = f'{entry["name"]} on {entry["task"]}'
    if not entry['power_w'] or not first['power_w']:
        return f'{who}: nothing to compare, no steady walking.'
    astray = [
        axis
        for axis, limit in zip(_AXES, LIMITS, strict=True)
        if abs(entry['tracking'][axis]) > limit
    ]
    here, there = entry['power_w'], first['power_w']
    parts = [
        f'{kind} {_change(here[kind], there[kind])}'
        for kind in ('KFE', 'HFE', 'HAA')
        if there[kind] > 1.0
    ]
    text = (
        f'{who} draws {_change(here["supply"], there["supply"])} at the supply '
        f'({here["supply"]:.0f} W against {there["supply"]:.0f} W of {first["name"]}; '
        f'{", ".join(parts)}).'
    )
    if astray:
        text += f' It misses the command in {" and ".join(astray)}: no saving at equal tracking.'
    return text


def _change(value: float, reference: float) -> str:
    return f'{100.0 * (value - reference) / np.abs(reference):+.0f} %'
