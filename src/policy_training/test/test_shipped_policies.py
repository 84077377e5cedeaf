import pytest
from policy_runner.policies.by_name import SHIPPED, load_policy, shipped
from policy_runner.policies.folder import read_folder
from policy_runner.policies.learned import Perceptron
from policy_training.commands.arguments import export
from policy_training.config import TrainingConfig
from policy_training.evaluation.evaluate import score_walk
from policy_training.evaluation.measured_walk import idle_power, measure_walk
from policy_training.evaluation.robustness import LIMITS, RobustnessConfig, evaluate_robustness
from policy_training.evaluation.tasks import TASKS
from sim_bridge.plant.parameters import Plant

FORWARD = next(task for task in TASKS if task.name == 'forward')
PLANT = Plant.load('anymal_c_published')


def test_the_papers_pair_and_an_economical_policy_are_shipped():
    assert shipped() == ('baseline', 'economy', 'pmp')


@pytest.mark.parametrize('name', shipped())
def test_a_shipped_policy_comes_with_the_config_that_trained_it(name):
    config = TrainingConfig.load(SHIPPED / name / 'training.yaml')
    assert config.physics.plant == PLANT.name
    assert config.observation == read_folder(SHIPPED / name)[0].observation
    own = TrainingConfig.load(name)
    assert config.rewards == own.rewards
    assert config.power.weight == own.power.weight


def test_the_economical_policy_follows_commands_on_rough_ground_under_pushes():
    contract, tensors = read_folder(SHIPPED / 'economy')
    network = Perceptron(tensors, contract.network.activation)
    trials = evaluate_robustness(
        contract, network, RobustnessConfig(robots=24, seconds=10.0, seed=77)
    )
    assert trials.falls <= 1
    for axis, most in zip(('vx', 'vy', 'yaw'), LIMITS, strict=True):
        assert trials.mean_error[axis] < most


@pytest.mark.parametrize('task', TASKS, ids=lambda task: task.name)
@pytest.mark.parametrize('name', shipped())
def test_a_shipped_policy_keeps_its_speed_on_what_the_sensors_read(name, task):
    walk = measure_walk(name, task, PLANT, duration=6.0, seed=5)
    assert walk.falls == 0
    reached = walk.velocity[walk.steady].mean(axis=0)
    assert reached == pytest.approx(task.command, abs=0.12 if name == 'economy' else 0.25)


@pytest.mark.parametrize('name', shipped())
def test_a_shipped_policy_walks_from_perfect_rest_without_noise(name):
    walk = measure_walk(name, FORWARD, PLANT, duration=5.0, seed=5, ideal=True)
    assert walk.falls == 0
    assert walk.velocity[walk.steady, 0].mean() == pytest.approx(0.6, abs=0.25)


@pytest.mark.parametrize('name', shipped())
def test_a_shipped_policy_walks_on_lighter_joints_without_a_torque_loop(name):
    walk = measure_walk(name, FORWARD, Plant.load('anymal_c'), duration=6.0, seed=5)
    assert walk.falls == 0
    assert walk.velocity[walk.steady, 0].mean() > 0.3


def test_the_pmp_and_the_economical_policy_save_per_metre_and_in_the_knees():
    idle, found = idle_power(PLANT), {}
    for name in shipped():
        walk = measure_walk(name, FORWARD, PLANT, duration=6.0, seed=5)
        found[name] = score_walk(walk, idle, {})
    base = found['baseline']
    for name in ('pmp', 'economy'):
        assert found[name]['cost_of_transport'] < 0.92 * base['cost_of_transport']
        assert found[name]['power_w']['KFE'] < 0.8 * base['power_w']['KFE']


def test_a_shipped_policy_is_exported_by_name_with_its_contract(tmp_path, capsys):
    assert export(['pmp', '-o', str(tmp_path / 'pmp.pt')]) == 0
    assert '--policy' in capsys.readouterr().out
    assert load_policy(str(tmp_path / 'pmp.pt'), trust_code=True).rate == 50.0


def test_a_scripted_gait_has_no_network_to_export(tmp_path, capsys):
    assert export(['trot', '-o', str(tmp_path / 'trot.pt')]) == 2
    assert "'trot' is a scripted trot" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
