import os
import struct
import zipfile

import numpy as np
import pytest
import torch
from safetensors.numpy import save
from wattwalk_core.errors import InputError
from wattwalk_core.tensors import checked_tensors, read_state, read_tensors

SHAPES = {'a': (2, 3), 'b': (3,)}


def tensors(**changes):
    return {'a': np.ones((2, 3), np.float32), 'b': np.zeros(3), **changes}


def refused(call):
    with pytest.raises(InputError) as raised:
        call()
    assert str(raised.value).isprintable()
    return str(raised.value)


def test_tensors_and_texts_are_read_as_they_were_written(tmp_path):
    path = tmp_path / 'x.safetensors'
    path.write_bytes(save(tensors(), {'card': 'text'}))
    found = read_tensors(path, 'network')
    assert found.texts == {'card': 'text'}
    assert found.tensors['b'].dtype == np.float64
    assert np.array_equal(checked_tensors(found.tensors, SHAPES, 'network')['a'], np.ones((2, 3)))


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (b'', 'damaged'),
        (b'\x80\x04x', 'pickle'),
        (b'PK\x03\x04', 'pickle'),
        (struct.pack('<Q', 2**63) + b'{}', 'a header of 9223372036854775808 bytes'),
        (struct.pack('<Q', 10) + b'{}', 'damaged'),
        (struct.pack('<Q', 2) + b'[]', 'damaged'),
        (struct.pack('<Q', 2) + b'\xff\xff', 'damaged'),
        (save(tensors())[:-1], 'damaged'),
        (save(tensors()) + b'x', 'damaged'),
    ],
)
def test_anything_but_safetensors_is_refused(tmp_path, content, words):
    path = tmp_path / 'x.safetensors'
    path.write_bytes(content)
    assert words in refused(lambda: read_tensors(path, 'network'))


def test_only_regular_files_within_the_limit_are_opened(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'large').write_bytes(save({'a': np.zeros(1000)}))
    for reader in (read_tensors, read_state):
        assert 'regular' in refused(lambda read=reader: read(tmp_path / 'pipe', 'network'))
        assert 'regular' in refused(lambda read=reader: read(tmp_path, 'network'))
        large = refused(lambda read=reader: read(tmp_path / 'large', 'network', 4096))
        assert 'larger than 4 KiB' in large


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({}, "lacks 'a'"),
        ({'a': np.ones((2, 3))}, "lacks 'b'"),
        (tensors(c=np.ones(1)), "has 'c'"),
        (tensors(a=np.ones((3, 2))), 'a has shape [3, 2], expected [2, 3]'),
        (tensors(b=np.full(3, np.nan)), 'b holds values that are not finite'),
        (tensors(b=np.full(3, 1e300)), 'b holds values that are not finite'),
        (tensors(b=np.zeros(3, np.int64)), 'b holds values that are not finite'),
        (tensors(**{'c\x1b[31m\n': np.ones(1)}), r"has 'c\x1b[31m\n'"),
    ],
)
def test_tensors_that_do_not_fit_are_refused_by_name(given, words):
    assert words in refused(lambda: checked_tensors(given, SHAPES, 'network'))


def test_a_state_of_torch_is_read_without_running_it(tmp_path):

    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / 'sprung'), 'w'))

    torch.save({'a': torch.ones(2), 'n': 3}, tmp_path / 'good.pt')
    assert read_state(tmp_path / 'good.pt', 'checkpoint')['n'] == 3
    torch.save({'a': Trap()}, tmp_path / 'trap.pt')
    with zipfile.ZipFile(tmp_path / 'bomb.pt', 'w', zipfile.ZIP_DEFLATED) as archive:
        archive.writestr('archive/data.pkl', b'\0' * 10_000_000)
    (tmp_path / 'short.pt').write_bytes((tmp_path / 'good.pt').read_bytes()[:100])
    for name, words in (
        ('trap', 'is damaged'),
        ('bomb', 'unpacks to more than'),
        ('short', 'is damaged'),
    ):
        found = refused(lambda n=name: read_state(tmp_path / f'{n}.pt', 'checkpoint', 1 << 20))
        assert words in found
    assert not (tmp_path / 'sprung').exists()
