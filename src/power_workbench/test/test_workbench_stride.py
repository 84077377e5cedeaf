"""Phase of the stride from the positions of the joints."""

import numpy as np
import pytest
from power_workbench.views.view import stride_phase

RATE = 50


def around(difference):
    """Distance of phases on the circle."""
    return np.abs((difference + 0.5) % 1.0 - 0.5)


def test_the_phase_of_a_gait_is_zero_at_the_largest_position_and_rises_to_one():
    t = np.arange(3000) / RATE
    truth = (t / 0.66) % 1.0
    angle = 2 * np.pi * truth
    position = np.stack([0.1 * np.sin(angle), 0.4 * np.cos(angle) + 1.0], axis=1)
    found = stride_phase(position.astype(np.float32), np.arange(3000))
    assert found.drive == 1
    assert found.period == pytest.approx(0.66, abs=0.02)
    inside = slice(200, -200)
    assert around(found.phase[inside] - truth[inside]).max() < 0.02


def test_the_phase_follows_a_cadence_that_changes():
    t = np.arange(6000) / RATE
    turns = np.cumsum(1.5 + 0.2 * np.sin(2 * np.pi * t / 40)) / RATE
    position = 0.3 * np.cos(2 * np.pi * turns)[:, None].astype(np.float32)
    found = stride_phase(position, np.arange(6000))
    inside = slice(200, -200)
    assert around(found.phase[inside] - turns[inside] % 1.0).max() < 0.05


def test_the_period_is_that_of_the_stride_and_not_of_its_harmonics():
    t = np.arange(3000) / RATE
    position = np.cos(2 * np.pi * t / 0.8) + 0.6 * np.cos(4 * np.pi * t / 0.8)
    found = stride_phase(position[:, None].astype(np.float32), np.arange(3000))
    assert found.period == pytest.approx(0.8, abs=0.02)


def test_standing_between_walks_has_no_phase():
    t = np.arange(3000) / RATE
    walks = (t < 25) | (t > 35)
    position = np.where(walks, 0.3 * np.cos(2 * np.pi * t / 0.6), 0.0)
    found = stride_phase(position[:, None].astype(np.float32), np.arange(3000))
    assert np.isnan(found.phase[1400:1600]).all()
    assert np.isfinite(found.phase[200:1000]).all()


def test_gaps_between_recordings_do_not_disturb_the_phase():
    slots = np.concatenate([np.arange(1500), np.arange(1600, 3000)])
    position = 0.3 * np.cos(2 * np.pi * slots / RATE / 0.6)
    found = stride_phase(position[:, None].astype(np.float32), slots)
    truth = (slots / RATE / 0.6) % 1.0
    far = (np.abs(slots - 1550) > 200) & (slots > 200) & (slots < 2800)
    assert around(found.phase[far] - truth[far]).max() < 0.03


@pytest.mark.parametrize(
    ('position', 'said'),
    [
        (np.zeros((3000, 2)), 'nothing moves'),
        (np.cumsum(np.random.default_rng(1).normal(size=(3000, 2)), axis=0), 'does not repeat'),
        (np.random.default_rng(2).normal(size=(3000, 2)), 'does not repeat'),
        (np.sin(np.arange(30) / 3)[:, None], 'too short'),
        (np.full((3000, 1), np.nan), 'nothing moves'),
        (np.linspace(0, 9, 3000)[:, None], 'does not repeat'),
    ],
    ids=['still', 'wandering', 'noise', 'short', 'unknown', 'turning'],
)
def test_without_a_motion_that_repeats_there_is_a_reason(position, said):
    found = stride_phase(position.astype(np.float32), np.arange(len(position)))
    assert found.phase is None
    assert said in found.reason
