from dataclasses import replace

import numpy as np
import policy_folders
import pytest
import torch
import yaml
from policy_runner.policies.by_name import load_policy
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.learned import LearnedPolicy
from policy_runner.policies.observations import STANDARD
from policy_runner.policies.torchscript import write_torchscript
from policy_runner.supervisor.supervisor import Handover
from wattwalk_core.anymal import DEFAULT_POSE, JOINT_NAMES
from wattwalk_core.errors import InputError

VELOCITY = np.array([0.3, -0.1, 0.02])
COMMAND = np.array([0.5, -0.2, 0.8])


@pytest.fixture
def inputs():
    found = Inputs()
    random = np.random.default_rng(4)
    found.position = DEFAULT_POSE + random.normal(0, 0.1, 12)
    found.velocity = random.normal(0, 1.0, 12)
    found.gravity = np.array([0.1, 0.0, -0.995])
    found.spin = np.array([0.1, 0.2, 0.3])
    return found


class Recorder:
    """A network that remembers what it was shown and answers with a constant."""

    def __init__(self, answer=0.0):
        self.seen = []
        self.answer = np.full(12, answer, np.float32)

    def __call__(self, observation):
        self.seen.append(observation)
        return self.answer


def test_the_observation_is_that_of_legged_gym_with_its_scales(inputs):
    network = Recorder(0.25)
    policy = LearnedPolicy(policy_folders.contract(), network)
    policy.take_over()
    policy.step(0.0, COMMAND, inputs, VELOCITY)
    targets = policy.step(0.02, COMMAND, inputs, VELOCITY)
    expected = np.concatenate(
        [
            2.0 * VELOCITY,
            0.25 * inputs.spin,
            inputs.gravity,
            COMMAND * [2.0, 2.0, 0.25],
            inputs.position - DEFAULT_POSE,
            0.05 * inputs.velocity,
            np.full(12, 0.25),
        ]
    )
    np.testing.assert_allclose(network.seen[1], expected, rtol=1e-6)
    np.testing.assert_array_equal(network.seen[0][36:], 0.0)
    np.testing.assert_allclose(targets, DEFAULT_POSE + 0.5 * 0.25)


def test_a_policy_with_another_joint_order_moves_the_same_joints(tmp_path, inputs):
    order = np.random.default_rng(1).permutation(12)
    straight, shuffled = (
        policy_folders.contract(),
        policy_folders.contract(tuple(JOINT_NAMES[i] for i in order)),
    )
    network = Recorder()
    answer = np.linspace(-1, 1, 12).astype(np.float32)
    network.answer = answer
    one = LearnedPolicy(straight, network)
    one.take_over()
    expected = one.step(0.0, COMMAND, inputs, VELOCITY)
    other_network = Recorder()
    other_network.answer = answer[order]
    other = LearnedPolicy(shuffled, other_network)
    other.take_over()
    np.testing.assert_allclose(other.step(0.0, COMMAND, inputs, VELOCITY), expected)
    part = straight.observation.part('joint_velocity')
    np.testing.assert_allclose(other_network.seen[0][part], network.seen[0][part][order])


def test_it_stands_up_from_the_measured_pose_without_a_jump(tmp_path, inputs):
    policy = load_policy(str(policy_folders.save(tmp_path / 'p')))
    policy.reset()
    times = np.arange(0.0, 2.0, 0.02)
    targets = np.array([policy.step(t, np.zeros(3), inputs, None) for t in times])
    np.testing.assert_allclose(targets[0], inputs.position)
    np.testing.assert_allclose(targets[-1], DEFAULT_POSE, atol=1e-6)
    assert np.abs(np.diff(targets, axis=0)).max() < 0.02


def test_asked_four_times_as_often_it_acts_at_its_own_rate(inputs):
    network = Recorder()
    policy = LearnedPolicy(policy_folders.contract(), network)
    policy.take_over()
    for index in range(200):
        policy.step(0.005 * index, COMMAND, inputs, VELOCITY)
    assert len(network.seen) == 50


def test_after_a_pause_it_goes_on_at_its_rate_without_catching_up(inputs):
    network = Recorder()
    policy = LearnedPolicy(policy_folders.contract(), network)
    policy.take_over()
    for time in (0.0, 0.02, 1.0, 1.005, 1.01, 1.02):
        policy.step(time, COMMAND, inputs, VELOCITY)
    assert len(network.seen) == 4


def test_reset_forgets_the_last_action(inputs):
    network = Recorder(1.0)
    policy = LearnedPolicy(policy_folders.contract(), network)
    policy.take_over()
    policy.step(0.0, COMMAND, inputs, VELOCITY)
    policy.take_over()
    policy.step(5.0, COMMAND, inputs, VELOCITY)
    np.testing.assert_array_equal(network.seen[1][36:], 0.0)


def test_a_command_is_shown_no_faster_than_the_policy_is_used_to(inputs):
    network = Recorder()
    slow = replace(STANDARD, command_rate_limit=(1.0, 1.0, 2.0))
    policy = LearnedPolicy(policy_folders.contract(observation=slow), network)
    policy.take_over()
    for step in range(40):
        policy.step(0.02 * step, COMMAND, inputs, VELOCITY)
    for step in range(40, 50):
        policy.step(0.02 * step, np.zeros(3), inputs, VELOCITY)
    seen = np.array(network.seen)[:, STANDARD.part('command')] / [2.0, 2.0, 0.25]
    np.testing.assert_allclose(seen[0], [0.02, -0.02, 0.04], atol=1e-6)
    np.testing.assert_allclose(seen[9], [0.2, -0.2, 0.4], atol=1e-6)
    np.testing.assert_allclose(seen[24], [0.5, -0.2, 0.8], atol=1e-6)
    np.testing.assert_allclose(seen[49], [0.3, 0.0, 0.4], atol=1e-6)
    policy.take_over()
    policy.step(5.0, COMMAND, inputs, VELOCITY)
    np.testing.assert_allclose(network.seen[50][9:12], seen[0] * [2.0, 2.0, 0.25], atol=1e-6)


def test_a_policy_hands_over_when_it_has_been_told_to_stand_for_a_while(inputs):
    network = Recorder()
    slow = replace(STANDARD, command_rate_limit=(1.0, 1.0, 2.0))
    old, new = (
        LearnedPolicy(policy_folders.contract(observation=slow), one)
        for one in (network, Recorder())
    )
    old.take_over()
    for step in range(100):
        old.step(0.02 * step, np.array([1.5, 0.0, 0.0]), inputs, VELOCITY)
    handover = Handover(old, new, 2.0)
    took = next(
        step
        for step in range(100, 400)
        if handover.step(0.02 * step, inputs, VELOCITY) is not None and new._acted is not None
    )
    shown = np.array(network.seen)[:took, 9]
    standing = np.flatnonzero(np.abs(shown) > 1e-9)[-1] + 1
    assert took - standing >= 45, 'nine tenths of a second, two strides'


def test_without_a_measured_velocity_it_is_estimated_from_the_legs(inputs):
    network = Recorder()
    policy = LearnedPolicy(policy_folders.contract(), network)
    policy.take_over()
    for index in range(20):
        policy.step(0.02 * index, COMMAND, inputs, None)
    assert np.abs(network.seen[-1][:3]).max() > 0.01


@pytest.mark.parametrize('activation', ['elu', 'relu', 'tanh'])
def test_a_policy_exported_as_torchscript_acts_as_its_folder_does(tmp_path, inputs, activation):
    folder = policy_folders.save(tmp_path / 'p', scale=0.3)
    card = folder / 'policy.yaml'
    content = yaml.safe_load(card.read_text())
    content['network']['activation'] = activation
    card.write_text(yaml.safe_dump(content))
    assert write_torchscript(folder, tmp_path / 'twin.pt') == tmp_path / 'twin.yaml'
    policies = [
        load_policy(str(folder)),
        load_policy(str(tmp_path / 'twin.pt'), trust_code=True),
    ]
    for one in policies:
        one.take_over()
    for index in range(3):
        arguments = (0.02 * index, COMMAND, inputs, VELOCITY)
        mine, twins = (one.step(*arguments) for one in policies)
        np.testing.assert_allclose(twins, mine, rtol=1e-5, atol=1e-6)
    many = torch.jit.load(str(tmp_path / 'twin.pt'))(torch.zeros(7, 48))
    assert many.shape == (7, 12)


def test_torchscript_with_a_contract_beside_it_runs_as_the_folder_does(tmp_path, inputs):
    folder = policy_folders.save(tmp_path / 'p', scale=0.3)
    policy = load_policy(str(folder))
    weights = policy_folders.tensors(policy_folders.contract(), 0.3)

    class Twin(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.first = torch.nn.Linear(48, 4)
            self.last = torch.nn.Linear(4, 12)

        def forward(self, x):
            return self.last(torch.nn.functional.elu(self.first(x)))

    twin = Twin()
    for layer, name in ((twin.first, 'layer0'), (twin.last, 'layer1')):
        layer.weight.data = torch.from_numpy(weights[f'{name}.weight'])
        layer.bias.data = torch.from_numpy(weights[f'{name}.bias'])
    torch.jit.trace(twin, torch.zeros(1, 48)).save(str(tmp_path / 'twin.pt'))
    content = yaml.safe_load((folder / 'policy.yaml').read_text())
    del content['network']
    (tmp_path / 'twin.yaml').write_text(yaml.safe_dump(content))
    script = load_policy(str(tmp_path / 'twin.pt'), trust_code=True)
    for one in (policy, script):
        one.take_over()
    for index in range(3):
        arguments = (0.02 * index, COMMAND, inputs, VELOCITY)
        np.testing.assert_allclose(script.step(*arguments), policy.step(*arguments), rtol=1e-5)


@pytest.mark.parametrize('contract', [True, False])
def test_a_file_that_is_no_torchscript_is_refused(tmp_path, contract):
    (tmp_path / 'x.pt').write_bytes(b'PK not really')
    if contract:
        folder = policy_folders.save(tmp_path / 'p')
        (tmp_path / 'x.yaml').write_text((folder / 'policy.yaml').read_text())
    with pytest.raises(InputError, match='TorchScript' if contract else 'x.yaml is missing'):
        load_policy(str(tmp_path / 'x.pt'), trust_code=True)


def test_torchscript_is_not_even_opened_without_trust_in_its_code(tmp_path):

    class Trap(torch.nn.Module):
        def __init__(self, path: str):
            super().__init__()
            self.path = path

        def forward(self, x):
            found = torch.from_file(self.path, shared=True, size=4, dtype=torch.float32)
            found.fill_(1.0)
            return torch.zeros(1, 12) + 0.0 * found.sum()

    victim = tmp_path / 'victim'
    victim.write_bytes(bytes(16))
    torch.jit.script(Trap(str(victim))).save(str(tmp_path / 'trap.pt'))
    folder = policy_folders.save(tmp_path / 'p')
    content = yaml.safe_load((folder / 'policy.yaml').read_text())
    del content['network']
    (tmp_path / 'trap.yaml').write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=r'TorchScript is code.*--trust-code'):
        load_policy(str(tmp_path / 'trap.pt'))
    assert victim.read_bytes() == bytes(16)
    load_policy(str(tmp_path / 'trap.pt'), trust_code=True)
    assert victim.read_bytes() != bytes(16), 'the trap is armed'
