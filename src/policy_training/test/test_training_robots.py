from dataclasses import replace

import numpy as np
import pytest
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.trot import TROTS, ScriptedTrot
from policy_training.config import PhysicsConfig, RandomConfig
from policy_training.environment.robots import BatchDrives, Robots
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
    torque_loop=0.0,
    output=0.0,
    pose=0.0,
    velocity=0.0,
    resting=0.0,
)
FLAT = PhysicsConfig(environments=2, threads=1, noise=0.0, slope=0.0)


def robots(physics=FLAT, spread=CALM, seed=0):
    made = Robots(physics, spread, np.random.default_rng(seed))
    made.start(np.arange(physics.environments))
    return made


PUBLISHED = replace(Plant.load('anymal_c_published'), command_delay=0.0)


def drives(spread=CALM, plant='anymal_c', count=1):
    plant = Plant.load(plant) if isinstance(plant, str) else plant
    return BatchDrives(plant, count, 0.005, spread, np.random.default_rng(0))


def held(made, target, steps=400):
    """Torque on joints that are held at 0 rad, once rotors are at rest."""
    made.start(np.arange(1), np.zeros((1, 12)))
    made.aim(np.full((1, 12), target))
    for _ in range(steps):
        made.push(np.zeros((1, 12)), np.zeros((1, 12)))
    return made.output(np.zeros((1, 12)))[0]


SMOOTH = Plant.load('anymal_c').with_effects(cogging=False)


@pytest.mark.parametrize('plant', [SMOOTH, 'ideal'])
def test_the_position_loop_closes_behind_the_spring_which_does_not_soften_it(plant):
    np.testing.assert_allclose(held(drives(plant=plant), 0.1), 80.0 * 0.1, rtol=1e-3)


def test_a_plant_without_a_spring_keeps_its_rotors():
    light = Plant.load('anymal_c').with_effects(spring=False, rotor_inertia=0.5)
    for plant, inertia in (('ideal', 0.02), (light, 0.5 * 0.0675), ('anymal_c', 0.0675)):
        np.testing.assert_allclose(drives(plant=plant)._drives.inertia, inertia)


@pytest.mark.parametrize('timestep', [0.0005, 0.0025, 0.0075, 0.01])
def test_rotors_follow_their_joints_at_any_time_step(timestep):
    made = BatchDrives(SMOOTH, 1, timestep, CALM, np.random.default_rng(0))
    speed = np.full((1, 12), 2.0)
    for step in range(round(1.0 / timestep)):
        position = speed * timestep * step
        made.aim(position)
        made.push(position, speed)
    np.testing.assert_allclose(made.rotor_speed, speed, rtol=1e-3)


def test_a_joint_that_turns_feels_grease_and_dry_friction():
    made, speed = drives(plant=SMOOTH), np.full((1, 12), 2.0)
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
    step, names, plant = 0.0005, JOINT_NAMES, Plant.load('anymal_c')
    truth = Drives(plant, names, step, 1)
    made = drives(plant=plant)
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


@pytest.mark.parametrize('inertia', [0.016, 0.06, 0.5])  # kg·m², from a shank in the air on
def test_torque_loops_work_as_hard_as_the_simulators_on_free_joints(inertia):
    """Targets are noise at 50 Hz; torque of motors and joints, and shaft power, are compared."""
    step, plant, random = 0.0005, PUBLISHED, np.random.default_rng(1)
    truth, made = Drives(plant, JOINT_NAMES, step, 1), drives(plant=plant)
    truth.reset(np.zeros(12))
    made.start(np.arange(1), np.zeros((1, 12)))
    position, velocity, out = np.zeros(12), np.zeros(12), np.zeros(12)
    own_position, own_velocity = np.zeros((1, 12)), np.zeros((1, 12))
    slow, target = np.zeros(12), np.zeros(12)
    motors, torques, watts = np.zeros((3, 2, 1000, 12))
    p = plant.resolve(JOINT_NAMES)
    weight, viscous = inertia + p['output_inertia'], p['output_viscous']
    for tick in range(1000):
        if tick % 4 == 0:
            slow = 0.8 * slow + 0.15 * random.standard_normal(12)
            target = 0.7 * target + 0.3 * slow
            truth.hold(JointCommand(position=target))
            made.aim(target[None])
        for _ in range(10):
            truth.step(0, position, velocity, out)
            velocity = (velocity + step * out / weight) / (1.0 + step * viscous / weight)
            position = position + step * velocity
            motors[0, tick] += truth.trace.motor[0] / 10
            torques[0, tick] += out / 10
            watts[0, tick] += out * velocity / 10
        motors[1, tick], push = made.push(own_position, own_velocity)
        held = 1.0 + 0.005 * (made.joint_damping + viscous) / weight
        own_velocity = (own_velocity + 0.005 * push / weight) / held
        own_position = own_position + 0.005 * own_velocity
        torques[1, tick] = made.output(own_velocity)
        watts[1, tick] = torques[1, tick] * own_velocity
    powers = np.square(np.abs(np.fft.rfft(motors, axis=1)))
    fast = powers[:, np.fft.rfftfreq(1000, 0.005) > 20.0].sum(axis=1) / powers.sum(axis=1)
    np.testing.assert_allclose(motors[1].std(axis=0), motors[0].std(axis=0), rtol=0.05)
    np.testing.assert_allclose(fast[1].mean(), fast[0].mean(), rtol=0.25)
    for (truth, found), most in ((motors, 0.1), (torques, 0.08), (watts, 0.08)):
        assert np.std(found - truth) < most * np.std(truth)
    assert watts[1].mean() == pytest.approx(watts[0].mean(), rel=0.02)


def test_the_bus_voltage_limits_torque_at_speed_as_in_the_simulator():
    """Rotors turn with their joints; the full torque is asked of them at 7, 9 and 12 rad/s."""
    plant, step = PUBLISHED.with_effects(torque_ripple=False), 0.0005
    p = plant.parameters('LF_KFE')
    for speed in (7.0, 9.0, 12.0):
        truth, made = Drives(plant, JOINT_NAMES, step, 1), drives(plant=plant)
        truth.reset(np.zeros(12))
        made.start(np.arange(1), np.zeros((1, 12)))
        truth.hold(JointCommand(position=np.full(12, 60.0)))
        made.aim(np.full((1, 12), 60.0))
        for tick in range(200):
            position = np.full((1, 12), 0.005 * tick * speed)
            motor, _ = made.push(position, np.full((1, 12), speed))
        out = np.zeros(12)
        for tick in range(2000):
            position = np.full(12, step * tick * speed)
            truth.step(0, position, np.full(12, speed), out)
        np.testing.assert_allclose(motor[0], truth.trace.motor[0], rtol=0.02, atol=0.5)
        droop = p.torque_constant * (p.torque_constant - p.reactance * p.weakening_current)
        most = (p.torque_constant * p.modulation * 48.0 - droop * speed) / p.resistance
        assert motor[0, -1] == pytest.approx(np.clip(most, -80.0, 80.0), rel=0.05, abs=1.0)


def test_the_rewards_network_sees_targets_as_they_were_sent():
    made = robots(replace(FLAT, plant='anymal_c_published'))
    made.step(np.tile(DEFAULT_POSE, (2, 1)))
    position = made.motion().position
    made.step(np.tile(DEFAULT_POSE + 0.2, (2, 1)))
    np.testing.assert_allclose(
        made.substeps[0].position_error, DEFAULT_POSE + 0.2 - position, atol=0.05
    )
    assert np.abs(made.drives.target - DEFAULT_POSE).max() > 0.1


def test_targets_arrive_about_the_plants_delay():
    made = drives(replace(CALM, delay=0.0025), 'anymal_c_published', count=64)
    made.start(np.arange(64), np.zeros((64, 12)))
    made.aim(np.ones((64, 12)))
    arrived = []
    for _ in range(3):
        made.push(np.zeros((64, 12)), np.zeros((64, 12)))
        arrived.append(int(made.target[:, 0].sum()))
    assert arrived[0] == 0
    assert 16 < arrived[1] < 48
    assert arrived[2] == 64


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


def test_a_target_that_is_late_by_more_than_a_policy_step_still_arrives():
    made = drives(plant=replace(PUBLISHED, command_delay=0.025))
    made.start(np.arange(1), np.zeros((1, 12)))
    followed = []
    for step in range(12):
        if step % 4 == 0:
            made.aim(np.full((1, 12), 1.0 + step))
        made.push(np.zeros((1, 12)), np.zeros((1, 12)))
        followed.append(made.target[0, 0])
    assert followed == [0.0] * 5 + [1.0] * 4 + [5.0] * 3


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
                Inputs(
                    position=motion.position[i], gravity=motion.gravity[i], spin=motion.rate[i]
                ),
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
