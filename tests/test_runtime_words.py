"""Tests and benches leave to the props how a runtime's `ros2` is called and what it adds."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
KNOWN_TO = {
    'conftest.py': 'the lines and the exit codes of `ros2 run`',
    'bench/runtimes.py': 'both runtimes side by side',
    'tests/test_runtime_words.py': 'this list',
}
TAKEN_FOR_GRANTED = {
    'a path of a runtime': r'venv/bin|\.ros/venv',
    'a ros2 beside this Python': r"""(with_name|which)\(['"]ros2['"]""",
    "a line of ROS 2's ros2 run": r'ros2run\]|exited with failure',
    'how ros2 run is ended': r'in \([^()]*-signal\.SIGTERM',
}
FILES = sorted(
    {
        *ROOT.glob('tests/**/*.py'),
        *ROOT.glob('src/*/test/**/*.py'),
        *ROOT.glob('embedded/test/**/*.py'),
        *ROOT.glob('bench/*.py'),
        ROOT / 'conftest.py',
    }
)


@pytest.mark.parametrize('taken_for_granted', TAKEN_FOR_GRANTED)
def test_no_test_takes_a_runtime_for_granted(taken_for_granted):
    pattern = re.compile(TAKEN_FOR_GRANTED[taken_for_granted])
    names = {file.relative_to(ROOT).as_posix(): file for file in FILES}
    found = {name for name, file in names.items() if pattern.search(file.read_text('utf-8'))}
    assert len(names) > 100
    assert found - {*KNOWN_TO} == set()


def test_no_package_handles_signals_or_spins_but_the_core():
    pattern = re.compile(
        r'signal\.signal\(|set_wakeup_fd|rclpy\.(spin|init)|(Single|Multi)ThreadedExecutor\('
    )
    files = {file.relative_to(ROOT / 'src'): file for file in ROOT.glob('src/*/*/**/*.py')}
    found = {
        str(name)
        for name, file in files.items()
        if name.parts[1] != 'test' and pattern.search(file.read_text('utf-8'))
    }
    core = 'wattwalk_core/wattwalk_core'
    assert found == {
        *(f'{core}/early.py', f'{core}/command.py'),
        f'{core}/nodes/running.py',
    }
