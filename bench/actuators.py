"""Savings of the paper's pair on other actuators: `python bench/actuators.py [--policies A B]`.

Rows but the last two change one thing of the plant `anymal_c`; the last is `anymal_c_published`.
Nothing is trained again. Walks of `evaluate`, on what the sensors read; means over those of its
four tasks that both policies walk. A torque loop also moves the position loop's damping from the
rotor's to the joint's speed.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from policy_training.evaluation.evaluate import score_walk
from policy_training.evaluation.measured_walk import idle_power, measure_walk
from policy_training.evaluation.tasks import TASKS
from sim_bridge.plant.parameters import Plant
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine

PAIR: Final = ('paper_baseline', 'paper_pmp')


def changed(**drives: float) -> Plant:
    """Return the plant `anymal_c` with parameters of all its drives set, as `viscous=4.9`."""
    plant = Plant.load('anymal_c')
    types = {kind: replace(drive, **drives) for kind, drive in plant.drive_types.items()}
    return replace(plant, drive_types=types)


def looped(bandwidth: float, **drives: float) -> Plant:
    """Return the plant `anymal_c` with a torque loop, Hz, and parameters as `changed` has them."""
    return changed(loop_bandwidth=bandwidth, **drives).with_effects(torque_loop=True)


def plants() -> Mapping[str, Plant]:
    """Return the plants of the rows, by what each changes."""
    return {
        'nothing': Plant.load('anymal_c'),
        'viscous friction 4.9 N·m·s/rad': changed(viscous=4.9),
        'spring 181 N·m/rad': changed(spring_stiffness=181.0),
        'delay 7.5 ms': replace(Plant.load('anymal_c'), command_delay=0.0075),
        'torque ripple': Plant.load('anymal_c').with_effects(torque_ripple=True),
        **{f'torque loop, {hertz:g} Hz': looped(hertz) for hertz in (15.0, 20.0, 30.0, 50.0)},
        'torque loop, 30 Hz, spring 181 N·m/rad': looped(30.0, spring_stiffness=181.0),
        'all of these, 30 Hz (`anymal_c_published`)': Plant.load('anymal_c_published'),
    }


def measure(plant: Plant, policies: tuple[str, ...], seconds: float, seed: int) -> dict[str, Any]:
    """Return the entry of each walk on a plant, by policy and task."""
    idle = idle_power(plant)
    return {
        f'{policy} {task.name}': score_walk(
            measure_walk(policy, task, plant, duration=seconds, seed=seed), idle, {}
        )
        for policy in policies
        for task in TASKS
    }


def row(name: str, found: Mapping[str, Any], policies: tuple[str, ...]) -> str:
    """Return a line of the table: changes in per cent, shares, and who did not walk."""
    first, second = ([found[f'{policy} {task.name}'] for task in TASKS] for policy in policies)
    walked = [
        (a, b)
        for a, b in zip(first, second, strict=True)
        if a['power_w'] and b['power_w'] and not a['falls'] + b['falls'] and _follows(a, b)
    ]
    if not walked:
        return f'| {name} | – | – | – | – | – | 0 |'
    total = [_change(a, b, 'supply') for a, b in walked]
    knees = [_change(a, b, 'KFE') for a, b in walked]
    watts = np.mean([a['power_w']['supply'] for a, _ in walked])
    share = np.mean([a['power_w']['KFE'] / a['power_w']['supply'] for a, _ in walked])
    fast = [np.mean([_fast(entry) for entry in entries]) for entries in zip(*walked, strict=True)]
    return (
        f'| {name} | {watts:.0f} W | {share:.0%} | {fast[0]:.1%}, {fast[1]:.1%} | '
        f'{np.mean(total):+.0f} % ({min(total):+.0f} … {max(total):+.0f}) | '
        f'{np.mean(knees):+.0f} % ({min(knees):+.0f} … {max(knees):+.0f}) | {len(walked)} |'
    )


def _fast(entry: Mapping[str, Any]) -> float:
    return float(entry['smoothness']['kfe_torque_above_20_hz'])


def _follows(*entries: Mapping[str, Any]) -> bool:
    return all(abs(error) < 0.15 for entry in entries for error in entry['tracking'].values())


def _change(first: Mapping[str, Any], second: Mapping[str, Any], part: str) -> float:
    return 100.0 * (second['power_w'][part] / first['power_w'][part] - 1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--policies', nargs=2, default=PAIR, help='the baseline, and the other')
    parser.add_argument('--seconds', type=float, default=12.0)
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    policies = tuple(options.policies)
    print(
        '| changed | baseline | of it KFE | KFE torque above 20 Hz | PMP: supply | KFE | tasks |'
    )
    print('|---|---|---|---|---|---|---|')
    named = plants()
    work = partial(measure, policies=policies, seconds=options.seconds, seed=options.seed)
    with TaskEngine(Workplace()) as engine:
        for name, found in zip(named, engine.in_order(work, list(named.values())), strict=True):
            print(row(name, found, policies), flush=True)


if __name__ == '__main__':
    main()
