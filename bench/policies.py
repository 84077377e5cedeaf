"""Cost of predicted power in training: policy steps per second without it, with it, as the paper.

Rounds of the variants take turns in one process, so that whatever else the machine does hits
them alike. Networks have random weights of the size asked; the cost does not depend on them.

    python bench/policies.py [--environments 512] [--rounds 6] [--units 32] [--threads 0]
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from estimator import network
from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.power_source import PowerSource, PredictedPower
from policy_training.learning.learner import Learner
from power_estimator.network.checkpoint import FILE
from power_estimator.network.ppn import PowerPredictionNetwork
from wattwalk_core.anymal import JOINT_NAMES

RATE = 12_000.0  # policy steps a second
SLOWER = 1.1
WINDOWED = 64  # robots whose windows are timed; the cost is proportional to their number


class Variant:
    """One way to train, with the wall and the CPU time of each of its rounds, s."""

    def __init__(self, name: str, power: PowerSource | None, config: TrainingConfig) -> None:
        self.name = name
        self.steps = config.physics.environments * config.ppo.steps
        self.learner = Learner(config, WalkingEnvironment(config, power=power))
        self.times: list[tuple[float, float]] = []

    def round(self) -> None:
        """Run one round (collect and learn) and record its times."""
        ends = self.learner.iteration + 1
        self.times.append(seconds_of(lambda: self.learner.run(ends, lambda done: None)))

    def row(self, base: 'Variant') -> None:
        """Print the line of this variant in the table, against one without power."""
        wall, cpu = (float(value) for value in np.median(self.times, axis=0))
        # rounds run in turns, so ratios are taken round by round
        ratios = np.median(np.divide(self.times, base.times), axis=0).tolist()
        goal = f'{RATE:,.0f}/s' if self is base else f'≤ {SLOWER} ×'
        row(self.name, self.steps / wall, 1e6 * cpu / self.steps, *ratios, goal)


def row(name: str, rate: float, each: float, slower: float, costlier: float, goal: str) -> None:
    """Print a line of the table; each: CPU time of a policy step, µs."""
    print(f'{name:<34}{rate:>10,.0f}{each:>8.0f}{slower:>8.2f}{costlier:>8.2f}{goal:>11}')


def seconds_of(call: Callable[[], object]) -> tuple[float, float]:
    """Return the wall time and the CPU time of a call, s."""
    wall, cpu = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - wall, time.process_time() - cpu


def main() -> int:
    """Print the table of costs; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--environments', type=int, default=512)
    parser.add_argument('--rounds', type=int, default=6)
    parser.add_argument('--units', type=int, default=32, help='of the network in the reward')
    parser.add_argument('--threads', type=int, default=0, help='0: one per core')
    options = parser.parse_args()
    cores = options.threads or os.cpu_count() or 1
    torch.set_num_threads(cores)
    count = options.environments
    config = TrainingConfig.load('baseline').with_values(
        {'physics.environments': count, 'physics.threads': cores}
    )
    with tempfile.TemporaryDirectory() as temporary:
        spec, teacher = (f'ppn:{temporary}/{units}' for units in (options.units, 100))
        for units in {options.units, 100}:
            (Path(temporary) / str(units)).mkdir()
            network(units).save(Path(temporary) / str(units) / FILE)
        variants = [Variant('without power', None, config)]
        for units, model in ((options.units, spec), (100, teacher)):
            power = PredictedPower.load(model, count)
            variants.append(Variant(f'power by LSTM{units}, carried', power, config))
        for _ in range(options.rounds):
            for variant in variants:
                variant.round()
        some = min(count, WINDOWED)
        bank = PowerPredictionNetwork.load(Path(temporary) / '100').stream(JOINT_NAMES * some)
        history = np.zeros((60, 12 * some, 3), np.float32)  # 0.3 s at 200 Hz

        def as_in_the_paper() -> None:
            for _ in range(4):
                bank.reset()
                bank.run(history)

        window = np.multiply(seconds_of(as_in_the_paper), count / some)
    base = variants[0]
    print(
        f'{count} robots, {cores} threads, load {os.getloadavg()[0]:.1f}, {options.rounds} rounds'
    )
    print(f'{"":<34}{"steps/s":>10}{"CPU µs":>8}{"wall ×":>8}{"CPU ×":>8}{"goal":>11}')
    for variant in variants:
        variant.row(base)
    alone = np.median(base.times, axis=0) / config.ppo.steps
    wall, cpu = (alone + window).tolist()
    ratios = ((alone + window) / alone).tolist()
    row('as in the paper: 0.3 s windows', count / wall, 1e6 * cpu / count, *ratios, '(5 ×)')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
