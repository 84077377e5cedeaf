"""Alignment of sounds with recordings, on test sounds whose times are known."""

from itertools import pairwise

import numpy as np
import pytest
from power_recordings.reading.reader import Recording
from sound_levels.levels.alignment import align_sound, events_of
from sound_levels.levels.meter import measure
from sounds import FLIGHT, RATE, footsteps, walking_sound
from wattwalk_core.errors import InputError

EVEN = np.arange(3.0, 29.5, 0.5).tolist()


def uneven(seconds, seed=0):
    """Times of landings, 0.4 to 0.6 s apart, from 2 s on."""
    steps = np.random.default_rng(seed).uniform(0.4, 0.6, round(2.5 * seconds))
    times = 2.0 + np.cumsum(steps)
    return times[times < seconds - 0.3].tolist()


def aligned(
    landings, method='auto', clap_at=None, *, seconds=30.0, knock=None, recording=None, **sound
):
    samples = walking_sound(seconds, landings, **sound)
    events = events_of(recording or footsteps(seconds, landings, knock))
    return align_sound(measure(iter([samples[:, None]]), RATE), events, method, clap_at)


@pytest.mark.parametrize('start', [-3.0, 4.0])
def test_the_gait_aligns_a_sound_with_its_recording(start):
    found = aligned(uneven(30.0), 'gait', start=start)
    assert found.offset == pytest.approx(start, abs=0.03)
    assert found.rival < 0.9


def test_an_even_gait_is_said_to_fit_a_stride_further_too():
    found = aligned(np.arange(0.5, 29.5, 0.5).tolist(), 'gait', start=5.0)
    assert found.rival > 0.9
    assert 'clap once to be sure' in found.notes[0]
    strides = (found.offset - 5.0) / 0.5
    assert strides == pytest.approx(round(strides), abs=0.06)


def test_a_clap_that_the_imu_felt_settles_it():
    found = aligned(EVEN, start=-2.0, claps=[1.5], knock=1.5)
    assert found.method == 'clap'
    assert found.offset == pytest.approx(-2.0, abs=0.03)


def test_a_clap_whose_time_is_noted_settles_it_too():
    found = aligned(EVEN, 'clap', 1.5, start=-2.0, claps=[1.5])
    assert found.offset == pytest.approx(-2.0, abs=0.03)
    with pytest.raises(InputError, match='--clap-at'):
        aligned(EVEN, 'clap', start=-2.0, claps=[1.5])
    with pytest.raises(InputError, match='no impulse that stands out'):
        aligned(EVEN, 'clap', 1.5, start=-2.0)


def test_the_first_sound_is_aligned_with_the_first_landing():
    found = aligned(uneven(20.0), 'step', start=-1.0, seconds=20.0)
    assert found.offset == pytest.approx(-1.0, abs=0.03)


def test_drift_between_the_clocks_is_estimated():
    found = aligned(uneven(120.0), 'gait', start=0.5, drift=200.0, seconds=120.0)
    assert found.drift == pytest.approx(200.0, abs=60.0)
    assert found.offset == pytest.approx(0.5, abs=0.03)


def test_a_sound_of_another_walk_is_not_aligned():
    found = aligned(uneven(30.0, seed=9), start=2.2, recording=footsteps(30.0, uneven(30.0)))
    assert found is None or found.correlation < 0.5


def test_landings_are_those_that_were_made():
    found = events_of(footsteps(10.0, uneven(10.0)))
    np.testing.assert_allclose(found.landings, uneven(10.0), atol=0.006)
    assert all(later > sooner for sooner, later in pairwise(found.landings))


def test_a_clap_and_the_gait_of_a_simulated_walk_agree_to_10_ms(request):
    walk = Recording.open(request.config.rootpath / 'bags' / 'walk_small')
    feet = walk.foot_force()
    down = (feet.force[1:] > 20.0) & (feet.force[:-1] <= 20.0)
    landings = (feet.stamp_ns[1:][down.any(axis=1)] - walk.start_ns) / 1e9
    found = aligned(
        landings, 'clap', 0.4, seconds=walk.duration, recording=walk, start=-2.0, claps=[0.4]
    )
    assert found.offset == pytest.approx(-2.0 - FLIGHT, abs=0.01)
    assert found.correlation > 0.25
