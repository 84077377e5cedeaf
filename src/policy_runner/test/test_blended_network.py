from dataclasses import replace

import numpy as np
import policy_folders
import pytest
import torch
import yaml
from policy_runner.policies.blended_network import FallbackShare, network_of
from policy_runner.policies.by_name import load_policy
from policy_runner.policies.folder import Fallback, PolicyNetwork, read_folder, write_folder
from policy_runner.policies.observations import CLOCKED, Observation, ObservationTerm
from policy_runner.policies.torchscript import load_torchscript, torch_network, write_torchscript
from wattwalk_core.errors import InputError


def observation(command=(0.0, 0.0, 0.0), away=(0.0, 0.0), tilt=0.0):
    """Observation of a robot that follows a command, but for an error in m/s and a tilt."""
    velocity = np.array([command[0] + away[0], command[1] + away[1], 0.0])
    parts = {term.name: np.zeros(term.size) for term in CLOCKED.terms}
    parts |= {
        'base_velocity': velocity,
        'command': np.array(command),
        'gravity': np.array([tilt, 0.0, -1.0]),
    }
    return CLOCKED.assemble(parts)


def share(config=None, **seen):
    return float(FallbackShare(config or Fallback(), CLOCKED)(observation(**seen)))


def blended(folder, seed=0):
    """A policy folder of two networks of random weights."""
    contract = policy_folders.contract(observation=CLOCKED)
    network = PolicyNetwork(contract.network.hidden, fallback=Fallback())
    contract = replace(contract, network=network)
    write_folder(folder, contract, policy_folders.tensors(contract, scale=0.3, seed=seed))
    return read_folder(folder)


@pytest.mark.parametrize(
    ('seen', 'expected'),
    [
        ({'command': (0.6, 0.0, 0.0)}, 0.0),
        ({'command': (0.0, -0.4, 0.0)}, 0.0),
        ({'command': (0.6, 0.0, 0.0), 'away': (0.2, 0.0)}, 0.0),
        ({'command': (0.6, 0.0, 0.0), 'away': (0.0, 0.35)}, 0.5),  # half way from 0.2 to 0.5
        ({'command': (0.6, 0.0, 0.0), 'away': (0.3, 0.4)}, 1.0),
        ({'command': (0.6, 0.0, 0.0), 'tilt': 0.35 / 2.26}, 0.5),
        ({'command': (0.0, 0.0, 0.0)}, 1.0),  # to stand
        ({'command': (1.0, 0.6, 0.0)}, 1.0),
        ({'command': (1.0, 0.0, 0.465)}, 0.5),  # half way from 0.13 to 0.8
        ({'command': (1.0, 0.0, 0.13)}, 0.0),
    ],
)
def test_the_fallback_acts_out_of_balance_under_mixed_commands_and_to_stand(seen, expected):
    assert share(**seen) == pytest.approx(expected, abs=1e-5)


def test_left_and_right_have_the_same_share():
    for vy, yaw in ((0.1, 0.2), (0.3, -0.4)):
        one = share(command=(0.7, vy, yaw), away=(0.1, 0.2))
        other = share(command=(0.7, -vy, -yaw), away=(0.1, -0.2))
        assert one == pytest.approx(other, abs=1e-6)


def test_actions_are_those_of_the_first_network_in_balance_and_of_the_second_out_of_it(tmp_path):
    contract, tensors = blended(tmp_path / 'p')
    network = network_of(contract, tensors)
    alone = replace(contract, network=PolicyNetwork(contract.network.hidden))
    first = network_of(alone, {k: v for k, v in tensors.items() if k.startswith('layer')})
    second = network_of(
        alone,
        {k.removeprefix('fallback.'): v for k, v in tensors.items() if k.startswith('fallback.')},
    )
    calm = observation(command=(0.6, 0.0, 0.0))
    lost = observation(command=(0.6, 0.0, 0.0), away=(0.0, 0.9))
    between = observation(command=(0.6, 0.0, 0.0), away=(0.0, 0.35))
    np.testing.assert_allclose(network(calm), first(calm), atol=1e-6)
    np.testing.assert_allclose(network(lost), second(lost), atol=1e-6)
    mean = 0.5 * (first(between) + second(between))
    np.testing.assert_allclose(network(between), mean, atol=1e-5)
    assert np.abs(first(lost) - second(lost)).max() > 0.1


def test_many_robots_at_once_and_one_alone_get_the_same_actions(tmp_path):
    network = network_of(*blended(tmp_path / 'p'))
    seen = np.random.default_rng(1).standard_normal((30, CLOCKED.size)).astype(np.float32)
    np.testing.assert_allclose(network(seen), [network(row) for row in seen], atol=1e-5)


def test_the_torch_module_and_its_torchscript_act_as_numpy_does(tmp_path):
    contract, tensors = blended(tmp_path / 'p')
    seen = np.random.default_rng(2).standard_normal((200, CLOCKED.size)).astype(np.float32)
    part = CLOCKED.part('command')
    seen[:50, part] = 0.0
    seen[50:100, part.start + 1 : part.stop] = 0.0
    wanted = network_of(contract, tensors)(seen)
    module = torch_network(contract, tensors)
    np.testing.assert_allclose(module(torch.from_numpy(seen)).numpy(), wanted, atol=1e-5)
    write_torchscript(tmp_path / 'p', tmp_path / 'p.pt')
    loaded = load_torchscript(tmp_path / 'p.pt', trust_code=True)
    assert loaded.contract == contract
    np.testing.assert_allclose(loaded._network(seen[7]), wanted[7], atol=1e-5)


def test_a_folder_of_two_networks_is_a_policy_like_any_other(tmp_path):
    blended(tmp_path / 'p')
    assert load_policy(str(tmp_path / 'p')).contract.network.fallback == Fallback()


def test_a_folder_of_one_network_does_not_mention_a_fallback(tmp_path):
    policy_folders.save(tmp_path / 'p')
    assert 'fallback' not in (tmp_path / 'p' / 'policy.yaml').read_text()


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'onset': 0.6}, 'onset is 0.6; it must be below full = 0.5'),
        ({'mixed': 0.1}, 'one_axis is 0.13; it must be below mixed = 0.1'),
        ({'largest': [1.0, 0.6]}, 'largest'),
    ],
)
def test_thresholds_that_contradict_each_other_are_refused(tmp_path, change, words):
    blended(tmp_path / 'p')
    card = tmp_path / 'p' / 'policy.yaml'
    content = yaml.safe_load(card.read_text())
    content['network']['fallback'] |= change
    card.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError) as error:
        read_folder(tmp_path / 'p')
    assert words in str(error.value)
    assert '\n' not in str(error.value)


def test_weights_without_those_of_the_fallback_are_refused(tmp_path):
    contract, tensors = blended(tmp_path / 'p')
    del tensors['fallback.layer1.bias']
    with pytest.raises(InputError, match=r"lacks 'fallback\.layer1\.bias'"):
        write_folder(tmp_path / 'q', contract, tensors)


def test_a_fallback_needs_to_observe_velocity_gravity_and_command():
    blind = Observation(tuple(t for t in CLOCKED.terms if t.name != 'gravity'))
    contract = policy_folders.contract(observation=blind)
    with pytest.raises(InputError, match="observation lacks 'gravity'"):
        replace(contract, network=PolicyNetwork((4,), fallback=Fallback()))
    assert ObservationTerm('gravity') in CLOCKED.terms
