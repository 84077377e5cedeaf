import json
import pickle
import struct
from dataclasses import replace

import numpy as np
import pytest
import torch
import yaml
from power_estimator.loader import load_base, load_model
from power_estimator.network.checkpoint import Checkpoint, NetworkConfig, TrainingRecording
from safetensors import safe_open
from safetensors.numpy import save
from wattwalk_core.errors import InputError


def contents(path):
    with safe_open(path, framework='np') as file:
        tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
        return tensors, yaml.safe_load(file.metadata()['card'])


@pytest.fixture
def saved(checkpoint, tmp_path):
    recordings = (TrainingRecording('walk', 'ab12', {'robot': 'r'}, {'HAA': ((0.5, 1.5),)}),)
    path = tmp_path / 'model.safetensors'
    replace(checkpoint, recordings=recordings).save(path)
    return path


def rewrite(path, change):
    tensors, card = contents(path)
    change(tensors, card)
    path.write_bytes(save(tensors, {'card': yaml.safe_dump(card)}))


def test_what_was_saved_is_loaded(saved, checkpoint):
    loaded = Checkpoint.load(saved)
    assert loaded.config == checkpoint.config
    assert loaded.recordings[0].held_out == {'HAA': ((0.5, 1.5),)}
    for a, b in zip(loaded.networks, checkpoint.networks, strict=True):
        assert (a.type, a.scaling, a.low, a.high) == (b.type, b.scaling, b.low, b.high)
        assert np.array_equal(a.weights.recurrent, b.weights.recurrent)


def test_a_run_folder_stands_for_its_model(saved):
    assert load_model(f'ppn:{saved.parent}').name == 'ppn'


def test_nothing_is_left_beside_the_file(saved):
    assert [p.name for p in saved.parent.iterdir()] == ['model.safetensors']


def test_pickles_are_refused_without_being_run(tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / 'sprung'), 'w'))

    torch_file, raw = tmp_path / 'model.pt', tmp_path / 'raw.safetensors'
    torch.save({'weights': torch.zeros(1)}, torch_file)
    raw.write_bytes(pickle.dumps(Trap()))
    for path in (torch_file, raw):
        with pytest.raises(InputError, match=f'{path.name}: is a pickle'):
            Checkpoint.load(path)
    assert not (tmp_path / 'sprung').exists()


@pytest.mark.parametrize('keep', [0, 3, 8, 100, -1, -4000])
def test_a_cut_off_file_is_refused(saved, keep):
    saved.write_bytes(saved.read_bytes()[:keep])
    with pytest.raises(InputError, match=r'model.safetensors: is damaged or not safetensors'):
        Checkpoint.load(saved)


def test_a_header_of_absurd_length_is_refused(saved):
    saved.write_bytes(struct.pack('<Q', 2**60) + saved.read_bytes()[8:])
    with pytest.raises(InputError, match='is damaged'):
        Checkpoint.load(saved)


def test_a_header_whose_length_looks_like_a_pickle_is_read(checkpoint, tmp_path):
    path = tmp_path / 'model.safetensors'
    for length in range(0, 256, 8):
        replace(checkpoint, software='x' * length).save(path)
        if path.read_bytes()[0] == 0x80:
            break
    assert path.read_bytes()[0] == 0x80
    assert Checkpoint.load(path).software == 'x' * length


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r'model.safetensors: there is no such file'):
        load_model(f'ppn:{tmp_path}')


def test_safetensors_of_something_else_are_refused(tmp_path):
    path = tmp_path / 'other.safetensors'
    path.write_bytes(save({'x': np.zeros(3, np.float32)}))
    with pytest.raises(InputError, match='is not a Power Prediction Network'):
        Checkpoint.load(path)


def drop(tensors, card):
    del tensors['HAA/bias']


def narrow(tensors, card):
    tensors['HAA/recurrent'] = tensors['HAA/recurrent'][:, :-1].copy()


def poison(tensors, card):
    tensors['HFE/output'] = np.full_like(tensors['HFE/output'], np.nan)


def relabel(tensors, card):
    card['config']['hidden'] = 100


def strip(tensors, card):
    del card['types']['HAA']['power_mean_w']


def flatten(tensors, card):
    card['types']['HAA']['feature_scale'] = [1.0, 0.0, 1.0]


def refeature(tensors, card):
    card['features'] = ['torque']


def extend(tensors, card):
    card['config']['layers'] = 2


def empty(tensors, card):
    card['types'] = {}


@pytest.mark.parametrize(
    ('change', 'problem'),
    [
        (drop, "lacks 'HAA/bias'"),
        (narrow, r'HAA/recurrent has shape \[96, 23\], expected \[96, 24\]'),
        (poison, 'HFE/output holds values that are not finite float32 numbers'),
        (relabel, r'HAA/input has shape \[96, 3\], expected \[400, 3\]'),
        (strip, "types.HAA: 'power_mean_w' is missing"),
        (flatten, r'types.HAA.feature_scale\[1\]: expected 1e-06 to 1e\+09, there is 0'),
        (refeature, 'features .* are not'),
        (extend, "config: unknown key 'layers'"),
        (empty, 'holds no network'),
    ],
)
def test_files_of_another_shape_are_refused_with_file_and_problem(saved, change, problem):
    rewrite(saved, change)
    with pytest.raises(InputError, match=f'model.safetensors: .*{problem}'):
        Checkpoint.load(saved)


def test_an_unknown_model_is_refused_with_the_names_that_there_are():
    with pytest.raises(InputError, match=r"'torque' is not known.*torque_squared"):
        load_model('torque')
    with pytest.raises(InputError, match='give a run folder'):
        load_model('ppn:')
    with pytest.raises(InputError, match=r'no.yaml.*No such file'):
        load_model('no.yaml')


@pytest.mark.parametrize('spec', ['plain', 'own.yaml'])
def test_a_model_of_effects_is_no_base(spec):
    with pytest.raises(InputError, match=rf'base .{spec}.*: a base model is ppn:RUN or a proxy'):
        load_base(spec)


def test_a_configuration_out_of_range_is_refused():
    with pytest.raises(InputError, match='hidden: expected a whole number from 1 to 1024'):
        NetworkConfig(hidden=0)
    with pytest.raises(InputError, match='warm_up = 60 is not below history = 60'):
        NetworkConfig(warm_up=60)


def test_a_folder_that_cannot_be_written_is_named(checkpoint, tmp_path):
    with pytest.raises(InputError, match='missing'):
        checkpoint.save(tmp_path / 'missing' / 'model.safetensors')


def test_the_card_is_json_plain(saved):
    json.dumps(contents(saved)[1])
