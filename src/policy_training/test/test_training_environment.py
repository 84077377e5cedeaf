import numpy as np
import pytest
import torch
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.learned import LearnedPolicy
from policy_runner.policies.observations import STANDARD
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.power_source import PlantPower, PredictedPower, power_source
from policy_training.environment.robots import Substep
from policy_training.learning.learner import TorchEnvironment
from policy_training.learning.training import export_policy
from power_estimator.batch.power import BatchPower
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES
from windowed_network import WindowedNetwork

QUIET = {
    'noise.base_velocity': 0.0,
    'noise.angular_velocity': 0.0,
    'noise.gravity': 0.0,
    'noise.joint_position': 0.0,
    'noise.joint_velocity': 0.0,
}


class Meter:
    """A power model that counts what it is asked and draws 10 W a drive."""

    def __init__(self, robots):
        self.ready = np.ones(robots, bool)
        self.forgotten = []
        self.shapes = []

    def reset(self, ids):
        self.forgotten.append(ids.tolist())

    def step(self, position_error, torque, speed):
        self.shapes.append(position_error.shape)
        return np.full((len(speed), 12), 10.0, np.float32)


def test_training_and_the_robot_see_and_do_the_same(tiny, tmp_path):
    environment = WalkingEnvironment(tiny.with_values(QUIET))
    random = np.random.default_rng(0)
    first, last = (
        random.normal(0, 0.1, shape).astype(np.float32) for shape in ((16, 48), (12, 16))
    )
    tensors = {'layer0.weight': first, 'layer0.bias': np.zeros(16, np.float32)}
    tensors |= {'layer1.weight': last, 'layer1.bias': np.zeros(12, np.float32)}
    export_policy(tmp_path / 'p', tensors, tiny, environment.observation, {})
    policy = LearnedPolicy.load(tmp_path / 'p')
    policy.take_over()
    for index in range(4):
        seen = torch.from_numpy(environment.observe() @ first.T)
        action = torch.nn.functional.elu(seen).numpy() @ last.T
        motion, inputs = environment.motion, Inputs()
        inputs.position, inputs.velocity = motion.position[2], motion.joint_velocity[2]
        inputs.gravity, inputs.spin = motion.gravity[2], motion.rate[2]
        command = environment.commands.values[2].copy()
        targets = policy.step(0.02 * index, command, inputs, motion.velocity[2])
        environment.step(action)
        aimed = environment.robots.drives.commanded[2]
        np.testing.assert_allclose(targets, aimed, atol=1e-5)


def shakes(environment):
    """Errors of the observations, step by step [200, N, 48]."""
    off = []
    for _ in range(200):
        environment.step(np.zeros((environment.count, 12)))
        off.append(environment.observe() - environment.state()[:, :48])
    return np.array(off)


def test_noise_stays_within_its_levels(tiny):
    environment = WalkingEnvironment(tiny)
    spread = np.abs(shakes(environment)).max(axis=(0, 1))
    levels = {'base_velocity': 0.1 * 2.0, 'joint_velocity': 1.5 * 0.05, 'command': 0.0}
    for name, level in levels.items():
        assert spread[STANDARD.part(name)].max() <= 1.1 * level + 1e-5
        assert spread[STANDARD.part(name)].max() >= 0.8 * level


def test_the_power_term_is_weight_times_watts_after_the_mask(tiny):
    meter = Meter(4)
    config = tiny.with_values({'power.model': 'x', 'power.weight': 1e-3, 'power.masked': 3})
    environment = WalkingEnvironment(config, power=PredictedPower(meter))
    environment.age[:] = 0
    found = [environment.step(np.zeros((4, 12))).log['term/power'] for _ in range(5)]
    assert found[:3] == [0.0, 0.0, 0.0]
    assert found[3:] == pytest.approx([-1e-3 * 120.0 * 0.02] * 2)
    assert meter.shapes == [(4, 4, 12)] * 5
    assert meter.forgotten[0] == [0, 1, 2, 3]


def test_a_start_makes_the_power_model_forget_that_robot_alone(tiny):
    meter = Meter(4)
    config = tiny.with_values({'power.model': 'x', 'power.weight': 1e-3})
    environment = WalkingEnvironment(config, power=PredictedPower(meter))
    environment.age[:] = 0
    environment.age[2] = environment.longest - 1
    outcome = environment.step(np.zeros((4, 12)))
    assert outcome.done.tolist() == [False, False, True, False]
    assert outcome.timed_out.tolist() == [False, False, True, False]
    assert meter.forgotten[1:] == [[2]]
    assert environment.age.tolist() == [1, 1, 0, 1]


def test_a_fall_ends_the_episode_without_a_time_out(tiny):
    environment = WalkingEnvironment(tiny.with_values({'random.velocity': 0.0}))
    environment.age[:] = 0
    limp = np.tile(np.array([0.0, 2.0, -4.0] * 2 + [0.0, -2.0, 4.0] * 2), (4, 1))
    done = np.zeros(4, bool)
    for _ in range(80):
        outcome = environment.step(limp)
        assert not outcome.timed_out.any()
        done |= outcome.done
    assert done.all()


def test_commands_fill_their_range_and_some_stand(tiny):
    changes = {'physics.environments': 400, 'commands.standing': 0.1, 'commands.single': 0.3}
    values = WalkingEnvironment(tiny.with_values(changes)).commands.values
    assert np.abs(values).max(axis=0) == pytest.approx([1.0, 1.0, 1.5], rel=0.05)
    assert (values == 0.0).all(axis=1).mean() == pytest.approx(0.1, abs=0.05)


def test_steps_are_due_where_the_command_asks_for_motion(tiny):
    environment = WalkingEnvironment(tiny.with_values({'random.push': 0.0}))
    environment.age[:] = 0
    environment.commands.values[:] = [[0.5, 0, 0], [0, 0, 0], [0, 0, 0.2], [0, 0.05, 0]]
    environment.step(np.zeros((4, 12)))
    assert environment.walking.tolist() == [True, False, True, False]


def test_steps_are_due_while_a_limited_command_crosses_zero_on_its_way(tiny):
    changes = {'random.push': 0.0, 'command_rate_limit': (1.0, 1.0, 2.0)}
    environment = WalkingEnvironment(tiny.with_values(changes))
    environment.age[:] = 0
    environment.commands.values[:] = [-0.5, 0.0, 0.0]
    environment.limiter.values[:] = [0.03, 0.0, 0.0]
    for _ in range(3):  # 0.01, −0.01, −0.03 m/s
        environment.step(np.zeros((4, 12)))
        assert environment.walking.all()


def test_a_command_comes_gradually_and_velocity_is_judged_by_what_has_come(tiny):
    limits = {'command_rate_limit': (1.0, 1.0, 2.0)}
    still = {'random.velocity': 0.0, 'random.push': 0.0, 'random.pose': 0.0}
    config = tiny.with_values({**still, **limits})
    environment = WalkingEnvironment(config)
    environment.age[:] = 0
    environment.commands.values[:] = [0.6, -0.3, 1.0]
    environment.limiter.values[:] = 0.0
    away = [environment.step(np.zeros((4, 12))).log['error/vx'] for _ in range(5)]
    np.testing.assert_allclose(environment.limiter.values[0], [0.1, -0.1, 0.2])
    np.testing.assert_allclose(away, 0.02 * np.arange(5), atol=0.02)
    environment.age[1] = environment.longest - 1
    environment.step(np.zeros((4, 12)))
    assert np.abs(environment.limiter.values[1]).max() <= 0.04, 'a start begins from standing'
    np.testing.assert_allclose(environment.limiter.values[0], [0.12, -0.12, 0.24])


@pytest.mark.parametrize('model', ['carried', 'windowed'])
def test_a_network_predicts_watts_for_every_drive(tiny, network_run, model):
    power = PredictedPower.load(f'ppn:{network_run}', 4)
    if model == 'windowed':
        power = PredictedPower(WindowedNetwork(network_run, 4))
    environment = WalkingEnvironment(tiny)
    environment.robots.step(np.zeros((4, 12)))
    for _ in range(6):
        environment.step(np.zeros((4, 12)))
        watts = power.drives(environment.robots.substeps)
    assert watts.shape == (4, 12)
    assert (watts != 0.0).all()


def test_the_plant_itself_can_tell_the_watts_of_its_drives(tiny):
    assert power_source(tiny) is None
    tiny = tiny.with_values(QUIET | {'rewards.only_positive': False})
    config = tiny.with_values({'power.model': 'plant', 'power.weight': 1e-3, 'power.masked': 0})
    environment = WalkingEnvironment(tiny)
    metered = WalkingEnvironment(config, power=power_source(config))
    for _ in range(3):
        plain = environment.step(np.zeros((4, 12)))
        outcome = metered.step(np.zeros((4, 12)))
    meter = PlantPower(Plant.load('anymal_c'), 4, 0.005)
    watts = meter.drives(metered.robots.substeps)
    np.testing.assert_allclose(metered.watts, watts)
    per_second = (plain.reward - outcome.reward) / metered.config.step_time
    np.testing.assert_allclose(per_second, 1e-3 * watts.sum(axis=1), rtol=1e-6)


def test_carried_and_windowed_forms_agree_on_motion_without_a_start(tiny, network_run):
    environment = WalkingEnvironment(tiny.with_values({'random.velocity': 0.0}))
    rest = np.zeros((4, 80, 12), np.float32)
    network = BatchPower.load(f'ppn:{network_run}', JOINT_NAMES, 4)
    network.step(rest, rest, rest)
    carried = PredictedPower(network)
    windowed = PredictedPower(WindowedNetwork(network_run, 4))
    for _ in range(10):
        environment.robots.step(np.zeros((4, 12)))
        one = carried.drives(environment.robots.substeps)
        other = windowed.drives(environment.robots.substeps)
    np.testing.assert_allclose(one, other, atol=0.05 * np.abs(one).max())


def test_mirrored_robots_under_mirrored_actions_stay_mirror_images(tiny):
    calm = {
        f'random.{name}': 0.0
        for name in (
            'payload',
            'delay',
            'stiffness',
            'drive_friction',
            'inertia',
            'torque_loop',
            'output',
            'velocity',
            'pose',
            'resting',
        )
    }
    even = {'random.friction_high': 0.5}
    environment = WalkingEnvironment(tiny.with_values({**QUIET, **calm, **even}))
    environment.commands.values[:] = 0.0
    random = np.random.default_rng(2)
    other = [JOINT_NAMES.index({'L': 'R', 'R': 'L'}[name[0]] + name[1:]) for name in JOINT_NAMES]
    sign = np.array([-1.0 if name.endswith('HAA') else 1.0 for name in JOINT_NAMES])
    for _ in range(8):
        action = random.normal(0, 0.3, 12)
        image = sign * action[other]
        environment.step(np.stack([action, image, action, image]))
    seen, mirrored = environment.observe()[:2]
    joints = seen[12:24]
    # the base's mass and the legs' products of inertia are not quite symmetric
    for part in (slice(12, 24), slice(24, 36), slice(36, 48)):
        np.testing.assert_allclose(sign * seen[part][other], mirrored[part], atol=0.05)
    body = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    np.testing.assert_allclose(seen[:9] * body, mirrored[:9], atol=0.05)
    assert np.abs(joints - mirrored[12:24]).max() > 0.05


def test_the_state_is_the_observation_without_noise_the_feet_and_the_command_to_come(tiny):
    environment = WalkingEnvironment(tiny)
    calm = WalkingEnvironment(tiny.with_values(QUIET))
    for _ in range(30):
        environment.step(np.zeros((4, 12)))
        calm.step(np.zeros((4, 12)))
    state = environment.state()
    assert state.shape == (4, 59)
    np.testing.assert_allclose(state[:, 56:], environment.commands.values, rtol=1e-6)
    np.testing.assert_allclose(state[:, :48], calm.observe(), atol=1e-6)
    half = 0.5 * 9.81 * environment.robots.mass[:, None]
    np.testing.assert_allclose(state[:, 48:52], environment.motion.foot_force / half, rtol=1e-6)


def test_a_new_command_ends_an_episode_for_the_learner_but_not_for_the_robot(tiny):
    config = tiny.with_values({'commands.period': 0.1, 'random.push': 0.0})
    environment = TorchEnvironment(WalkingEnvironment(config), 'cpu')
    environment.walking.age[:] = 0
    ends = []
    for _ in range(10):
        _, _, dones, extras = environment.step(torch.zeros(4, 12))
        ends.append((bool(dones.all()), bool(extras['time_outs'].all())))
    assert ends == [((index + 1) % 5 == 0,) * 2 for index in range(10)]
    assert (environment.walking.age == 10).all()


def test_a_push_is_seen_at_once(tiny):
    environment = WalkingEnvironment(tiny.with_values({'random.push_period': 0.2}))
    environment.age[:] = 8
    before = environment.step(np.zeros((4, 12))) and environment.motion.velocity.copy()
    after = environment.step(np.zeros((4, 12)))
    assert after.disturbed.all()
    assert np.abs(environment.motion.velocity - before)[:, :2].max() > 0.2


def test_a_push_that_is_switched_off_disturbs_nobody(tiny):
    environment = WalkingEnvironment(
        tiny.with_values({'random.push': 0.0, 'random.push_period': 0.1})
    )
    environment.age[:] = 4
    assert not environment.step(np.zeros((environment.count, 12))).disturbed.any()


def test_a_fall_costs_once_and_is_not_cut_off_at_zero(tiny):
    environment = WalkingEnvironment(tiny.with_values({'rewards.termination': -4.0}))
    limp = np.tile(np.array([0.0, 2.0, -4.0] * 2 + [0.0, -2.0, 4.0] * 2), (4, 1))
    falls = 0
    for _ in range(80):
        outcome = environment.step(limp)
        fell = outcome.done & ~outcome.timed_out
        falls += int(fell.sum())
        assert (outcome.reward[fell] < -3.9).all()
        assert (outcome.reward[~fell] >= 0.0).all()
    assert falls


def test_the_plants_power_of_a_still_motor_is_copper_loss_and_idle():
    plant = Plant.load('anymal_c')
    torque, still = np.full((1, 12), 20.0), np.zeros((1, 12))

    def watts(motor):
        step = Substep(still, still, still, motor, still)
        return PlantPower(plant, 1, 0.005).drives([step, step])

    loaded, idle = watts(torque), watts(still)
    resistance = plant.resolve(['LF_HAA'])['resistance'][0]
    constant = plant.resolve(['LF_HAA'])['torque_constant'][0]
    assert (idle > 0.0).all()
    assert loaded[0, 0] - idle[0, 0] > 0.9 * resistance * (20.0 / constant) ** 2
    assert np.allclose(watts(-torque), loaded), 'a still motor loses the same either way'


def test_a_robots_power_does_not_depend_on_its_neighbours():
    plant, random = Plant.load('anymal_c'), np.random.default_rng(0)
    motor, speed = random.normal(0, 20, (3, 12)), random.normal(0, 3, (3, 12))
    many = PlantPower(plant, 3, 0.005).drives([Substep(motor, motor, speed, motor, speed)])
    one = PlantPower(plant, 1, 0.005).drives(
        [Substep(*(x[1:2] for x in (motor, motor, speed, motor, speed)))]
    )
    np.testing.assert_allclose(many[1], one[0], rtol=1e-9)
