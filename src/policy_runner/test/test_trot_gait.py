from dataclasses import replace

import numpy as np
import pytest
from policy_runner.policies.kinematics import forward, inverse
from policy_runner.policies.trot import (
    TARGET_LIMITS,
    TROTS,
    Feedback,
    ScriptedTrot,
    ScriptedTrots,
    TrotConfig,
)
from policy_runner.policies.trot_gait import GaitCycle, GaitTable
from wattwalk_core.anymal import DEFAULT_POSE, LIMITS
from wattwalk_core.errors import InputError

LEVEL = np.array([0.0, 0.0, -1.0])
STILL = np.zeros(3)
MIRROR = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
FLIP = np.tile([-1, 1, 1], 4)


def targets(command, seconds=6.0, gravity=LEVEL, spin=STILL, velocity=STILL, trot=None):
    trot = trot or ScriptedTrot()
    times = np.arange(0.0, seconds, 0.005)
    command = np.asarray(command, dtype=float)
    position = np.asarray(DEFAULT_POSE)
    return np.array(
        [trot.step(time, command, position, gravity, spin, velocity) for time in times]
    )


def walking_cycle(seconds, config=TROTS['trot']):
    cycle = GaitCycle()
    swinging = []
    for _ in range(round(seconds / 0.005)):
        advance(cycle, config, requested=True, settled=True)
        swinging.append(cycle.swinging[0].copy())
    return np.array(swinging)


def advance(cycle, config, *, requested, settled):
    shape = (np.array([value]) for value in (0.005, config.frequency, config.duty))
    cycle.advance(*shape, requested=np.array([requested]), settled=np.array([settled]))


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
    assert cycle.walking[0]
    while cycle.walking[0]:
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
    out = [trot.step(0.005 * k, STILL, position, LEVEL, STILL, STILL) for k in range(800)]
    assert not trot.walking
    assert np.ptp(out[500:], axis=0).max() < 1e-3


def test_feet_are_lifted_by_the_swing_height():
    trot = ScriptedTrot()
    for k in range(1200):
        trot.step(0.005 * k, np.array([0.3, 0, 0]), DEFAULT_POSE, LEVEL, STILL, STILL)
    heights = []
    for k in range(1200, 1400):
        trot.step(0.005 * k, np.array([0.3, 0, 0]), DEFAULT_POSE, LEVEL, STILL, STILL)
        heights.append(forward(trot.planned.ravel()).feet[:, 2])
    rise = np.max(heights, axis=0) - np.median(heights, axis=0)
    assert np.allclose(rise, trot.config.swing_height, atol=0.015)


def test_the_first_target_is_the_present_pose_and_targets_ramp_from_there():
    trot = ScriptedTrot()
    pose = np.asarray(DEFAULT_POSE) + 0.3
    out = np.array([trot.step(0.005 * k, STILL, pose, LEVEL, STILL, STILL) for k in range(300)])
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
            trot.step(0.005 * k, np.array([0.1, 0, 0]), DEFAULT_POSE, LEVEL, STILL, pushed)
            if k > 600:
                sides.append(forward(trot.planned.ravel()).feet[:, 1])
        return np.max(sides, axis=0)

    assert np.all(highest_side([0, 0.6, 0]) > highest_side([0, 0, 0]) + 0.02)


def test_robots_side_by_side_walk_as_each_does_alone():
    random = np.random.default_rng(3)
    configs = [
        *(replace(TROTS[name], cadence_adaptation=(3.0, 0.25, 0.6)) for name in TROTS),
        replace(TROTS['trot'], urgent_foot_y=0.34, urgent_height=0.48, frequency_per_speed=0.6),
    ]
    count = len(configs)
    together, alone = ScriptedTrots(configs), [ScriptedTrot(config) for config in configs]
    for k in range(1200):
        if k == 700:
            together.reset(np.array([1]))
            alone[1].reset()
        inputs = [
            np.tile([0.5, 0.1, 0.3], (count, 1)) * (k < 900),
            DEFAULT_POSE + random.normal(0, 0.02, (count, 12)),
            LEVEL + random.normal(0, 0.03, (count, 3)),
            random.normal(0, 0.1, (count, 3)),
            random.normal([0.5, 0.1, 0.0], 0.3, (count, 3)),
        ]
        found = together.step(0.005 * k, *inputs)
        expected = [trot.step(0.005 * k, *(x[i] for x in inputs)) for i, trot in enumerate(alone)]
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_table_walks_as_the_gait_of_its_command_and_blends_in_between():
    low, high = replace(TROTS['trot'], height=0.46), replace(TROTS['trot'], height=0.56)
    table = GaitTable(((0.8, 0.0, 0.0), (0.0, 0.4, 0.0)), (low, high))
    commands = np.array([[0.8, 0.0, 0.0], [-0.8, 0.0, 0.0], [0.0, -0.4, 0.0], [0.4, 0.2, 0.0]])
    weights = table.weights(commands)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights[:3], [[1, 0], [1, 0], [0, 1]], atol=1e-3)
    assert 0.3 < weights[3, 0] < 0.7

    alone, by_table = ScriptedTrots([low]), ScriptedTrots([TROTS['trot']], table)
    for k in range(800):
        inputs = ([[0.8, 0.0, 0.0]], [DEFAULT_POSE], [LEVEL], np.zeros((1, 3)), np.zeros((1, 2)))
        expected, found = (
            trots.step(0.005 * k, *map(np.array, inputs)) for trots in (alone, by_table)
        )
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_a_table_of_one_gait_is_refused():
    with pytest.raises(InputError, match='1 commands and 1 gaits'):
        GaitTable(((0.0, 0.0, 0.0),), (TROTS['trot'],))


def test_a_robot_in_a_hurry_takes_the_urgent_stance_and_a_calm_one_does_not():
    config = replace(
        TROTS['trot'], cadence_adaptation=(3.0, 0.25, 0.6), urgent_foot_y=0.34, foot_y=0.24
    )
    sides = []
    for error in (0.0, 2.0):
        trot = ScriptedTrot(config)
        for k in range(800):
            velocity = np.array([0.3 + error * (k > 600), 0.0, 0.0])
            trot.step(0.005 * k, np.array([0.3, 0, 0]), DEFAULT_POSE, LEVEL, STILL, velocity)
        sides.append(np.abs(forward(trot.planned.ravel()).feet[:, 1]).max())
    assert sides[0] == pytest.approx(0.24, abs=0.01)
    assert sides[1] == pytest.approx(0.34, abs=0.02)


def test_the_stride_rate_rises_with_the_speed_that_is_asked_for():
    config = replace(TROTS['trot'], frequency=1.3, frequency_per_speed=0.5)
    lifts = []
    for speed in (0.2, 0.8):
        trot, before = ScriptedTrot(config), 0.0
        command, count = np.array([speed, 0, 0]), 0
        for k in range(2800):
            trot.step(0.005 * k, command, DEFAULT_POSE, LEVEL, STILL, command)
            count += k >= 800 and trot.stride < before
            before = trot.stride
        lifts.append(count / 10.0)
    assert lifts == pytest.approx([1.4, 1.7], abs=0.1)


def test_targets_stay_finite_and_in_range_for_wild_inputs():
    random = np.random.default_rng(0)
    trot = ScriptedTrot()
    for k in range(2000):
        gravity = random.normal(size=3)
        out = trot.step(
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
        out = trot.step(time, STILL, DEFAULT_POSE, LEVEL, STILL, None)
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
