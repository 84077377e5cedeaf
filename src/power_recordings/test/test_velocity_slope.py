import numpy as np
import pytest
from power_recordings.quality.physics import velocity_slope

TIME = np.arange(0.0, 60.0, 0.0025)
ANGLE = 0.4 * np.sin(2 * np.pi * 1.5 * TIME)
RATE = 0.4 * 2 * np.pi * 1.5 * np.cos(2 * np.pi * 1.5 * TIME)


@pytest.mark.parametrize('scale', [1.0, -1.0, 60 / (2 * np.pi)])
def test_the_slope_is_the_scale_of_the_velocity(scale):
    found = velocity_slope(TIME, ANGLE, scale * RATE)
    assert found.slope == pytest.approx(scale, rel=1e-3)
    assert abs(found.correlation) > 0.999


def test_noise_of_the_position_does_not_make_the_slope_smaller():
    noise = np.random.default_rng(0).normal(0.0, 0.02, len(TIME))
    assert velocity_slope(TIME, ANGLE + noise, RATE).slope == pytest.approx(1.0, abs=0.03)


def test_a_robot_that_is_put_back_on_its_feet_has_the_slope_of_one_that_walks_on():
    """Twenty jumps of up to 1.5 rad in a minute: the standard deviations would say about 0.8."""
    random = np.random.default_rng(1)
    jumps = np.zeros_like(TIME)
    jumps[random.choice(len(TIME), 20, replace=False)] = random.uniform(-1.5, 1.5, 20)
    position = ANGLE + np.cumsum(jumps)
    assert velocity_slope(TIME, position, RATE).slope == pytest.approx(1.0, abs=0.02)


def test_a_drive_that_does_not_move_has_no_slope():
    assert velocity_slope(TIME, np.zeros_like(TIME), RATE) is None
