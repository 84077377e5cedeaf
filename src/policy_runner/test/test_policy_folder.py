from dataclasses import replace

import numpy as np
import policy_folders
import pytest
import yaml
from policy_runner.policies.by_name import load_policy
from policy_runner.policies.folder import read_folder, write_folder
from policy_runner.policies.observations import STANDARD
from safetensors.numpy import load_file, save_file
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError

LIMITED = replace(STANDARD, command_rate_limit=(1.0, 1.0, 2.0))


@pytest.mark.parametrize('observation', [STANDARD, LIMITED])
def test_a_policy_is_read_back_as_it_was_written(tmp_path, observation):
    contract = policy_folders.contract(observation=observation)
    tensors = policy_folders.tensors(contract, scale=1.0)
    write_folder(tmp_path / 'p', contract, tensors)
    again, weights = read_folder(tmp_path / 'p')
    assert again == contract
    assert set(weights) == {'layer0.weight', 'layer0.bias', 'layer1.weight', 'layer1.bias'}
    for name, values in tensors.items():
        np.testing.assert_array_equal(weights[name], values)


def edit(folder, change):
    card = folder / 'policy.yaml'
    content = yaml.safe_load(card.read_text())
    change(content)
    card.write_text(yaml.safe_dump(content, sort_keys=False))


def test_keys_by_their_former_names_are_read(tmp_path):
    contract = policy_folders.contract(observation=LIMITED)
    write_folder(tmp_path / 'p', contract, policy_folders.tensors(contract))

    def rename(content):
        content['observation']['command_slew'] = content['observation'].pop('command_rate_limit')

    edit(tmp_path / 'p', rename)
    assert 'command_slew' in (tmp_path / 'p' / 'policy.yaml').read_text()
    assert read_folder(tmp_path / 'p')[0] == contract


def edit_weights(folder, change):
    tensors = {
        name: values.copy() for name, values in load_file(folder / 'weights.safetensors').items()
    }
    change(tensors)
    save_file(tensors, folder / 'weights.safetensors')


def rename_joint(content):
    content['joints'][0] = 'FRONT_HIP'


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (rename_joint, "'FRONT_HIP'"),
        (lambda c: c['joints'].pop(), "lacks 'RH_KFE'"),
        (lambda c: c.pop('observation'), "'observation' is missing"),
        (lambda c: c.pop('default_pose'), "'default_pose' is missing"),
        (lambda c: c.update(format='other/1'), "'other/1'"),
        (lambda c: c.update(rate=2000.0), 'rate: expected 10 to 400 Hz, there is 2000.0'),
        (lambda c: c.update(rate='fast'), "'fast'"),
        (lambda c: c['default_pose'].pop('LF_HAA'), "lacks 'LF_HAA'"),
        (lambda c: c['default_pose'].update(LF_HAA=float('nan')), 'nan'),
        (
            lambda c: c['gains'].update(LF_HAA=5),
            'gains.LF_HAA: expected keys with values, there is 5',
        ),
        (lambda c: c['gains']['LF_HAA'].update(stiffness=30.0), '30.0'),
        (
            lambda c: c['action']['scale'].update(LF_KFE=0.0),
            'action.scale.LF_KFE: expected 0.001 to 10 rad, there is 0.0',
        ),
        (lambda c: c['observation']['terms'].pop(), 'layer0.weight has shape [4, 48]'),
        (lambda c: c['observation']['terms'][0].update(name='smell'), "'smell'"),
        (lambda c: c['observation']['terms'][0].update(scale=[1, 2]), 'base_velocity'),
        (lambda c: c['observation']['terms'].append({'name': 'gravity'}), 'once'),
        (lambda c: c['observation'].update(command_rate_limit=[1, 1]), 'three numbers'),
        (lambda c: c['observation'].update(command_rate_limit=[1, 0, 1]), 'command_rate_limit[1]'),
        (lambda c: c['observation'].update(command_rate_limit='fast'), "'fast'"),
        (lambda c: c['observation'].update(command_slow=[1, 1, 2]), "'command_slow'"),
        (lambda c: c['network'].update(hidden=[5]), 'layer0.weight has shape [4, 48]'),
        (lambda c: c['network'].update(hidden=[4, 4]), 'layer1'),
        (lambda c: c['network'].update(activation='magic'), "'magic'"),
    ],
)
def test_a_contract_that_cannot_be_met_is_refused_in_one_line(tmp_path, change, words):
    folder = policy_folders.save(tmp_path / 'p')
    edit(folder, change)
    with pytest.raises(InputError) as error:
        load_policy(str(folder))
    assert words in str(error.value)
    assert '\n' not in str(error.value)


def poison(tensors):
    tensors['layer0.bias'][2] = np.nan


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (poison, 'not finite'),
        (lambda t: t.pop('layer1.bias'), "lacks 'layer1.bias'"),
        (lambda t: t.update(extra=np.zeros(3, np.float32)), "'extra'"),
        (lambda t: t.update({'layer1.bias': np.zeros(11, np.float32)}), '[11]'),
    ],
)
def test_weights_that_do_not_fit_are_refused_in_one_line(tmp_path, change, words):
    folder = policy_folders.save(tmp_path / 'p')
    edit_weights(folder, change)
    with pytest.raises(InputError) as error:
        load_policy(str(folder))
    assert words in str(error.value)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    ('file', 'content'),
    [
        ('weights.safetensors', b'\x80\x04not tensors'),
        ('weights.safetensors', b''),
        ('weights.safetensors', None),
        ('policy.yaml', b'joints: [unclosed'),
        ('policy.yaml', b'- just a list'),
        ('policy.yaml', b'\xff\xfe'),
        ('policy.yaml', None),
    ],
)
def test_damaged_and_missing_files_are_refused_by_name(tmp_path, file, content):
    folder = policy_folders.save(tmp_path / 'p')
    if content is None:
        (folder / file).unlink()
    else:
        (folder / file).write_bytes(content)
    with pytest.raises(InputError) as error:
        load_policy(str(folder))
    assert str(folder) in str(error.value)
    assert '\n' not in str(error.value)


def test_joints_may_come_in_any_order_but_must_be_the_robots(tmp_path):
    policy_folders.save(tmp_path / 'p', joints=JOINT_NAMES[::-1])
    assert read_folder(tmp_path / 'p')[0].joints == JOINT_NAMES[::-1]
