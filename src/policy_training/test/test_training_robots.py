from dataclasses import replace

import numpy as np
import pytest
from policy_runner.trot import TROTS, ScriptedTrot
from policy_training.config import PhysicsConfig, RandomConfig
from policy_training.drives import BatchDrives
from policy_training.robots import Robots
from sim_bridge.plant import Plant
from sim_bridge.robot import DEFAULT_POSE

CALM = RandomConfig(
    friction_low=0.9,
    friction_high=0.9,
    payload=0.0,
    push=0.0,
    delay=0.0,
    stiffness=0.0,
    drive_friction=0.0,
    inertia=0.0,
    pose=0.0,
    velocity=0.0,
)
FLAT = PhysicsConfig(environments=2, threads=1, noise=0.0, slope=0.0)


def robots(physics=FLAT, spread=CALM, seed=0):
    made = Robots(physics, spread, np.random.default_rng(seed))
    made.start(np.arange(physics.environments))
    return made


def drives(spread=CALM, plant='anymal_c', count=1):
    return BatchDrives(Plant.load(plant), count, 0.005, spread, np.random.default_rng(0))


def test_the_motor_is_the_position_loop_in_series_with_the_spring():
    made = drives()
    made.start(np.arange(1), np.zeros((1, 12)))
    made.aim(np.full((1, 12), 0.1))
    motor, _ = made.push(np.zeros((1, 12)), np.full((1, 12), 0.5))
    np.testing.assert_allclose(motor, (80.0 * 0.1 - 2.0 * 0.5) * 400.0 / 480.0)


def test_an_ideal_drive_hands_on_what_its_motor_makes():
    made = drives(plant='ideal')
    made.aim(np.full((1, 12), 0.1))
    motor, damping = made.push(np.zeros((1, 12)), np.ones((1, 12)))
    np.testing.assert_allclose(motor, 8.0 - 2.0)
    assert not damping.any()
    np.testing.assert_allclose(made.output(np.ones((1, 12)), np.full((1, 12), 1.5)), 6.0)


def test_friction_and_rotor_take_their_share_of_the_torque():
    made = drives()
    made.aim(np.zeros((1, 12)))
    speed = np.full((1, 12), 2.0)
    motor, damping = made.push(np.zeros((1, 12)), speed)
    haa = 0
    dry = 1.5 + 0.8 / (1 + 16.0) ** 2 + 0.06 * abs(motor[0, haa])
    drag = 2.4 + dry / 2.1
    assert damping[0, haa] == pytest.approx(drag)
    output = made.output(speed, speed + 0.1)[0, haa]
    assert output == pytest.approx(motor[0, haa] - drag * 2.1 - 0.0675 * 0.1 / 0.005)


def test_targets_arrive_after_each_robots_delay():
    made = drives(replace(CALM, delay=0.01), count=64)
    made.start(np.arange(64), np.zeros((64, 12)))
    made.aim(np.ones((64, 12)))
    arrived = []
    for _ in range(4):
        made.push(np.zeros((64, 12)), np.zeros((64, 12)))
        arrived.append(made.target[:, 0].copy())
    counts = [int(row.sum()) for row in arrived]
    assert 0 < counts[0] < counts[1] < counts[2] == counts[3] == 64


def test_the_scripted_trot_walks_in_training_as_it_does_on_the_robot():
    made = robots(replace(FLAT, decimation=2))
    trots = [ScriptedTrot(TROTS['trot']) for _ in range(2)]
    commands = np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 0.8]])
    motion, seen = made.motion(), []
    for index in range(480):
        time = 0.01 * index
        targets = [
            trot.step(
                time,
                command * (time > 1.7),
                motion.position[i],
                motion.gravity[i],
                motion.rate[i],
                motion.velocity[i],
            )
            for i, (trot, command) in enumerate(zip(trots, commands, strict=True))
        ]
        motion = made.step(np.stack(targets))
        assert not motion.fallen.any()
        if time > 3.2:
            seen.append(np.column_stack([motion.velocity[:, :2], motion.rate[:, 2]]))
    np.testing.assert_allclose(np.mean(seen, axis=0), commands, atol=0.1)
    weight = motion.foot_force.sum(axis=1).mean()
    assert weight == pytest.approx(52.1 * 9.81, rel=0.6)


def test_standing_feet_carry_the_weight():
    made = robots()
    for _ in range(60):
        motion = made.step(np.tile(DEFAULT_POSE, (2, 1)))
    np.testing.assert_allclose(motion.foot_force.sum(axis=1), 52.135 * 9.81, rtol=0.02)
    assert not motion.collisions.any()
    assert not motion.fallen.any()


def test_robots_that_lie_on_their_belly_have_fallen():
    made = robots()
    folded = np.tile(np.array([0.0, 1.4, -2.4] * 2 + [0.0, -1.4, 2.4] * 2), (2, 1))
    fallen = np.zeros(2, bool)
    for _ in range(100):
        fallen |= made.step(folded).fallen
    assert fallen.all()


def test_the_same_seed_gives_the_same_motion_on_any_number_of_threads():
    spread = RandomConfig()
    ground = replace(FLAT, noise=0.02, slope=0.02, environments=4)
    results = []
    for threads in (1, 2):
        made = robots(replace(ground, threads=threads), spread, seed=5)
        for _ in range(5):
            motion = made.step(np.tile(DEFAULT_POSE, (4, 1)))
        results.append(motion)
    np.testing.assert_array_equal(results[0].position, results[1].position)
    np.testing.assert_array_equal(results[0].foot_force, results[1].foot_force)
    other = robots(ground, spread, seed=6)
    assert not np.array_equal(other.motion().position, results[0].position)


def test_payload_and_friction_differ_between_robots_within_their_range():
    made = robots(replace(FLAT, environments=32), RandomConfig(payload=5.0))
    assert made.mass.std() > 1.0
    assert np.abs(made.mass - 52.135).max() <= 5.0
