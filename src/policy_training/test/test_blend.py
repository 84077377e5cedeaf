from dataclasses import replace

import numpy as np
import policy_folders
import pytest
from policy_runner.policies.blended_network import network_of
from policy_runner.policies.by_name import learned_folder
from policy_runner.policies.folder import read_folder
from policy_runner.policies.observations import CLOCKED
from policy_training.commands.arguments import blend as main
from policy_training.learning.run_folder import policy_source
from wattwalk_core.errors import InputError

SCALED = replace(
    CLOCKED,
    terms=tuple(replace(t, scale=1.0) if t.name == 'joint_velocity' else t for t in CLOCKED.terms),
)


def policy(folder, scale=1.0, **changes):
    return policy_folders.save(folder, scale=scale, **({'observation': CLOCKED} | changes))


def test_a_blend_holds_the_networks_of_both(tmp_path, capsys):
    calm, sturdy = policy(tmp_path / 'calm', 1.0), policy(tmp_path / 'sturdy', 2.0, name='sturdy')
    assert main([str(calm), str(sturdy), '-o', str(tmp_path / 'both'), '--onset', '0.3']) == 0
    contract, tensors = read_folder(tmp_path / 'both')
    assert contract.name == 'both'
    assert contract.network.fallback.onset == 0.3
    assert contract.training['fallback']['name'] == 'sturdy'
    for folder, prefix in ((calm, ''), (sturdy, 'fallback.')):
        for name, values in read_folder(folder)[1].items():
            np.testing.assert_array_equal(tensors[prefix + name], values)
    assert 'next: ros2 run policy_training evaluate' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('other', 'words'),
    [
        ({'rate': 100.0}, 'differ in rate'),
        ({'observation': SCALED}, "differ in observation 'joint_velocity'"),
        ({'hidden': (8,)}, 'differ in network'),
    ],
)
def test_policies_that_do_not_match_are_refused(tmp_path, capsys, other, words):
    calm, sturdy = policy(tmp_path / 'calm'), policy(tmp_path / 'sturdy', **other)
    assert main([str(calm), str(sturdy), '-o', str(tmp_path / 'both')]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert '\n' not in error
    assert not (tmp_path / 'both').exists()


def test_a_policy_without_a_gait_clock_walks_as_before_beside_one_that_has_it(tmp_path):
    plain = policy(tmp_path / 'plain', observation=policy_folders.STANDARD)
    clocked = policy(tmp_path / 'clocked', 2.0)
    assert main([str(plain), str(clocked), '-o', str(tmp_path / 'both')]) == 0
    contract, tensors = read_folder(tmp_path / 'both')
    assert contract.observation == CLOCKED
    own, weights = read_folder(plain)
    random = np.random.default_rng(0)
    values = {
        name: random.standard_normal((5, CLOCKED.part(name).stop - CLOCKED.part(name).start))
        for name in CLOCKED.names
    }
    values['command'] = np.tile([0.6, 0.0, 0.0], (5, 1))
    values['base_velocity'] = values['command'].copy()
    values['gravity'] = np.tile([0.0, 0.0, -1.0], (5, 1))
    np.testing.assert_allclose(
        network_of(contract, tensors)(CLOCKED.assemble(values)),
        network_of(own, weights)(own.observation.assemble(values)),
        atol=1e-5,
    )
    assert main([str(clocked), str(plain), '-o', str(tmp_path / 'turned')]) == 0
    assert read_folder(tmp_path / 'turned')[0].observation == CLOCKED


def test_a_blend_is_no_part_of_another(tmp_path, capsys):
    calm = policy(tmp_path / 'calm')
    assert main([str(calm), str(calm), '-o', str(tmp_path / 'both')]) == 0
    assert main([str(tmp_path / 'both'), str(calm), '-o', str(tmp_path / 'more')]) == 2
    assert 'has a fallback already' in capsys.readouterr().err


def test_the_policy_of_a_run_is_found_and_names_come_before_folders(tmp_path, monkeypatch):
    (tmp_path / 'policy').mkdir()
    assert policy_source(str(tmp_path)) == str(tmp_path / 'policy')
    assert policy_source(str(tmp_path / 'policy')) == str(tmp_path / 'policy')
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'baseline' / 'policy').mkdir(parents=True)
    assert policy_source('baseline') == 'baseline'
    assert (learned_folder('baseline') / 'weights.safetensors').exists()
    with pytest.raises(InputError, match=r"'trot' is a scripted trot; .* are baseline"):
        learned_folder('trot')
