from dataclasses import replace

import pytest
from policy_training.config import CONFIGS, PowerConfig, TrainingConfig
from wattwalk_core.errors import InputError


@pytest.mark.parametrize('path', sorted(CONFIGS.glob('*.yaml')), ids=lambda path: path.stem)
def test_shipped_configs_load_by_name(path):
    config = TrainingConfig.load(path.stem)
    assert config.name == path.stem


def test_the_pmp_is_the_baseline_without_torque_and_with_power():
    baseline = TrainingConfig.load('baseline')
    assert baseline.rewards.torques == -2.5e-5
    config = TrainingConfig.load('pmp')
    assert config.power.weight == 4e-4
    same = config.with_values({'rewards.torques': -2.5e-5, 'name': 'baseline', 'steps': 80e6})
    assert replace(same, power=PowerConfig()) == baseline


def test_the_baseline_is_what_legged_gym_gives():
    baseline = TrainingConfig.load('baseline')
    assert baseline == TrainingConfig()
    assert (baseline.rewards.tracking_sigma, baseline.rewards.only_positive) == (0.25, True)
    assert baseline.observation.size == 48


def test_a_config_is_read_back_as_it_was_saved(tmp_path, tiny):
    tiny.save(tmp_path / 'c.yaml')
    assert TrainingConfig.load(tmp_path / 'c.yaml') == tiny


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('ppo: {clip: 9}', 'ppo.clip: expected 0.01 to 1, there is 9'),
        ('physics: {timestep: 1}', 'physics.timestep: expected 0.0005 to 0.01 s, there is 1'),
        ('physics: {speed: 1}', "physics: unknown key 'speed'; there can be environments"),
        ('rewards: 5', 'rewards: expected keys with values, there is 5'),
        ('power: {weight: 0.1}', 'power: weight is 0.1 without power.model'),
        ('random: {friction_low: 2.0}', 'random: friction_low is 2.0'),
        (
            'ppo: {hidden: [0]}',
            r'ppo.hidden\[0\]: expected a whole number from 1 to 4096, there is 0',
        ),
        ('nonsense: 1', "unknown key 'nonsense'"),
        ('seed: -3', 'seed: expected .* there is -3'),
        ('- a list', 'expected keys with values'),
        ('a: [', 'no valid YAML'),
    ],
)
def test_a_bad_config_is_refused_with_its_value_in_one_line(tmp_path, text, words):
    (tmp_path / 'c.yaml').write_text(text)
    with pytest.raises(InputError, match=words) as error:
        TrainingConfig.load(tmp_path / 'c.yaml')
    assert '\n' not in str(error.value)


def test_keys_by_their_former_names_are_read(tiny):
    changed = tiny.with_values({'rewards.vertical': -1.0, 'command_slew': [1.0, 1.0, 2.0]})
    assert changed.rewards.lin_vel_z == -1.0
    assert changed.command_rate_limit == (1.0, 1.0, 2.0)


@pytest.mark.parametrize('name', ['ppo', 'ppo.nothing', 'nothing.clip', 'nothing'])
def test_changes_name_what_there_is(tiny, name):
    with pytest.raises(InputError, match=f"no '{name}'"):
        tiny.with_values({name: 1})


def test_values_that_only_fit_together_may_be_changed_together():
    config = TrainingConfig.load('pmp').with_values({'power.ramp_to': 2.0, 'power.ramp_from': 1.0})
    assert (config.power.ramp_from, config.power.ramp_to) == (1.0, 2.0)


def test_the_power_weight_ramps_in_over_policy_steps():
    power = PowerConfig(model='x', weight=4e-4, ramp_from=1e6, ramp_to=3e6)
    weights = [power.weight_at(steps) for steps in (0, 1e6, 2e6, 3e6, 9e6)]
    assert weights == pytest.approx([0.0, 0.0, 2e-4, 4e-4, 4e-4])
    assert PowerConfig(model='x', weight=4e-4).weight_at(0) == 4e-4
