import numpy as np
import pytest
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.kinematics import forward, inverse
from policy_runner.policies.trot import (
    TARGET_LIMITS,
    TROTS,
    Feedback,
    GaitCycle,
    ScriptedTrot,
    TrotConfig,
)
from wattwalk_core.anymal import DEFAULT_POSE, LIMITS
from wattwalk_core.errors import InputError

LEVEL = np.array([0.0, 0.0, -1.0])
STILL = np.zeros(3)
MIRROR = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
FLIP = np.tile([-1, 1, 1], 4)


def step(trot, time, command, position, gravity, spin, velocity):
    inputs = Inputs(position=np.asarray(position), gravity=gravity, spin=spin)
    return trot.step(time, command, inputs, velocity)


def targets(command, seconds=6.0, gravity=LEVEL, spin=STILL, velocity=STILL, trot=None):
    trot = trot or ScriptedTrot()
    times = np.arange(0.0, seconds, 0.005)
    command = np.asarray(command, dtype=float)
    position = np.asarray(DEFAULT_POSE)
    return np.array(
        [step(trot, time, command, position, gravity, spin, velocity) for time in times]
    )


def walking_cycle(seconds, config=TROTS['trot']):
    cycle = GaitCycle()
    swinging = []
    for _ in range(round(seconds / 0.005)):
        advance(cycle, config, requested=True, settled=True)
        swinging.append(cycle.swinging.copy())
    return np.array(swinging)


def advance(cycle, config, *, requested, settled):
    cycle.advance(0.005, config.frequency, config.duty, requested=requested, settled=settled)


def test_diagonal_feet_swing_together_and_the_pairs_take_turns():
    swinging = walking_cycle(4.0)
    assert np.array_equal(swinging[:, 0], swinging[:, 3])
    assert np.array_equal(swinging[:, 1], swinging[:, 2])
    assert not (swinging[:, 0] & swinging[:, 1]).any()


@pytest.mark.parametrize('name', TROTS)
def test_feet_are_on_the_ground_for_the_duty_of_the_gait(name):
    config = TROTS[name]
    swinging = walking_cycle(20.0 / config.frequency, config)
    assert np.allclose(1.0 - swinging.mean(axis=0), config.duty, atol=0.02)
    lifts = (np.diff(swinging.astype(int), axis=0) > 0).sum(axis=0)
    assert np.all(np.abs(lifts - 20) <= 1)


def test_it_stops_stepping_only_with_all_feet_down_and_everything_settled():
    cycle, config = GaitCycle(), TROTS['trot']
    for _ in range(150):
        advance(cycle, config, requested=True, settled=True)
    for _ in range(400):
        advance(cycle, config, requested=False, settled=False)
    assert cycle.walking
    while cycle.walking:
        down = ~cycle.swinging
        advance(cycle, config, requested=False, settled=True)
    assert down.sum() >= 2
    assert not cycle.swinging.any()
    assert cycle.load.min() >= 0.0


def test_forward_walking_is_the_same_on_both_sides_half_a_stride_apart():
    trot = ScriptedTrot(TrotConfig(frequency=2.0))
    out = targets([0.5, 0.0, 0.0], seconds=8.0, velocity=np.array([0.5, 0, 0]), trot=trot)
    half, late = 50, slice(1000, 1400)
    shifted = out[1000 + half : 1400 + half][:, MIRROR] * FLIP
    assert np.allclose(out[late], shifted, atol=1e-3)


def test_walking_sideways_left_mirrors_walking_right():
    left = targets([0, 0.3, 0], velocity=np.array([0, 0.3, 0]))
    right = targets([0, -0.3, 0], velocity=np.array([0, -0.3, 0]))
    stride = round(200 / 1.9 / 2)
    a = left[800:1000]
    b = right[800 + stride : 1000 + stride][:, MIRROR] * FLIP
    assert np.abs(a - b).mean() < 0.02


def test_a_standing_robot_keeps_its_feet_down_and_its_targets_still():
    feet = ScriptedTrot().config.footholds
    position = inverse(feet).ravel()
    trot = ScriptedTrot()
    out = [step(trot, 0.005 * k, STILL, position, LEVEL, STILL, STILL) for k in range(800)]
    assert not trot.walking
    assert np.ptp(out[500:], axis=0).max() < 1e-3


def test_feet_are_lifted_by_the_swing_height():
    trot = ScriptedTrot()
    for k in range(1200):
        step(trot, 0.005 * k, np.array([0.3, 0, 0]), DEFAULT_POSE, LEVEL, STILL, STILL)
    heights = []
    for k in range(1200, 1400):
        step(trot, 0.005 * k, np.array([0.3, 0, 0]), DEFAULT_POSE, LEVEL, STILL, STILL)
        heights.append(forward(trot.planned.ravel()).feet[:, 2])
    rise = np.max(heights, axis=0) - np.median(heights, axis=0)
    assert np.allclose(rise, trot.config.swing_height, atol=0.015)


def test_the_first_target_is_the_present_pose_and_targets_ramp_from_there():
    trot = ScriptedTrot()
    pose = np.asarray(DEFAULT_POSE) + 0.3
    out = np.array([step(trot, 0.005 * k, STILL, pose, LEVEL, STILL, STILL) for k in range(300)])
    assert np.allclose(out[0], pose)
    assert np.abs(np.diff(out, axis=0)).max() < 0.03


def test_reset_makes_the_next_run_equal_to_the_first():
    trot = ScriptedTrot()
    first = targets([0.3, 0.1, 0.2], 3.0, trot=trot)
    trot.reset()
    assert np.array_equal(targets([0.3, 0.1, 0.2], 3.0, trot=trot), first)


def test_a_push_to_the_left_moves_the_coming_footholds_to_the_left():
    def highest_side(velocity):
        trot = ScriptedTrot()
        sides = []
        for k in range(700):
            pushed = np.array(velocity) if k > 600 else STILL
            step(trot, 0.005 * k, np.array([0.1, 0, 0]), DEFAULT_POSE, LEVEL, STILL, pushed)
            if k > 600:
                sides.append(forward(trot.planned.ravel()).feet[:, 1])
        return np.max(sides, axis=0)

    assert np.all(highest_side([0, 0.6, 0]) > highest_side([0, 0, 0]) + 0.02)


def test_targets_stay_finite_and_in_range_for_wild_inputs():
    random = np.random.default_rng(0)
    trot = ScriptedTrot()
    for k in range(2000):
        gravity = random.normal(size=3)
        out = step(
            trot,
            0.005 * k,
            random.uniform(-5, 5, 3),
            random.uniform(LIMITS[:, 0], LIMITS[:, 1]),
            gravity / np.linalg.norm(gravity),
            random.normal(0, 5, 3),
            random.normal(0, 3, 3) if k % 2 else None,
        )
        assert np.isfinite(out).all()
        assert (out >= TARGET_LIMITS[:, 0]).all()
        assert (out <= TARGET_LIMITS[:, 1]).all()


def test_time_standing_still_or_going_back_does_no_harm():
    trot = ScriptedTrot()
    for time in (1.0, 1.0, 0.5, 1.005, 50.0):
        out = step(trot, time, STILL, DEFAULT_POSE, LEVEL, STILL, None)
        assert np.isfinite(out).all()


@pytest.mark.parametrize(
    ('field', 'value'), [('frequency', 9.0), ('duty', 0.3), ('height', 0.7), ('stiffness', 0.0)]
)
def test_impossible_gaits_are_refused_with_value_and_range(field, value):
    with pytest.raises(InputError, match=rf'{field}: expected .* there is {value}'):
        TrotConfig(**{field: value})


def test_impossible_feedback_is_refused():
    with pytest.raises(InputError, match=r'foothold: expected 0 to 0\.4 s, there is 3'):
        Feedback(foothold=3)
