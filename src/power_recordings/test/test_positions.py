import numpy as np
import pytest
from power_recordings.alignment.positions import is_rate, stands_still, unwrapped

TIME = np.arange(2000) / 100.0
VELOCITY = np.float32(10.0 * np.sin(2 * np.pi * 0.1 * TIME) + 5.0)
TRUE = np.cumsum(VELOCITY.astype(float)) / 100.0


@pytest.mark.parametrize('low', [0.0, -np.pi])
def test_an_encoder_that_starts_anew_every_turn_is_unwrapped(low):
    wrapped = np.float32(np.mod(TRUE - low, 2 * np.pi) + low)
    found = unwrapped(TIME, wrapped, VELOCITY)
    assert found - found[0] == pytest.approx(TRUE - TRUE[0], abs=0.05)


def test_positions_that_do_not_jump_are_returned_as_they_are():
    position = np.float32(np.sin(TIME))
    assert unwrapped(TIME, position, np.float32(np.cos(TIME))) is position


def test_a_fast_move_that_the_velocity_explains_is_no_start_of_a_turn():
    position = np.float32(np.where(TIME < 10.0, 0.0, 5.0))
    velocity = np.float32(np.where(np.abs(TIME - 9.995) < 0.006, 500.0, 0.0))
    assert unwrapped(TIME, position, velocity) == pytest.approx(position)


def test_many_turns_count_where_the_velocity_is_their_rate():
    assert is_rate(TIME, np.float32(TRUE), VELOCITY)
    assert not is_rate(TIME, np.float32(np.rad2deg(TRUE)), VELOCITY)
    assert not is_rate(TIME, np.float32(TRUE), np.zeros_like(VELOCITY))


def test_a_stalled_drive_stands_still_whatever_its_encoder_says():
    stalled = np.float32(12.6 + 0.05 * np.sin(TIME))
    stalled[:10] = 14.0  # how it came there
    assert stands_still(stalled)
    assert not stands_still(np.float32(TRUE))
    assert not stands_still(np.float32(0.3 * np.sin(TIME)))
