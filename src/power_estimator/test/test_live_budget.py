"""Budget of a live estimate: parts of its power over the last seconds."""

import numpy as np
import pytest
from power_estimator.live.budget import LiveBudget
from power_estimator.live.estimator import Estimate, Status

TICK = 20_000_000  # ns


def estimate(number, status=Status.OK, **parts):
    watts = {name: np.array(values) for name, values in parts.items()}
    power = np.sum([*watts.values()], axis=0, dtype=np.float32)
    return Estimate(number * TICK, power, status, watts)


def test_the_budget_is_of_ten_seconds_of_estimates_that_can_be_relied_on():
    """Ten seconds at 1 W, then ten at 3 W; what is outside the training data does not count."""
    budget = LiveBudget()
    for number in range(500):
        budget.take(estimate(number, idle=[1.0, 0.0]))
    for number in range(500, 1000):
        budget.take(estimate(number, idle=[2.0, 1.0]))
    budget.take(estimate(1000, Status.OUTSIDE_TRAINING_DATA, idle=[90.0, 90.0]))
    assert budget.parts == pytest.approx({'idle': 3.0})
    assert budget.seconds == pytest.approx(9.98)
    budget.take(estimate(1001, Status.INPUT_STALE))
    assert not budget.parts


def test_what_a_drive_gives_back_is_regeneration():
    """30 W and −10 W at the shafts: 30 W of work, 10 W that came back."""
    budget = LiveBudget()
    budget.take(estimate(0, shaft=[30.0, -10.0], copper_loss=[5.0, 3.0]))
    assert [*budget.parts.items()] == [
        *(('shaft', 30.0), ('copper_loss', 8.0), ('regeneration', -10.0))
    ]
    sentence, figures = budget.report()
    assert sentence.startswith('28.0 W in the last 0 s: shaft 30.0 W, copper loss 8.0 W')
    assert figures['regeneration [W]'] == '-10.000'
