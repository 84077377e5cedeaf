import errno
import os

import pytest
from wattwalk_core.errors import InputError
from wattwalk_core.files import RecordingError, together, write_whole


@pytest.fixture
def full_disk(monkeypatch):
    """A disk that is full from the second file on."""
    written = []

    def fsync(descriptor):
        written.append(descriptor)
        if len(written) > 1:
            raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', fsync)


def write_both(folder, between=lambda: None):
    with together():
        write_whole(folder / 'a', 'one')
        between()
        write_whole(folder / 'b', b'two')


def test_files_that_are_written_together_appear_at_the_end(tmp_path):
    there = []
    write_both(tmp_path, lambda: there.append((tmp_path / 'a').exists()))
    assert there == [False]
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a', 'b']
    assert (tmp_path / 'b').read_text() == 'two'


def test_a_disk_that_is_full_leaves_none_of_the_files_written_together(tmp_path, full_disk):
    (tmp_path / 'a').write_text('before')
    with pytest.raises(RecordingError, match='the disk is full'):
        write_both(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ['a']
    assert (tmp_path / 'a').read_text() == 'before'


def test_an_error_between_them_leaves_none_either(tmp_path):
    with pytest.raises(ZeroDivisionError):
        write_both(tmp_path, lambda: 1 / 0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('name', ['folder', 'absent/file', 'x' * 300, 'file/inside'])
def test_a_file_that_cannot_be_written_is_refused_in_one_line(tmp_path, name):
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'file').write_text('')
    with pytest.raises(InputError, match='cannot write'):
        write_whole(tmp_path / name, 'content')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['file', 'folder']
