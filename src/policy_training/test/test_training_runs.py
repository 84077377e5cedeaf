import json

import numpy as np
import pytest
import torch
from policy_runner.policies.by_name import load_policy
from policy_training.commands.arguments import train as main
from policy_training.config import TrainingConfig
from policy_training.learning.run_folder import policy_source, read_checkpoint, read_curves

TINY = (
    *('--environments', '4', '--threads', '1', '--set', 'ppo.steps=6', 'ppo.minibatches=2'),
    *('ppo.epochs=1', 'ppo.hidden=[16]', 'checkpoint_every=1'),
)


def run(folder, *arguments, steps=48):
    return main(['-o', str(folder), '--steps', str(steps), *arguments, *TINY])


def test_a_run_leaves_config_curves_checkpoint_events_and_a_policy(tmp_path):
    assert run(tmp_path / 'r') == 0
    assert TrainingConfig.load(tmp_path / 'r' / 'config.yaml').physics.environments == 4
    rows = read_curves(tmp_path / 'r')
    assert [row['iteration'] for row in rows] == [1, 2]
    assert [row['steps'] for row in rows] == [24, 48]
    assert {'reward', 'error/velocity', 'loss/value', 'term/torques'} <= rows[0].keys()
    assert list((tmp_path / 'r' / 'tensorboard').glob('events*'))
    policy = load_policy(str(tmp_path / 'r' / 'policy'))
    assert policy.rate == pytest.approx(50.0)
    assert policy.contract.network.hidden == (16,)
    assert policy.contract.training['steps'] == 48


def test_the_same_seed_gives_the_same_networks(tmp_path):
    actors = []
    for name, seed in (('a', '3'), ('b', '3'), ('c', '4')):
        run(tmp_path / name, '--seed', seed)
        actors.append(read_checkpoint(tmp_path / name)['actor_state_dict']['mlp.0.weight'])
    assert torch.equal(actors[0], actors[1])
    assert not torch.equal(actors[0], actors[2])


def test_a_stopped_run_goes_on_where_its_checkpoint_was(tmp_path):
    run(tmp_path / 'r', steps=48)
    with (tmp_path / 'r' / 'curves.jsonl').open('a') as stream:
        stream.write(json.dumps({'iteration': 3, 'steps': 72}) + '\n{"iterat')
    assert main(['-o', str(tmp_path / 'r'), '--resume', '--steps', '96']) == 0
    rows = read_curves(tmp_path / 'r')
    assert [row['steps'] for row in rows] == [24, 48, 72, 96]
    assert 'reward' in rows[2]
    assert read_checkpoint(tmp_path / 'r')['iteration'] == 4


def test_a_run_does_not_go_on_from_robots_that_were_shown_something_else(tmp_path, capsys):
    run(tmp_path / 'first', '--set', 'command_rate_limit=[1.0, 1.0, 2.0]')
    capsys.readouterr()
    assert run(tmp_path / 'first', '--resume', '--set', 'command_rate_limit=[2.0, 2.0, 2.0]') == 2
    assert 'command_rate_limit [1.0, 1.0, 2.0]' in capsys.readouterr().err


def test_a_run_that_starts_from_another_may_limit_the_rate_of_commands_otherwise(tmp_path):
    run(tmp_path / 'first')
    other = ('--set', 'command_rate_limit=[1.0, 1.0, 2.0]')
    assert run(tmp_path / 'second', '--from', str(tmp_path / 'first'), *other) == 0


def test_a_run_starts_from_anothers_networks_but_counts_its_own_steps(tmp_path):
    run(tmp_path / 'first')
    source = read_checkpoint(tmp_path / 'first')['actor_state_dict']['mlp.0.weight']
    changes = ('ppo.learning_rate=1e-7', 'ppo.std=0.05')
    run(tmp_path / 'second', '--from', str(tmp_path / 'first'), '--set', *changes)
    reached = read_checkpoint(tmp_path / 'second')
    torch.testing.assert_close(
        reached['actor_state_dict']['mlp.0.weight'], source, atol=1e-3, rtol=0
    )
    assert reached['steps'] == 48
    exploration = reached['actor_state_dict']['distribution.std_param']
    torch.testing.assert_close(exploration, torch.full((12,), 0.05), atol=1e-3, rtol=0)


def test_a_run_that_starts_from_another_explores_no_more_than_that_did(tmp_path):
    run(tmp_path / 'first', '--set', 'ppo.std=0.3', 'ppo.learning_rate=1e-7')
    run(tmp_path / 'second', '--from', str(tmp_path / 'first'), '--set', 'ppo.learning_rate=1e-7')
    exploration = read_checkpoint(tmp_path / 'second')['actor_state_dict'][
        'distribution.std_param'
    ]
    torch.testing.assert_close(exploration, torch.full((12,), 0.3), atol=1e-3, rtol=0)


def test_the_policy_of_a_run_is_found_and_names_come_before_folders(tmp_path, monkeypatch):
    (tmp_path / 'policy').mkdir()
    assert policy_source(str(tmp_path)) == str(tmp_path / 'policy')
    assert policy_source(str(tmp_path / 'policy')) == str(tmp_path / 'policy')
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'baseline' / 'policy').mkdir(parents=True)
    assert policy_source('baseline') == 'baseline'


def test_power_by_a_network_is_in_reward_and_curves(tmp_path, network_run):
    power = ('--config', 'pmp', '--power', f'ppn:{network_run}')
    assert run(tmp_path / 'r', *power, '--set', 'power.ramp_from=0', 'power.ramp_to=0') == 0
    rows = read_curves(tmp_path / 'r')
    assert all(np.isfinite(row['power/watts']) for row in rows)
    assert 'term/torques' not in rows[0]
    assert rows[-1]['term/power'] != 0.0
    training = load_policy(str(tmp_path / 'r' / 'policy')).contract.training
    assert training['power_weight'] == 4e-4


def test_checkpoints_hold_no_objects(tmp_path):
    run(tmp_path / 'r')
    state = torch.load(tmp_path / 'r' / 'checkpoint.pt', weights_only=True)
    assert {'actor_state_dict', 'optimizer_state_dict', 'iteration', 'steps'} <= state.keys()


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--config', 'walk'], "'walk'"),
        (['--set', 'ppo.clip=9'], 'ppo.clip: expected 0.01 to 1, there is 9'),
        (['--set', 'ppo.clip'], 'KEY=VALUE'),
        (['--device', 'tpu'], "'tpu'"),
        (['--resume'], 'no run to resume'),
        (['--from', 'nowhere'], 'nowhere'),
        (['--config', 'pmp', '--power', 'ppn:nowhere'], 'nowhere'),
        (['--power', 'magic'], "'magic'"),
    ],
)
def test_bad_input_ends_with_one_line_and_code_2(tmp_path, capsys, arguments, words):
    assert main(['-o', str(tmp_path / 'r'), *arguments, '--environments', '2']) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert '\n' not in error
    assert not (tmp_path / 'r').exists()


def test_a_folder_that_holds_a_run_is_not_overwritten(tmp_path, capsys):
    run(tmp_path / 'r')
    assert run(tmp_path / 'r') == 2
    assert '--resume' in capsys.readouterr().err


@pytest.mark.parametrize('content', [b'', b'PK damaged', b'\x80\x04pickle'])
def test_a_damaged_checkpoint_is_refused_in_one_line(tmp_path, capsys, content):
    run(tmp_path / 'r')
    capsys.readouterr()
    (tmp_path / 'r' / 'checkpoint.pt').write_bytes(content)
    assert main(['-o', str(tmp_path / 'r'), '--resume']) == 2
    error = capsys.readouterr().err.strip()
    assert 'checkpoint.pt' in error
    assert '\n' not in error
