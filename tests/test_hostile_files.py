"""
Models, networks, policies and checkpoints that others made, mutated from valid ones by seed.

Each ends in an InputError of one printable line, and nothing is written or run.
"""

import copy
import io
import math
import os
import struct
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import policy_folders
import pytest
import torch
import yaml
from policy_runner.policies.by_name import load_policy
from policy_training.learning.run_folder import read_checkpoint
from power_estimator.drive_types import DriveType
from power_estimator.effects import load_catalogue
from power_estimator.loader import load_model
from power_estimator.network.checkpoint import (
    Checkpoint,
    Intervals,
    Network,
    NetworkConfig,
    TrainingRecording,
)
from power_estimator.network.features import Scaling
from power_estimator.network.lstm import Weights
from power_estimator.network.out_of_distribution import OutOfDistributionScore
from safetensors.numpy import load, save
from small_models import EFFECT, MODEL
from wattwalk_core.errors import InputError

WRONG = {
    float: [math.nan, math.inf, -math.inf, 1e308, -1e308, 'fast', True, ['x'], {'a': 1}, 10**25],
    str: [5, 1.5, 'x\x1b[31m', 'y' * 5000, ['a'], {'a': 'b'}, True],
    list: ['text', {'a': 1}, [[]], [None], True],
    dict: ['text', [1], True, [['shaft']]],
}
FREE = {'training', 'card', 'software'}  # entries that hold anything


def places(content, path=()):
    """Paths of all entries but those that may hold anything."""
    if path:
        yield path
    if isinstance(content, list):
        content = dict(enumerate(content))
    for key, value in content.items() if isinstance(content, dict) else ():
        if key not in FREE:
            yield from places(value, (*path, key))


def spoiled(content, rng):
    """Content with one entry of another kind or out of range, and the entry's place."""
    content = copy.deepcopy(content)
    paths = list(places(content))
    path = paths[rng.integers(len(paths))]
    *above, last = path
    parent = content
    for key in above:
        parent = parent[key]
    value = parent[last]
    kind = float if isinstance(value, int | float) else type(value)
    wrong = WRONG.get(kind, WRONG[dict])
    parent[last] = wrong[rng.integers(len(wrong))]
    return content, '.'.join(map(str, path))


TEXTS = {
    'aliases': b'a: &a [x, x]\nb: *a',
    'bomb': b'a: &a [x, x]\n' + b'\n'.join(b'a%d: [*a, *a]' % i for i in range(9)),
    'merge': b'a: &a {b: 1}\nc: {<<: *a}',
    'tag': b'effects: !!python/object/apply:os.system [echo]',
    'twice': b'format: power_model/1\nformat: power_model/1',
    'deep': b'effects: ' + b'[' * 900,
    'digits': b'rate: ' + b'9' * 400,
    'nul': b'effects: "\x00"',
    'not utf-8': b'effects: \xff\xfe',
    'large': b'#' * (2 << 20),
    'list': b'[1, 2]',
    'number': b'5',
    'empty': b'',
    'open': b'effects: {a: [',
    'date': b'2026-11-22',
    'null': b'null',
}


@pytest.fixture(scope='module')
def originals(tmp_path_factory):
    """Content of valid files by name."""
    folder = tmp_path_factory.mktemp('valid')
    rng = np.random.default_rng(0)
    shapes = Weights.shapes(2)
    weights = Weights(**{n: rng.normal(size=s).astype(np.float32) for n, s in shapes.items()})
    scaling = Scaling((0.0,) * 3, (0.1, 20.0, 3.0), 20.0, 30.0)
    one = OutOfDistributionScore((0.0,) * 6, tuple(map(tuple, np.eye(6).tolist())), 30.0)
    spans = Intervals(0.9, (5.0,), (1.0, 2.0), (1.0, 2.0))
    hfe = Network(
        DriveType('HFE', ('*_HFE',)), scaling, (-9.0,) * 3, (9.0,) * 3, weights, spans, one
    )
    haa = replace(hfe, type=DriveType('HAA', ('*_HAA',)))
    known = TrainingRecording('walk', 'ab', {'robot': 'r'}, {'HAA': ((0.5, 1.5),)})
    config = NetworkConfig(hidden=2)
    Checkpoint(config, (haa, hfe), (known,), {'fold': 0}).save(folder / 'n')
    policy_folders.save(folder / 'p')
    state = {
        'actor_state_dict': {'w': torch.zeros(2)},
        'critic_state_dict': {'w': torch.zeros(2)},
        'optimizer_state_dict': {},
        'iteration': 1,
        'steps': 2,
    }
    stream = io.BytesIO()
    torch.save(state, stream)
    return {
        'network': (folder / 'n').read_bytes(),
        'model': MODEL.encode(),
        'contract': (folder / 'p' / 'policy.yaml').read_bytes(),
        'weights': (folder / 'p' / 'weights.safetensors').read_bytes(),
        'checkpoint': stream.getvalue(),
        'effects': EFFECT.encode(),
    }


class Files:
    """A folder with valid files, one of which is made hostile, and what opens it."""

    names: ClassVar = {
        'network': 'run/model.safetensors',
        'model': 'model.yaml',
        'contract': 'policy/policy.yaml',
        'weights': 'policy/weights.safetensors',
        'checkpoint': 'training/checkpoint.pt',
        'effects': 'effects.py',
    }

    def __init__(self, folder, originals):
        self.folder, self.originals = folder, originals
        for kind, name in self.names.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(originals[kind])

    def path(self, kind):
        return self.folder / self.names[kind]

    def open(self, kind):
        path = self.path(kind)
        opener = {
            'network': lambda: load_model(f'ppn:{path.parent}'),
            'model': lambda: load_model(str(path)),
            'checkpoint': lambda: read_checkpoint(path.parent),
            'effects': lambda: load_catalogue([path]),
        }
        return opener.get(kind, lambda: load_policy(str(path.parent)))()

    def refuses(self, kind, content=None):
        """Open the file, with other content, and return the line that refuses it."""
        if content is not None:
            self.path(kind).write_bytes(content)
        before = sorted(self.folder.rglob('*'))
        with pytest.raises(InputError) as raised:
            self.open(kind)
        line = str(raised.value)
        assert line.isprintable()
        assert 10 < len(line) <= 801
        assert sorted(self.folder.rglob('*')) == before
        return line


@pytest.fixture
def files(tmp_path, originals):
    return Files(tmp_path, originals)


def rng_of(*key):
    return np.random.default_rng([*map(ord, ''.join(map(str, key)))])


@pytest.mark.parametrize('kind', Files.names)
def test_the_originals_are_sound(files, kind):
    files.open(kind)


@pytest.mark.parametrize('seed', range(60))
@pytest.mark.parametrize('kind', ['network', 'model', 'contract'])
def test_an_entry_of_another_kind_or_out_of_range_is_refused(files, kind, seed):
    rng = rng_of(kind, seed)
    original = files.originals[kind]
    if kind == 'network':
        length = struct.unpack('<Q', original[:8])[0]
        header = yaml.safe_load(original[8 : 8 + length])
        card, place = spoiled(yaml.safe_load(header['__metadata__']['card']), rng)
        content = save(load(original), {'card': yaml.dump(card)})
    else:
        content, place = spoiled(yaml.safe_load(original), rng)
        content = yaml.dump(content, allow_unicode=True).encode()
    assert files.refuses(kind, content), place


@pytest.mark.parametrize('text', TEXTS)
@pytest.mark.parametrize('kind', ['network', 'model', 'contract'])
def test_yaml_that_is_more_than_plain_is_refused(files, kind, text):
    content = TEXTS[text]
    if kind == 'network':
        card = content.decode(errors='replace')
        content = save(load(files.originals[kind]), {'card': card})
    files.refuses(kind, content)


def poison(value, kind=np.float32):
    def change(tensors, name):
        tensors[name] = np.full(tensors[name].shape, value, kind)

    return change


TENSORS = {
    'nan': poison(np.nan),
    'infinite': poison(np.inf),
    'too large for float32': poison(1e300, np.float64),
    'whole numbers': poison(1, np.int64),
    'truth values': poison(True, bool),
    'missing': lambda tensors, name: tensors.pop(name),
    'extra': lambda tensors, name: tensors.update({name + 'x': tensors[name]}),
    'escape codes': lambda tensors, name: tensors.update({'\x1b[2J\n': tensors[name]}),
    'no numbers': lambda tensors, name: tensors.update({name: np.zeros(0, np.float32)}),
    'one more axis': lambda tensors, name: tensors.update({name: tensors[name][None].copy()}),
    'one row less': lambda tensors, name: tensors.update({name: tensors[name][1:].copy()}),
    'none at all': lambda tensors, name: tensors.clear(),
}


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('change', TENSORS)
@pytest.mark.parametrize('kind', ['network', 'weights'])
def test_tensors_that_do_not_fit_are_refused(files, kind, change, seed):
    original = files.originals[kind]
    tensors = dict(load(original))
    name = sorted(tensors)[rng_of(kind, change, seed).integers(len(tensors))]
    TENSORS[change](tensors, name)
    length = struct.unpack('<Q', original[:8])[0]
    texts = yaml.safe_load(original[8 : 8 + length]).get('__metadata__')
    files.refuses(kind, save(tensors, texts))


@pytest.mark.parametrize('seed', range(12))
@pytest.mark.parametrize('kind', ['network', 'weights', 'checkpoint'])
def test_a_file_that_is_cut_off_is_refused(files, kind, seed):
    original = files.originals[kind]
    files.refuses(kind, original[: rng_of(kind, seed).integers(len(original))])


LENGTHS = [0, 1, 7, 2**16, 2**20, 2**27, 2**31, 2**40, 2**63 - 1, 2**63, 2**64 - 1]


@pytest.mark.parametrize('length', LENGTHS)
@pytest.mark.parametrize('kind', ['network', 'weights'])
def test_a_header_that_lies_about_its_size_is_refused(files, kind, length):
    files.refuses(kind, struct.pack('<Q', length) + files.originals[kind][8:])


HEADERS = [
    '{}',
    '[]',
    '{"a": 5}',
    '{"a": {"dtype": "F32", "shape": [2], "data_offsets": [0, 99999999]}}',
    '{"a": {"dtype": "F32", "shape": [9223372036854775807], "data_offsets": [0, 8]}}',
    '{"a": {"dtype": "F32", "shape": [4294967296, 4294967296], "data_offsets": [0, 0]}}',
    '{"a": {"dtype": "F32", "shape": [-1], "data_offsets": [0, 8]}}',
    '{"a": {"dtype": "F32", "shape": [2], "data_offsets": [8, 0]}}',
    '{"a": {"dtype": "object", "shape": [2], "data_offsets": [0, 8]}}',
    '{"a": {"dtype": "F8_E4M3", "shape": [8], "data_offsets": [0, 8]}}',
    '{"a": ' + '[' * 5000,
    '{"__metadata__": {"card": 5}}',
    '{"__metadata__": []}',
]


@pytest.mark.parametrize('header', range(len(HEADERS)))
@pytest.mark.parametrize('kind', ['network', 'weights'])
def test_a_header_of_nonsense_is_refused(files, kind, header):
    text = HEADERS[header].encode()
    files.refuses(kind, struct.pack('<Q', len(text)) + text + bytes(8))


PATHS = {
    'pipe': os.mkfifo,
    'folder': Path.mkdir,
    'device': lambda path: path.symlink_to('/dev/zero'),
    'loop': lambda path: path.symlink_to(path),
    'absent': lambda path: None,
    'large': lambda path: os.truncate(path.open('xb').name, 1 << 40),
}


@pytest.mark.parametrize('what', PATHS)
@pytest.mark.parametrize('kind', Files.names)
def test_only_regular_files_of_bounded_size_are_opened(files, kind, what):
    files.path(kind).unlink()
    PATHS[what](files.path(kind))
    files.refuses(kind)


class Trap:
    def __reduce__(self):
        return (os.mkdir, ('sprung',))


STATES = {
    'nothing': {},
    'a list': [1, 2],
    'a number': 5,
    'no networks': {'iteration': 1, 'steps': 2},
    'a list of weights': {'actor_state_dict': [1], 'iteration': 1, 'steps': 2},
    'a trap': Trap(),
    'a hidden trap': {'actor_state_dict': Trap(), 'iteration': 1},
    'a module': torch.nn.Linear(2, 2),
}


@pytest.mark.parametrize('what', [*STATES, 'iteration', 'steps', 'bomb', 'text', 'zip'])
def test_a_checkpoint_of_anything_else_is_refused_and_not_run(files, what, monkeypatch):
    monkeypatch.chdir(files.folder)
    stream = io.BytesIO()
    if what in ('bomb', 'zip'):
        with zipfile.ZipFile(stream, 'w', zipfile.ZIP_DEFLATED) as archive:
            for index in range(3 if what == 'bomb' else 1):
                archive.writestr(f'archive/{index}', bytes(60 << 20 if what == 'bomb' else 9))
    elif what == 'text':
        stream.write(b'not a checkpoint')
    elif what in STATES:
        torch.save(STATES[what], stream)
    else:
        sound = torch.load(io.BytesIO(files.originals['checkpoint']), weights_only=True)
        torch.save({**sound, what: math.nan}, stream)
    files.refuses('checkpoint', stream.getvalue())


CODE = [
    ('raise SystemExit(0)', 'from power'),
    ('1 / 0', 'from power'),
    ('def f(:', 'from power'),
    ('\x00', 'from power'),
    ('(' * 300, 'from power'),
    ('    terms = 5', '    terms = ('),
    ('    terms = ()', '    terms = ('),
    ('    terms = (None,)', '    terms = ('),
    ("    terms = (Term('f', 'W', 1.0, 0.0),)", '    terms = ('),
    ("    terms = (Term('f', 'W', float('nan')),)", '    terms = ('),
    ("    name = 'x\\x1b[31m'", '    name'),
    ('    name = 5', '    name'),
    ("    name = 'a' * 1000", '    name'),
    ("    name = 'idle'", '    name'),
    ("    acts_on = 'nothing'", '    formula'),
    ('class Fan:', 'class Fan'),
]


@pytest.mark.parametrize(('line', 'in_place_of'), CODE)
def test_a_file_of_effects_that_is_none_is_refused(files, line, in_place_of):
    lines = EFFECT.splitlines()
    found = next(i for i, text in enumerate(lines) if text.startswith(in_place_of))
    lines[found] = line
    files.refuses('effects', '\n'.join(lines).encode())
