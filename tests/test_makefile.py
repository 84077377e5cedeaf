"""`make test` and `make test-ros` run the tests marked alone, whatever failed before."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FAKE = """#!/bin/sh
echo "$*" >> {log}
case "$*" in
  *"-m alone"*) exit {alone};;
  *) exit {others};;
esac
"""

FAILING = """
import pytest
from pathlib import Path

def test_that_passes_the_second_time():
    seen = Path(__file__).with_suffix('.seen')
    first, _ = not seen.exists(), seen.touch()
    assert not first

@pytest.mark.xdist_group('live')
@pytest.mark.parametrize('address', ['a@b'])
def test_that_fails(address):
    assert address == 'b@a'
"""


def test_what_fails_in_a_group_is_run_again_and_fails_again(tmp_path):
    (tmp_path / 'test_it.py').write_text(FAILING)

    def rerun(*arguments):
        own = ['-c', str(ROOT / 'pyproject.toml'), '--rootdir', str(tmp_path)]
        options = ['-q', '-p', 'conftest', *own]
        return subprocess.run(
            [sys.executable, '-m', 'pytest', *options, *arguments, str(tmp_path)],
            env=os.environ | {'PYTHONPATH': os.pathsep.join([str(ROOT), *sys.path])},
            capture_output=True,
            text=True,
        )

    first = rerun('-n', '2', '--dist', 'loadgroup')
    assert '2 failed' in first.stdout, first.stdout + first.stderr
    again = rerun('--last-failed', '--last-failed-no-failures', 'none')
    assert '1 failed, 1 passed' in again.stdout, again.stdout + again.stderr
    assert again.returncode == 1


@pytest.mark.skipif(shutil.which('make') is None, reason='no make')
@pytest.mark.parametrize(('others', 'alone'), [(0, 0), (1, 0), (0, 1), (1, 1)])
@pytest.mark.parametrize('target', ['test', 'test-ros'])
def test_tests_marked_alone_run_always_and_any_failure_is_the_exit_code(
    target, others, alone, tmp_path
):
    log, folder = tmp_path / 'log', tmp_path / 'bin'
    folder.mkdir()
    python = folder / 'python'
    python.write_text(FAKE.format(log=log, alone=alone, others=others))
    python.chmod(0o755)
    (tmp_path / '.installed').touch()
    (tmp_path / 'setup.sh').write_text(f'PATH={folder}:$PATH\n')
    environment = {k: v for k, v in os.environ.items() if k not in ('ROS_DISTRO', 'MAKEFLAGS')}
    done = subprocess.run(
        ['make', '-o', 'setup', '-o', 'build-ros', f'VENV={tmp_path}', f'ROS={tmp_path}', target],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
    )
    runs = log.read_text().splitlines()
    assert runs[-1] == '-m pytest -q -m alone tests', done.stderr
    assert len(runs) == 2 + others
    assert (done.returncode == 0) == (others == alone == 0)


@pytest.mark.xdist_group('live')
def test_workers_of_make_test_run_the_live_tests_as_one_group(request):
    if not request.config.getoption('loadgroup', False):
        pytest.skip('not run by workers in groups')
    assert request.node.nodeid.endswith('@live')
