"""
Files of others: whatever is in them, a command ends in one line and leaves nothing.

Some 1,400 inputs: seeded damage to a valid log of every kind, files made on purpose, values of
maps, cards and metadata, and paths that are no files.
"""

import contextlib
import io
import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest
from crafted_bags import mcap_files, ros1_files, sqlite_files, zstd_zeros
from crafted_tables import (
    arrow_files,
    delimited_files,
    hdf5_files,
    json_files,
    mat_files,
    workbooks,
)
from hostile_files import BAG_MAP, TABLE_MAP, TABLES, damaged, mcap_bag, special_paths, write_logs
from power_recordings.commands.arguments import import_logs as import_command
from power_recordings.commands.arguments import info as info_command
from power_recordings.reading.reader import open_recordings

SEEDS = {
    'csv': 40,
    'tsv': 20,
    'json': 40,
    'jsonl': 20,
    'h5': 40,
    'parquet': 50,
    'feather': 40,
    'xlsx': 30,
    'bag': 60,
    'mcap': 90,
    'db3': 50,
    'mat': 3,
}
CRAFTED: dict[str, Callable[[Path], Iterator[tuple[str, bytes]]]] = {
    'csv': lambda folder: delimited_files(),
    'json': lambda folder: json_files(),
    'mcap': lambda folder: mcap_files(),
    'bag': lambda folder: ros1_files(),
    'db3': sqlite_files,
    'xlsx': lambda folder: workbooks(),
    'h5': hdf5_files,
    'arrow': lambda folder: arrow_files(),
    'mat': lambda folder: mat_files(),
}
HOSTILE_VALUES = (
    '~',
    '5',
    '-1',
    'true',
    '[]',
    '{}',
    '[[a]]',
    '{a: b}',
    '""',
    '.nan',
    '.inf',
    '1e999',
    '9' * 400,
    '"\\e[31mred\\a"',
    'x' * 5000,
    '[1, 2',
    '[' * 900,
    '&a [*a, *a]',
    '!!python/object/apply:os.system [id]',
    '{<<: {a: b}}',
    '2026-01-01',
    '0x7fffffffffffffffffff',
    'a*b*c*' * 50,
    '9**9**9**9',
    '"N*m**9**9**9"',
    '/dev/zero',
    '../../../../etc/passwd',
)


class Ended(NamedTuple):
    code: int
    out: str
    error: str


@pytest.fixture(scope='module', autouse=True)
def _limited() -> Iterator[None]:
    """At most 4 GB of addresses more than the tests take as they begin."""
    pages = int(Path('/proc/self/statm').read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    most = pages * resource.getpagesize() + (4 << 30)
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.fixture(scope='module')
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_logs(tmp_path_factory.mktemp('logs'))


@pytest.fixture(scope='module')
def maps(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp('maps')
    (folder / 'table.yaml').write_text(TABLE_MAP)
    (folder / 'bag.yaml').write_text(BAG_MAP)
    return {'table': folder / 'table.yaml', 'bag': folder / 'bag.yaml'}


def ended(command: Callable[[Sequence[str]], int], args: Sequence[object], what: str) -> Ended:
    """Run a command; it ends well or with one line, without control characters on the terminal."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            code = command([str(a) for a in args])
        except BaseException as failure:
            raise AssertionError(f'{what}: {failure!r}') from failure
    found = Ended(code, out.getvalue(), error.getvalue())
    assert code in (0, 2), what
    assert found.error.count('\n') == (code == 2), f'{what}: {found.error[:500]}'
    assert len(found.error) < 2500, what
    shown = (found.out + found.error).replace('\n', '')
    assert all(c.isprintable() for c in shown), f'{what}: {shown!r:.500}'
    return found


def tried(file: Path, mapping: Path, what: str) -> Ended:
    """List a file and import it; nothing is left of a failed import, nor beside it."""
    before = sorted(os.listdir(file.parent))
    if file.suffix != '.mat':  # it takes a process
        ended(import_command, [file, '--list'], f'--list, {what}')
    out = file.parent / 'out'
    result = ended(import_command, [file, '--map', mapping, '-o', out], what)
    if result.code == 0:
        shutil.rmtree(out)
    assert sorted(os.listdir(file.parent)) == before, what
    return result


@pytest.mark.parametrize('kind', SEEDS)
def test_damaged_logs(
    tmp_path: Path, logs: dict[str, Path], maps: dict[str, Path], kind: str
) -> None:
    data = logs[kind].read_bytes()
    mapping = maps['table' if kind in TABLES else 'bag']
    assert tried(logs[kind], mapping, 'undamaged').code == 0
    for seed in range(SEEDS[kind]):
        file = tmp_path / f'log.{kind}'
        file.write_bytes(damaged(data, seed))
        tried(file, mapping, f'{kind} with the damage of seed {seed}')
        if kind in ('mcap', 'db3'):
            ended(info_command, [file], f'info, {kind} with the damage of seed {seed}')


@pytest.mark.parametrize('kind', CRAFTED)
def test_files_made_on_purpose(tmp_path: Path, maps: dict[str, Path], kind: str) -> None:
    is_bag = kind in ('mcap', 'bag', 'db3')
    (tmp_path / 'made').mkdir()
    for what, data in CRAFTED[kind](tmp_path / 'made'):
        ending = what.split(':')[0] if kind == 'arrow' else kind
        folder = tmp_path / 'case'
        folder.mkdir()
        file = folder / f'log.{ending}'
        file.write_bytes(data)
        tried(file, maps['bag' if is_bag else 'table'], f'{kind}: {what}')
        if is_bag and kind != 'bag':
            ended(info_command, [file], f'info of {kind}: {what}')
        shutil.rmtree(folder)


def test_a_damaged_recording_says_what_it_lacks(tmp_path: Path) -> None:
    files = dict(mcap_files())
    for what, line in (
        ('a chunk that lies: 1', 'a damaged chunk was left out'),
        (
            'record 6 of 9223372036854775807 bytes',
            'bytes of an unfinished chunk at its end are lost',
        ),
        ('a wrong checksum', 'wrong checksum'),
        ('records of nothing', 'bytes of a chunk are damaged'),
        ('131 kB that unpack to 4 GB, told, size 1000', 'more than its 1000 bytes'),
    ):
        (tmp_path / 'log.mcap').write_bytes(files[what])
        found = ended(info_command, [tmp_path / 'log.mcap'], what)
        assert line in found.out + found.error, what


def test_commands_that_read_recordings_say_what_one_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = mcap_bag(tmp_path / 'walk') / 'walk_0.mcap'
    open_recordings([whole])
    assert not capsys.readouterr().err
    (tmp_path / 'cut.mcap').write_bytes(whole.read_bytes()[:-200])
    open_recordings([tmp_path / 'cut.mcap'])
    assert 'note: ' in (said := capsys.readouterr().err)
    assert 'cut.mcap was not closed (no index)' in said


@pytest.mark.parametrize('key', ['', *re.findall(r'(\w+):', TABLE_MAP)][::3])
def test_maps_of_others(tmp_path: Path, logs: dict[str, Path], key: str) -> None:
    for value in HOSTILE_VALUES:
        text = replaced(TABLE_MAP, key, value) if key else value
        (tmp_path / 'map.yaml').write_text(text)
        tried_map = [logs['csv'], '--map', tmp_path / 'map.yaml', '-o', tmp_path / 'out']
        if ended(import_command, tried_map, f'map, {key}: {value:.60}').code == 0:
            shutil.rmtree(tmp_path / 'out')
        assert os.listdir(tmp_path) == ['map.yaml']


def replaced(text: str, key: str, value: str) -> str:
    """Replace the value of the first `key` in YAML, with all lines that belong to it."""
    inline = re.sub(
        rf'(?m)(\{{|, )({key}): [^,}}\n]+', rf'\g<1>{key}: {quoted(value)}', text, count=1
    )
    if inline != text:
        return inline
    pattern = rf'(?m)^( *){key}:.*(?:\n\1 +.*)*'
    return re.sub(pattern, rf'\g<1>{key}: {quoted(value)}', text, count=1)


def quoted(value: str) -> str:
    return value.replace('\\', '\\\\')


@pytest.mark.parametrize('file', ['metadata.yaml', 'card.yaml'])
def test_recordings_with_hostile_yaml(tmp_path: Path, maps: dict[str, Path], file: str) -> None:
    bag = mcap_bag(tmp_path / 'walk')
    (bag / 'card.yaml').write_text(
        'robot: x\nunit: y\ndrives: [HIP]\nseed: 1\ntorque: {HIP: joint}\nimported: {a: b}\n'
    )
    good = (bag / file).read_text()
    keys = list(dict.fromkeys(re.findall(r'(?m)^[ -]*(\w+):', good)))[::2]
    for key in ('', *keys):
        for value in HOSTILE_VALUES[:: 1 if not key else 8]:
            text = replaced(good, key, value) if key else value
            (bag / file).write_text(text)
            what = f'{file}, {key}: {value:.60}'
            ended(info_command, [bag], f'info, {what}')
            if not key:
                tried(bag, maps['bag'], what)


@pytest.mark.parametrize(
    'ending', ['.csv', '.mcap', '.bag', '.db3', '.h5', '.mat', '.xlsx', '', '.x']
)
def test_paths_that_are_no_files(
    tmp_path: Path, logs: dict[str, Path], maps: dict[str, Path], ending: str
) -> None:
    for what, path in special_paths(tmp_path, ending):
        what = f'{what}{ending}'
        for command, args in (
            (import_command, [path, '--list']),
            (import_command, [path, '--map', maps['table'], '-o', tmp_path / 'out']),
            (import_command, [logs['csv'], '--map', path, '-o', tmp_path / 'out']),
            (info_command, [path]),
        ):
            assert ended(command, args, what).code == 2, what
        assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('name', ['walk_0.mcap', 'metadata.yaml', 'card.yaml'])
def test_bags_whose_files_are_none(tmp_path: Path, name: str) -> None:
    for what, path in special_paths(tmp_path, '.special'):
        bag = tmp_path / 'walk'
        mcap_bag(bag)
        (bag / name).unlink(missing_ok=True)
        if len(path.name) < 200:
            (bag / name).symlink_to(path)
        ended(info_command, [bag], f'{name}: {what}')
        shutil.rmtree(bag)


def test_outputs_that_cannot_be_written_leave_nothing(
    tmp_path: Path, logs: dict[str, Path], maps: dict[str, Path]
) -> None:
    (tmp_path / 'file').write_text('mine')
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'folder' / 'thesis').write_text('mine')
    before = sorted(tmp_path.rglob('*'))
    for out in ('file', 'folder', 'file/below', 'x' * 5000, '/proc/no/bag', '/dev/null'):
        for more in ([], ['--overwrite']):
            args = [logs['csv'], '--map', maps['table'], '-o', tmp_path / out, *more]
            assert ended(import_command, args, out).code == 2
            assert sorted(tmp_path.rglob('*')) == before


@pytest.mark.parametrize(
    ('name', 'data'),
    [
        ('log.mcap', dict(mcap_files())['131 kB that unpack to 4 GB, told, size 4294967296']),
        ('log.mcap', dict(mcap_files())['60 names of 100000 bytes']),
        ('log.csv', b'x' * (100 << 20)),
        ('log.json', b'[' * (20 << 20)),
        ('log.zst', zstd_zeros(4 << 30, says=False)),
    ],
    ids=['bomb', 'names', 'line', 'nesting', 'unknown'],
)
def test_hostile_files_take_little_memory(
    tmp_path: Path, maps: dict[str, Path], name: str, data: bytes
) -> None:
    (tmp_path / name).write_bytes(data)
    # ru_maxrss of a child begins with the memory of the process that started it; VmHWM does not.
    code = (
        'import re, pathlib; from power_recordings.commands.arguments import import_logs as main; '
        'code = main(); status = pathlib.Path("/proc/self/status").read_text(); '
        'print(re.search(r"VmHWM:\\s*(\\d+) kB", status)[1]); raise SystemExit(code)'
    )
    mapping = maps['bag' if name.endswith('mcap') else 'table']
    done = subprocess.run(
        [sys.executable, '-c', code, str(tmp_path / name), '--map', str(mapping), '-o', 'out'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30)),
    )
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert int(done.stdout.split()[-1]) < 1_000_000  # kB
    assert os.listdir(tmp_path) == [name]
