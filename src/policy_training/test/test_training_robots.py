from dataclasses import replace

import numpy as np
import pytest
from policy_runner.policies.trot import TROTS, ScriptedTrot
from policy_training.config import PhysicsConfig, RandomConfig
from policy_training.environment.drives import BatchDrives
from policy_training.environment.robots import Robots
from sim_bridge.plant.drive import Drives, JointCommand
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import DEFAULT_POSE, JOINT_NAMES

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
    resting=0.0,
)
FLAT = PhysicsConfig(environments=2, threads=1, noise=0.0, slope=0.0)


def robots(physics=FLAT, spread=CALM, seed=0):
    made = Robots(physics, spread, np.random.default_rng(seed))
    made.start(np.arange(physics.environments))
    return made


def drives(spread=CALM, plant='anymal_c', count=1):
    return BatchDrives(Plant.load(plant), count, 0.005, spread, np.random.default_rng(0))


def held(made, target, steps=400):
    """Torque on joints that are held at 0 rad, once rotors are at rest."""
    made.start(np.arange(1), np.zeros((1, 12)))
    made.aim(np.full((1, 12), target))
    for _ in range(steps):
        made.push(np.zeros((1, 12)), np.zeros((1, 12)))
    return made.output(np.zeros((1, 12)))[0]


@pytest.mark.parametrize('plant', ['anymal_c', 'ideal'])
def test_the_position_loop_closes_behind_the_spring_which_does_not_soften_it(plant):
    np.testing.assert_allclose(held(drives(plant=plant), 0.1), 80.0 * 0.1, rtol=1e-3)


def test_a_joint_that_turns_feels_grease_and_dry_friction():
    made, speed = drives(), np.full((1, 12), 2.0)
    for step in range(400):
        position = speed * 0.005 * step
        made.aim(position)
        motor, _ = made.push(position, speed)
    dry = 1.5 + 0.8 / (1 + 16.0) ** 2 + 0.06 * abs(motor[0, 0])
    drag = 2.0 * 2.4 / (1 + 2.0 / 40.0) + dry * 2.0 / 2.03
    assert motor[0, 0] == pytest.approx(-2.0 * 2.0, abs=0.5)
    assert made.output(speed)[0, 0] == pytest.approx(motor[0, 0] - drag, rel=0.01)


def test_joints_feel_what_they_feel_of_the_simulators_drives():
    """A joint swings by 0.3 rad at 2 Hz behind a target that steps at 50 Hz."""
    step, names = 0.0005, JOINT_NAMES
    truth = Drives(Plant.load('anymal_c'), names, step, 1)
    made = drives()
    truth.reset(np.zeros(12))
    made.start(np.arange(1), np.zeros((1, 12)))
    w, felt, expected = 2 * np.pi * 2.0, [], []
    out = np.zeros(12)
    for tick in range(400):
        time = 0.005 * tick
        if tick % 4 == 0:
            target = np.full(12, 0.3 * np.sin(w * time) + 0.1 * np.cos(w * time))
            made.aim(target[None])
            truth.hold(JointCommand(position=target))
        total = 0.0
        for small in range(10):
            now = time + step * small
            q, v = 0.3 * np.sin(w * now), 0.3 * w * np.cos(w * now)
            truth.step(0, np.full(12, q), np.full(12, v), out)
            total += out[0] / 10
        expected.append(total)
        q, v = 0.3 * np.sin(w * time), 0.3 * w * np.cos(w * time)
        after = 0.3 * w * np.cos(w * (time + 0.005))
        made.push(np.full((1, 12), q), np.full((1, 12), v))
        felt.append(made.output(np.full((1, 12), after))[0, 0])
    away = np.array(felt[100:]) - np.array(expected[100:])
    assert np.sqrt(np.mean(away**2)) < 0.08 * np.std(expected[100:])


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


def test_a_share_of_the_robots_starts_at_rest_in_the_default_pose():
    spread = replace(CALM, pose=0.5, velocity=0.5, resting=0.5)
    motion = robots(replace(FLAT, environments=200), spread).motion()
    still = (np.abs(motion.position - DEFAULT_POSE) < 1e-9).all(axis=1)
    assert 70 <= still.sum() <= 130
    assert not motion.velocity[still].any()
    assert (np.abs(motion.velocity[~still]).max(axis=1) > 0).all()


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
