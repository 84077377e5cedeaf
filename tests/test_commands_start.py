"""Commands answer `--help` and a wrong argument before they import what is slow to import."""

import ast
import subprocess
import sys

import pytest
from commands_start import SOURCES, entry_points

SLOW = {
    *('torch', 'scipy', 'sklearn', 'plotly', 'mujoco', 'pandas', 'pyarrow', 'arch', 'rclpy'),
    *('matplotlib', 'statsmodels'),
}
COMMANDS = entry_points()
PROGRAM = """
import sys
from {module} import {function} as main
for argument in ('--help', '--no-such-option'):
    sys.argv = ['{name}', argument]
    try:
        code = main()
    except SystemExit as end:
        code = end.code
    print(argument, code or 0)
print(*sys.modules)
"""


def test_every_package_of_nodes_and_commands_is_looked_at():
    assert len(COMMANDS) > 25


@pytest.mark.parametrize('command', COMMANDS, ids=' '.join)
def test_help_and_a_wrong_argument_import_nothing_slow(command):
    module, function = COMMANDS[command]
    program = PROGRAM.format(module=module, function=function, name=command[1])
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    *_, modules = run.stdout.splitlines()
    assert '--help 0' in run.stdout
    assert '--no-such-option 2' in run.stdout
    assert SLOW.isdisjoint(modules.split())
    package, name = command
    assert f'usage: ros2 run {package} {name}' in run.stdout
    assert 'example' in run.stdout, 'the help shows how to use the command'


def test_commands_print_after_their_files_are_written_as_a_reader_may_leave_early():
    early, seen = [], 0
    for file in SOURCES.glob('*/*/commands/*.py'):
        for body in ast.parse(file.read_text()).body:
            calls = [each for each in ast.walk(body) if isinstance(each, ast.Call)]
            named = [(ast.unparse(each.func), each.lineno) for each in calls]
            lines = [line for name, line in named if name in ('together', 'write_json')]
            seen += bool(lines)
            printed = [each for each in named if each[0].lstrip('_').startswith('print')]
            early += [(file.name, *each) for each in printed if each[1] < max(lines, default=0)]
    assert seen > 8
    assert early == []
