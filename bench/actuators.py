"""Savings of the paper's pair on other actuators: `python bench/actuators.py [--policies A B]`.

Rows but the last three change one thing of the plant `anymal_c`. The last is its published twin,
the one before the same without a torque loop. Nothing is trained again. Walks of `evaluate`, on
what the sensors read; means over those of its four tasks that both policies walk at one speed.
A torque loop also moves the position loop's damping from the rotor's to the joint's speed, as a
drive without a spring does.
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


def open_loop() -> Plant:
    """Return the plant `anymal_c_published` without its loop: what is published is the rotor's."""
    plant = changed(viscous=4.6, spring_stiffness=181.0).with_effects(torque_ripple=True)
    return replace(plant, command_delay=0.0075)


def plants() -> Mapping[str, Plant]:
    """Return the plants of the rows, by what each changes."""
    return {
        'nothing': Plant.load('anymal_c'),
        'no spring': Plant.load('anymal_c').with_effects(spring=False),
        'viscous friction 4.9 N·m·s/rad': changed(viscous=4.9),
        'spring 181 N·m/rad': changed(spring_stiffness=181.0),
        'delay 7.5 ms': replace(Plant.load('anymal_c'), command_delay=0.0075),
        'torque ripple': Plant.load('anymal_c').with_effects(torque_ripple=True),
        **{f'torque loop, {hertz:g} Hz': looped(hertz) for hertz in (15.0, 20.0, 30.0, 50.0)},
        'torque loop, 30 Hz, spring 181 N·m/rad': looped(30.0, spring_stiffness=181.0),
        'published figures, no torque loop': open_loop(),
        'published figures, 30 Hz (`anymal_c_published`)': Plant.load('anymal_c_published'),
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
    walked = [pair for pair in zip(first, second, strict=True) if walks(*pair)]
    if not walked:
        return f'| {name} | – | – | – | – | – | none |'
    tasks = [task.name for task, *pair in zip(TASKS, first, second, strict=True) if walks(*pair)]
    total = [_change(a, b, 'supply') for a, b in walked]
    knees = [_change(a, b, 'KFE') for a, b in walked]
    watts = np.mean([a['power_w']['supply'] for a, _ in walked])
    share = np.mean([a['power_w']['KFE'] / a['power_w']['supply'] for a, _ in walked])
    fast = [np.mean([_fast(entry) for entry in entries]) for entries in zip(*walked, strict=True)]
    return (
        f'| {name} | {watts:.0f} W | {share:.0%} | {fast[0]:.1%}, {fast[1]:.1%} | '
        f'{np.mean(total):+.0f} % ({min(total):+.0f} … {max(total):+.0f}) | '
        f'{np.mean(knees):+.0f} % ({min(knees):+.0f} … {max(knees):+.0f}) | {", ".join(tasks)} |'
    )


def _fast(entry: Mapping[str, Any]) -> float:
    return float(entry['smoothness']['kfe_torque_above_20_hz'])


def walks(*entries: Mapping[str, Any]) -> bool:
    """Return whether both walk as asked, within 0.15, and alike, within 0.05 m/s or rad/s."""
    if not all(entry['power_w'] and not entry['falls'] for entry in entries):
        return False
    errors = np.array([list(entry['tracking'].values()) for entry in entries])
    return bool((np.abs(errors) < 0.15).all() and np.ptp(errors, axis=0).max() < 0.05)


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
