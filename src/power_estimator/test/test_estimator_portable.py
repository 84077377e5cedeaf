"""A power term that was exported says what `BatchPower` says, without this project."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from power_estimator.batch.power import BatchPower
from power_estimator.commands.arguments import export as command
from power_estimator.network.features import features
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.portable.export import export
from power_estimator.portable.power_term import PowerReward, PowerTerm
from wattwalk_core.errors import InputError

DRIVES = ('LF_HAA', 'RF_HFE', 'RF_HAA')
ALONE = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in ('power_estimator', 'power_recordings', 'wattwalk_core', 'rclpy'):
            raise ImportError(name)
sys.meta_path.insert(0, Refuse())
sys.path.insert(0, sys.argv[1])
import torch
from power_term import PowerTerm
term = PowerTerm.load(sys.argv[1] + '/power_term.safetensors', ['RF_HFE'], 200.0)
script = torch.jit.load(sys.argv[1] + '/power_term.pt')
torch.manual_seed(0)
for _ in range(20):
    one = torch.randn(2, 4, 3)
    a = script(one * 0.1, one * 10, one)
    b = term(*(x[:, :, 1:2] for x in (one * 0.1, one * 10, one)))
print(float(a[0, 1]), float(b[0, 0]))
"""


@pytest.fixture(scope='module')
def folder(checkpoint, tmp_path_factory):
    path = tmp_path_factory.mktemp('term') / 'term'
    export(checkpoint, path, DRIVES, 200.0)
    return path


@pytest.fixture(scope='module')
def samples(drives):
    """Features of two robots, [2, T, D, 3]."""
    moves = [features(drives(2.0, DRIVES, seed=seed)) for seed in (1, 2)]
    return np.stack(moves).astype(np.float32)


def term_of(folder, rate=200.0):
    return PowerTerm.load(folder / 'power_term.safetensors', DRIVES, rate)


def step(term, x):
    return term(*torch.from_numpy(x).unbind(-1)).numpy()


def test_the_watts_are_those_of_the_model_it_came_from(folder, checkpoint, samples):
    batch, term = BatchPower(PowerPredictionNetwork(checkpoint), DRIVES, 2), term_of(folder)
    for start in range(0, 200, 4):
        x = samples[:, start : start + 4]
        expected = batch.step(*np.moveaxis(x, 3, 0)) * batch.ready[:, None]
        np.testing.assert_allclose(step(term, x), expected, rtol=1e-4, atol=2e-3)
    assert np.abs(expected).max() > 1.0


def test_it_needs_torch_and_safetensors_alone_and_torchscript_says_the_same(folder):
    run = subprocess.run(
        [sys.executable, '-c', ALONE, str(folder)], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    scripted, plain = (float(x) for x in run.stdout.split())
    assert scripted == pytest.approx(plain, rel=1e-4)
    assert scripted != 0.0


def test_there_are_no_watts_until_the_warm_up_is_over(folder, checkpoint, samples):
    term = term_of(folder)
    warm_up = checkpoint.config.warm_up
    shown = [bool(step(term, samples[:, t]).any()) for t in range(warm_up + 2)]
    assert shown == [False] * warm_up + [True] * 2


def test_a_robot_that_starts_anew_forgets_and_the_others_go_on(folder, samples):
    term, unbroken, begun = (term_of(folder) for _ in range(3))
    for start in range(0, 80, 4):
        step(term, samples[:, start : start + 4])
        step(unbroken, samples[:, start : start + 4])
    term.reset(torch.tensor([1]))
    for start in range(80, 160, 4):
        x = samples[:, start : start + 4]
        after, other, fresh = step(term, x), step(unbroken, x), step(begun, x)
    np.testing.assert_allclose(after[0], other[0], rtol=1e-4)
    np.testing.assert_allclose(after[1], fresh[1], rtol=1e-4)


def test_a_sample_that_is_not_finite_silences_its_robot_until_the_next_reset(folder, samples):
    term = term_of(folder)
    for start in range(0, 40, 4):
        step(term, samples[:, start : start + 4])
    bad = samples[:, 40:44].copy()
    bad[0, 1, 2, 1] = np.nan
    power = step(term, bad)
    assert not power[0].any()
    assert power[1].any()
    assert not step(term, samples[:, 44:48])[0].any()
    term.reset(torch.tensor([0]))
    for start in range(48, 88, 4):
        power = step(term, samples[:, start : start + 4])
    assert power[0].any()


def test_a_sample_at_50_hz_counts_as_four(folder, samples):
    held, every = term_of(folder, 50.0), term_of(folder)
    for t in range(10):
        x = samples[:, t]
        four = np.repeat(x[:, None], 4, axis=1)
        np.testing.assert_allclose(step(held, x), step(every, four), rtol=1e-5)


def test_another_number_of_robots_begins_anew(folder, samples):
    term = term_of(folder)
    for t in range(40):
        step(term, samples[:, t])
    assert not step(term, samples[:1, 0]).any()


@pytest.mark.parametrize(
    ('drives', 'rate', 'words'),
    [(('wheel',), 200.0, "'wheel'"), (DRIVES, 60.0, '60'), (DRIVES, 0.0, 'sample_rate')],
)
def test_a_drive_or_rate_that_it_does_not_know_is_named(folder, drives, rate, words):
    with pytest.raises(ValueError, match=words):
        PowerTerm.load(folder / 'power_term.safetensors', drives, rate)


def test_a_file_that_is_no_power_term_is_refused(folder, tmp_path):
    (tmp_path / 'x.safetensors').write_bytes(b'not tensors')
    with pytest.raises(ValueError, match='no power term'):
        PowerTerm.load(tmp_path / 'x.safetensors', DRIVES, 200.0)


def test_inputs_of_another_shape_are_refused(folder):
    with pytest.raises(ValueError, match=r'\[N, S, 3\]'):
        term_of(folder)(*(torch.zeros(2, 4) for _ in range(3)))


class Asset:
    """Robot of a training with two joints more than the model knows."""

    names = ('LF_HAA', 'wheel', 'RF_HFE', 'RF_HAA', 'gripper')

    def __init__(self, x):
        blank = torch.zeros(len(x), 5)
        blank[:, [0, 2, 3]] = 1.0
        error, torque, velocity = (
            blank.index_copy(1, torch.tensor([0, 2, 3]), torch.from_numpy(x[..., k]))
            for k in range(3)
        )
        self.data = SimpleNamespace(
            joint_pos=torch.zeros_like(error),
            joint_pos_target=error,
            joint_vel=velocity,
            qfrc_actuator=torque,
        )

    def find_joints(self, pattern):
        own = [i for i, name in enumerate(self.names) if name in DRIVES]
        return own, [self.names[i] for i in own]


def test_the_reward_term_is_the_sum_of_the_drives_watts_held_at_the_step(folder, samples):
    term = term_of(folder, 50.0).requires_grad_(False)
    params = {'file': str(folder / 'power_term.safetensors'), 'joints': '[LR]F.*'}
    env = SimpleNamespace(step_dt=0.02, num_envs=2, device='cpu', scene={})
    env.scene['robot'] = Asset(samples[:, 0])
    reward = PowerReward(SimpleNamespace(params=params), env)
    reward.reset(None)
    order = [DRIVES.index(n) for n in Asset.names if n in DRIVES]
    for t in range(20):
        env.scene['robot'].data = Asset(samples[:, t][:, order]).data
        found = reward(env, **params)
    for t in range(20):
        expected = step(term, samples[:, t]).sum(axis=1)
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-4)
    assert found.shape == (2,)
    reward.reset(slice(0, 1))
    after = reward(env, **params)
    assert after[0] == 0.0
    assert after[1] != 0.0


def test_the_command_writes_the_files_and_says_how_to_load_them(checkpoint, tmp_path, capsys):
    checkpoint.save(tmp_path / 'model.safetensors')
    out = tmp_path / 'term'
    assert command([str(tmp_path), '-o', str(out), '--drives', *DRIVES]) == 0
    assert sorted(p.name for p in out.iterdir()) == [
        'power_term.pt',
        'power_term.py',
        'power_term.safetensors',
    ]
    assert 'PowerTerm.load(' in capsys.readouterr().out


def test_torchscript_for_an_unknown_drive_is_refused_and_names_it(checkpoint, tmp_path):
    with pytest.raises(InputError, match="'wheel'"):
        export(checkpoint, tmp_path / 'term', ['wheel'], 200.0)
    assert not list((tmp_path / 'term').glob('*.pt'))
