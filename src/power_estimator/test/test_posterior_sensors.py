"""Errors of sensors: the plays that hysteresis is made of."""

import numpy as np
import pytest
from power_estimator.posterior.sensors import slip


def test_slip_follows_the_torque_between_its_ends():
    torque = np.array([0.0, 1.0, 2.0, 1.5, -4.0])[:, None]
    rms = np.sqrt(np.mean(torque**2))
    reach = 0.05 * rms  # N·m; each step here is longer than both ways of it but the first two
    assert reach < 0.25
    assert slip(torque, np.array([reach]))[:, 0] == pytest.approx([0.0, 1.0, 1.0, -1.0, -1.0])


def test_slip_of_small_steps_adds_them_up_and_turns_round_where_the_torque_does():
    steps = np.array([0.0, 0.5, 1.0, -0.5, -1.0, -1.0])  # of the reach
    load = 20.0 / np.sqrt(1 - 0.05**2)
    torque = load + np.cumsum(steps)
    reach = 0.05 * np.sqrt(np.mean(torque**2))
    found, expected = slip(torque[:, None], np.array([reach]))[:, 0], [0.0]
    for step in steps[1:] / reach:
        expected.append(float(np.clip(expected[-1] + step, -1.0, 1.0)))
    assert found == pytest.approx(expected)
    assert min(found) == -1.0 < max(found)


def test_hysteresis_of_a_width_between_two_plays_is_their_sum():
    random = np.random.default_rng(6)
    torque = 20.0 + np.cumsum(random.normal(size=(4000, 1)), axis=0)
    size = np.sqrt(np.mean(torque**2, axis=0))
    loop, narrow, wide = (slip(torque, share * size) for share in (0.1, 0.05, 0.15))
    plays = np.concatenate([narrow, wide, np.ones_like(loop)], axis=1)
    left = {
        count: (loop - plays[:, own] @ np.linalg.lstsq(plays[:, own], loop, rcond=None)[0]).var()
        for count, own in ((1, [0, 2]), (2, [0, 1, 2]))
    }
    assert left[2] < 0.1 * loop.var()
    assert left[1] > 0.25 * loop.var()  # one play alone
