"""Computing cost of networks: µs on this machine, the best of several tries."""

import timeit
from collections.abc import Callable, Sequence

import numpy as np

from power_estimator.batch.power import BatchPower
from power_estimator.model import PowerModel
from power_estimator.network.features import FEATURES, Scaling
from power_estimator.network.lstm import LstmBank, Weights

_LIVE_DRIVES = 12
_SCALING = Scaling((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0, 1.0)


def best_of(body: Callable[[], object], tries: int) -> float:
    """Return the shortest time in s of `tries` calls: the cost on an idle machine."""
    return min(timeit.repeat(body, number=1, repeat=tries))


def sample_cost(hidden: int, history: int | None = None) -> float:
    """Return the µs per sample of twelve drives at 200 Hz, in the live node's arithmetic.

    history: None for carried state, one step a sample; windowed, a fourth of the `history` steps
    that each estimate at 50 Hz takes.
    """
    rng = np.random.default_rng(0)
    shapes = Weights.shapes(hidden).values()
    weights = Weights(*(rng.normal(0, 0.1, shape).astype(np.float32) for shape in shapes))
    drives = _LIVE_DRIVES
    bank = LstmBank({'a': (weights, _SCALING)}, {'a': range(drives)}, drives)
    if history is None:
        x = rng.normal(size=(drives, len(FEATURES))).astype(np.float32)
        return 1e6 * best_of(lambda: bank.step(x), 300)
    window = rng.normal(size=(history, drives, len(FEATURES))).astype(np.float32)
    return 1e6 / 4 * best_of(lambda: bank.run(window), 30)


def policy_step_cost(model: PowerModel, drives: Sequence[str], robots: int) -> float:
    """Return the µs per robot and policy step: four samples of all drives, robots at once."""
    batch = BatchPower(model, drives, robots)
    rng = np.random.default_rng(0)
    x = rng.normal(size=(3, robots, 4, len(drives))).astype(np.float32) * np.float32(0.1)
    return 1e6 / robots * best_of(lambda: batch.step(x[0], x[1], x[2]), 5)
