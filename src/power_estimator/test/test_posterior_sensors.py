"""Errors of sensors: the plays that hysteresis is made of, scales, loads without a meter."""

from types import SimpleNamespace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.posterior.meter import blocked_shares
from power_estimator.posterior.sensors import slip
from power_estimator.posterior.summary import less_sure

EFFECTS = builtin_catalogue()


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


def drawn_about(mean, variance):
    """Draws of two scales that are not correlated."""
    draws = np.random.default_rng(3).normal(size=(20000, 2))
    draws = (draws - draws.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(draws.T))).T
    return np.asarray(mean) + draws * np.sqrt(variance)


def test_a_scale_is_less_sure_the_more_power_no_formula_explains():
    # A recording that says 1 ± 1/√3 of a prior of 0 ± 1 leaves 0.75 ± 0.5. An error of the power
    # as large as one spread's makes of it 1 ± √(4/3), which leaves 3/7, with a variance of 4/7.
    drawn = drawn_about([0.75, 0.0], [0.25, 0.5])
    found = less_sure(drawn, np.diag([4.0, 0.0]), 4.0)
    assert found.mean(axis=0) == pytest.approx([3 / 7, 0.0], abs=1e-6)
    assert found.var(axis=0, ddof=1) == pytest.approx([4 / 7, 1.0], rel=1e-4)


def test_a_scale_that_nothing_is_left_beside_is_as_sure_as_it_was():
    drawn = drawn_about([0.75, -0.2], [0.25, 0.5])
    assert less_sure(drawn, np.eye(2), 0.0) == pytest.approx(drawn)


def test_only_what_the_supply_blocks_is_shared_with_what_draws_beside_the_drives():
    # A drive returns 40 W, then draws; others return 120 W throughout.
    drawn = np.array([[-40.0], [60.0], [300.0]])
    signals = SimpleNamespace(
        drawn=drawn,
        one_meter=False,
        others=SimpleNamespace(returned=np.full((3, 1), 120.0), drawn=np.full((3, 1), -120.0)),
    )

    def shares(name, **shape):
        return blocked_shares(signals, {name: (Active.of(EFFECTS[name], shape), np.ones(1))})

    assert shares('regeneration_limit', supply=1.0)[:, 0].tolist() == [0.25, 0.0, 0.0]
    assert not shares('regeneration_limit', supply=0.0).any()  # diodes in front of each drive
    assert not shares('regeneration_efficiency', bridge=0.0, supply=1.0).any()
    signals.one_meter = True  # which sees the rest of the robot
    assert not shares('regeneration_limit', supply=1.0).any()
