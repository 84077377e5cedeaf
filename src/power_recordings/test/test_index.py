"""The index: what was kept of a recording counts until the recording changes, and no longer."""

import json
import os
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing

import pytest
from power_recordings.card import Card
from power_recordings.commands.arguments import index as index_command
from power_recordings.commands.arguments import info as info
from power_recordings.index import kept_quality
from power_recordings.index.store import (
    VERSION,
    DriveFigure,
    IndexAnswer,
    RecordingFacts,
    RecordingIndex,
    Stamp,
    usual_path,
)
from power_recordings.index.tables import add_cards, listed
from synthetic_walk import Walk
from wattwalk_core.errors import InputError


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setenv('WATTWALK_INDEX', str(tmp_path / 'cache' / 'index.sqlite3'))
    return tmp_path / 'cache' / 'index.sqlite3'


def bag(folder, card='robot: leg\n'):
    """Files that look like a recording from outside."""
    folder.mkdir(parents=True)
    (folder / 'metadata.yaml').write_text('a: 1\n')
    (folder / 'data_0.mcap').write_bytes(b'12345')
    (folder / 'card.yaml').write_text(card)
    return folder


ABOUT = RecordingFacts(Card(robot='leg', unit='3', created='2026-03-14'), 1.7e9, 60.0)


def keep(file, folder, content=b'answer'):
    with RecordingIndex(file) as index:
        index.keep(
            Stamp.of(folder),
            ABOUT,
            IndexAnswer('fit', 'k', content, [DriveFigure('A', 'idle', 8)]),
        )


def kept(file, folder):
    with RecordingIndex(file) as index:
        return index.answer(Stamp.of(folder), 'fit', 'k')


def test_an_answer_is_there_in_the_next_process_and_only_for_its_kind_and_key(file, tmp_path):
    folder = bag(tmp_path / 'a')
    keep(file, folder)
    assert kept(file, folder) == b'answer'
    with RecordingIndex(file) as index:
        assert index.answer(Stamp.of(folder), 'fit', 'other model') is None
        assert index.answer(Stamp.of(folder), 'quality', 'k') is None
        assert index.knows(Stamp.of(folder))
    keep(file, folder, b'newer')
    assert kept(file, folder) == b'newer'
    with RecordingIndex(file) as index:
        assert index.rows('SELECT count(*) FROM figures') == [(1,)]


@pytest.mark.parametrize('name', ['data_0.mcap', 'card.yaml', 'metadata.yaml'])
@pytest.mark.parametrize('change', ['bytes', 'date'])
def test_a_recording_of_which_any_file_changed_has_no_answer(file, tmp_path, name, change):
    folder = bag(tmp_path / 'a')
    keep(file, folder)
    status = (folder / name).stat()
    if change == 'bytes':
        with (folder / name).open('ab') as stream:
            stream.write(b'\n')
        os.utime(folder / name, ns=(status.st_atime_ns, status.st_mtime_ns))
    else:
        os.utime(folder / name, ns=(status.st_atime_ns, status.st_mtime_ns - 1))
    assert kept(file, folder) is None
    keep(file, folder)
    assert kept(file, folder) == b'answer'
    with RecordingIndex(file) as index:  # the former answers went with the former files
        assert index.rows('SELECT count(*) FROM answers') == [(1,)]
        assert index.rows('SELECT count(*) FROM figures') == [(1,)]


def test_a_file_of_another_version_is_begun_anew(file, tmp_path):
    folder = bag(tmp_path / 'a')
    keep(file, folder)
    with closing(sqlite3.connect(file)) as database:
        database.execute('ALTER TABLE answers RENAME TO replies')
        database.execute(f'PRAGMA user_version = {VERSION + 1}')
        database.commit()
    assert kept(file, folder) is None
    keep(file, folder)
    assert kept(file, folder) == b'answer'
    with RecordingIndex(file) as index:
        tables = {name for (name,) in index.rows("SELECT name FROM sqlite_master WHERE sql <> ''")}
    assert 'replies' not in tables


@pytest.mark.parametrize('damage', ['half', 'zeros', 'middle', 'empty'])
def test_a_torn_file_is_begun_anew(file, tmp_path, damage):
    folders = [bag(tmp_path / str(i)) for i in range(20)]
    for folder in folders:
        keep(file, folder, bytes(3000))
    content = bytearray(file.read_bytes())
    if damage == 'half':
        content = content[: len(content) // 2 + 100]
    elif damage == 'zeros':
        content = bytearray(len(content))
    elif damage == 'middle':
        content[100:] = b'\xa5' * (len(content) - 100)
    else:
        content = bytearray()
    file.write_bytes(content)
    # A torn file may still tell what it has whole; it never says what was not kept.
    assert {kept(file, folder) for folder in folders} <= {bytes(3000), None}
    for folder in folders:
        keep(file, folder, b'again')
        keep(file, folder, b'again')
    assert [kept(file, folder) for folder in folders] == [b'again'] * 20


def test_content_that_is_not_what_was_kept_is_not_returned(file, tmp_path):
    folder = bag(tmp_path / 'a')
    keep(file, folder, b'\x01' * 50)
    file.write_bytes(file.read_bytes().replace(b'\x01' * 50, b'\x01' * 49 + b'\x02'))
    assert kept(file, folder) is None


def test_a_file_of_another_program_is_refused_and_not_touched(file, tmp_path):
    other = tmp_path / 'photos.sqlite3'
    with closing(sqlite3.connect(other)) as database:
        database.execute('CREATE TABLE photos (name TEXT)')
        database.commit()
    before = other.read_bytes()
    with pytest.raises(InputError, match=r'photos\.sqlite3 is no index'):
        RecordingIndex(other)
    assert other.read_bytes() == before


def test_an_index_that_cannot_be_written_is_gone_without(tmp_path):
    folder = bag(tmp_path / 'a')
    (tmp_path / 'wall').write_text('a file where a folder should be')
    with RecordingIndex(tmp_path / 'wall' / 'index.sqlite3') as index:
        index.keep(Stamp.of(folder), ABOUT, IndexAnswer('fit', 'k', b'x'))
        assert index.answer(Stamp.of(folder), 'fit', 'k') is None
        assert 'cannot be used' in index.off


WRITER = """
import sys
from pathlib import Path
from power_recordings.index.store import RecordingFacts, IndexAnswer, RecordingIndex
from power_recordings.index.store import Stamp
from power_recordings.card import Card
with RecordingIndex(Path(sys.argv[1])) as index:
    for folder in sys.argv[2:]:
        stamp = Stamp.of(Path(folder))
        for key in 'abc':
            index.keep(stamp, RecordingFacts(Card()), IndexAnswer('fit', key, folder.encode()))
    sys.exit(index.off or None)
"""


def test_two_processes_keep_their_answers_in_one_file_at_once(file, tmp_path):
    folders = [bag(tmp_path / 'bags' / str(i)) for i in range(40)]
    halves = folders[:25], folders[15:]  # both keep ten of them
    started = [
        subprocess.Popen([sys.executable, '-c', WRITER, file, *half], stderr=subprocess.PIPE)
        for half in halves
    ]
    for process in started:
        _, error = process.communicate(timeout=120)
        assert process.returncode == 0, error
    with RecordingIndex(file) as index:
        assert index.rows('SELECT count(*) FROM answers') == [(120,)]
        for folder in folders:
            assert index.answer(Stamp.of(folder), 'fit', 'c') == str(folder).encode()


def test_a_recording_that_two_add_at_the_same_moment_is_added_once(file, tmp_path):
    folder, offs = bag(tmp_path / 'a'), []

    def add():
        with RecordingIndex(file) as other:
            other.keep(Stamp.of(folder), ABOUT, IndexAnswer('fit', 'theirs', b'y'))
            offs.append(other.off)

    thread = threading.Thread(target=add)

    def interrupt(statement):
        if statement.startswith('BEGIN') and not thread.ident:
            thread.start()
            thread.join()

    with RecordingIndex(file) as index:
        index._database.set_trace_callback(interrupt)
        index.keep(Stamp.of(folder), ABOUT, IndexAnswer('fit', 'ours', b'x'))
        assert (index.off, offs) == ('', [''])
        assert index.rows('SELECT count(*) FROM recordings') == [(1,)]
        for key, content in (('ours', b'x'), ('theirs', b'y')):
            assert index.answer(Stamp.of(folder), 'fit', key) == content


def test_a_torn_file_that_another_process_has_open_is_left_to_it(file, tmp_path):
    folder = bag(tmp_path / 'a')
    keep(file, folder)
    with RecordingIndex(file):
        content = file.read_bytes()
        file.write_bytes(content[:100] + b'\xa5' * (len(content) - 100))
        with RecordingIndex(file) as other:
            assert other.answer(Stamp.of(folder), 'fit', 'k') is None
            assert 'torn' in other.off
        assert file.exists()


def test_the_variable_names_the_file_and_empty_means_none(monkeypatch, tmp_path):
    monkeypatch.setenv('WATTWALK_INDEX', '')
    assert usual_path() is None
    monkeypatch.delenv('WATTWALK_INDEX')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    assert usual_path() == tmp_path / 'wattwalk' / 'recordings.sqlite3'


def test_info_says_the_same_from_the_index_as_from_the_recording(
    file, tmp_path, capsys, monkeypatch
):
    folder = Walk(seconds=4.0).write(tmp_path / 'walk')
    told = []
    for place, name in enumerate(('first', 'second')):
        if place:  # nothing is left to read: the answer comes from the index
            monkeypatch.setattr(kept_quality.Recording, 'open', None)
        assert info([str(folder), '--json', str(tmp_path / f'{name}.json')]) == 0
        told.append((capsys.readouterr().out, (tmp_path / f'{name}.json').read_text()))
    assert told[0] == told[1]
    assert json.loads(told[0][1])[str(folder)]['drives']


def test_cards_of_folders_are_listed_by_robot_unit_and_date(file, tmp_path, capsys):
    for unit in '12':
        for day in (1, 2, 3):
            card = f"robot: leg\nunit: '{unit}'\ncreated: '2026-03-0{day}T08:00:00'\n"
            bag(tmp_path / 'bags' / f'unit{unit}' / f'day{day}', card)
    bag(tmp_path / 'bags' / 'broken', 'robot: [')
    with RecordingIndex(file) as index:
        added, left_out = add_cards(index, [tmp_path / 'bags'])
        assert (added, len(left_out)) == (6, 1)
        assert 'broken' in left_out[0]
        assert add_cards(index, [tmp_path / 'bags'])[0] == 0
        found = listed(index, 'leg', '2', '2026-03-02', '2026-03-03')
        assert [row['name'] for row in found] == ['day2']
    assert index_command(['--unit', '1', '--forget-lost']) == 0
    told = capsys.readouterr().out
    assert 'forgotten: 0' in told
    assert '3 recordings' in told


def test_tables_are_exported_for_pandas(file, tmp_path):
    pandas = pytest.importorskip('pandas')
    folder = Walk(seconds=4.0).write(tmp_path / 'walk')
    assert info([str(folder)]) == 0
    keep(file, folder)
    assert index_command(['--export', str(tmp_path / 'out')]) == 0
    names = ('recordings', 'quality', 'coefficients')
    cards, quality, fits = (pandas.read_parquet(tmp_path / 'out' / f'{n}.parquet') for n in names)
    assert list(cards['name']) == ['walk']
    assert set(quality['name']) == {'updates_hz', 'power_slope', 'velocity_slope', 'cells'}
    assert fits[['drive', 'name', 'value']].to_numpy().tolist() == [['A', 'idle', 8.0]]
    assert (fits['path'] == str(folder.resolve())).all()


def test_an_index_that_is_none_is_said_so(monkeypatch, capsys):
    monkeypatch.setenv('WATTWALK_INDEX', '')
    assert index_command([]) == 2
    assert 'WATTWALK_INDEX is empty' in capsys.readouterr().err
