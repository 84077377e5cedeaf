"""Efficiency over torque and speed, and a leg's power over its gait cycle."""

from types import SimpleNamespace

import numpy as np
import pytest
from power_lab.budget.accounts import PartsOverTime
from power_lab.budget.efficiency_map import EfficiencyMap
from power_lab.budget.gait_cycle import GaitCyclePower


def steady(power):
    return SimpleNamespace(drive=0, power=power)


def states(count=4000):
    random = np.random.default_rng(1)
    return {
        'torque': random.uniform(-20.0, 20.0, (count, 1)),
        'velocity': random.uniform(-4.0, 4.0, (count, 1)),
    }


def test_driving_is_efficient_by_shaft_over_supply_and_braking_by_supply_over_shaft():
    found = EfficiencyMap.of('KFE', steady(lambda w, tau: tau * w + 10.0), states())
    shaft = found.torque[:, None] * found.speed[None]
    want = 100.0 * np.where(shaft >= 0, shaft / (shaft + 10.0), (shaft + 10.0) / shaft)
    assert found.percent == pytest.approx(np.clip(want, 0.0, 100.0))
    assert found.percent.max() < 100.0
    assert (found.percent[(shaft < 0) & (shaft > -10.0)] == 0.0).all()


def test_states_are_torques_along_the_motion():
    one = {'torque': np.array([[5.0], [-5.0]] * 4), 'velocity': np.array([[-2.0], [-2.0]] * 4)}
    found = EfficiencyMap.of('KFE', steady(lambda w, tau: tau * w + 1.0), one)
    assert found.states[:2].tolist() == [[2.0, -5.0], [2.0, 5.0]]
    assert found.json()['states'][0] == [2.0, -5.0]


def walked(strides=12, rows=24, lost=()):
    """Two drives of one leg that stand half of a stride, and draw 10 W there and 4 W in swing."""
    stands = np.tile(np.arange(rows) < rows // 2, strides)
    both = np.stack([stands, stands], axis=1)
    metered = np.where(both, 10.0, 4.0)
    parts = np.stack([np.full(both.shape, 3.0), np.where(both, 5.0, 0.0)], axis=2)
    parts[list(lost)] = np.nan
    return PartsOverTime(
        ('LF_HFE', 'LF_KFE'),
        ('idle', 'copper_loss'),
        parts.astype(np.float32),
        metered,
        {},
        {'stance': both},
        (slice(0, len(stands)),),
    )


def test_a_gait_cycle_adds_up_to_what_was_metered_of_a_leg():
    found = GaitCyclePower.of(walked())
    assert found is not None
    assert found.stance == pytest.approx(50.0)
    assert found.metered[:12] == pytest.approx(20.0)
    assert found.metered[12:] == pytest.approx(8.0)
    assert found.families['idle'] == pytest.approx(6.0)
    assert found.families['copper'][:12] == pytest.approx(10.0)
    assert sum(found.families.values()) == pytest.approx(found.metered)
    assert len(found.json()['percent']) == 24


@pytest.mark.parametrize('rows', [14, 20, 24, 30])
def test_strides_of_any_length_fill_the_cycle(rows):
    found = GaitCyclePower.of(walked(rows=rows))
    assert found is not None
    assert len(found.percent) == min(rows, 24)
    assert found.metered.min() == pytest.approx(8.0)


def test_rows_without_an_estimate_are_left_out_of_the_cycle():
    found = GaitCyclePower.of(walked(lost=(30, 31, 100)))
    assert found is not None
    assert found.metered == pytest.approx(GaitCyclePower.of(walked()).metered)
    assert np.isfinite(found.families['copper']).all()


def test_a_robot_without_feet_or_with_few_strides_has_no_gait_cycle():
    assert GaitCyclePower.of(walked(strides=2)) is None
    rows = walked()
    assert GaitCyclePower.of(PartsOverTime(**{**vars(rows), 'masks': {}})) is None
