import signal
import subprocess
import sys

import pytest
from rclpy.utilities import remove_ros_args
from wattwalk_core.command import command, entry_point, own_arguments
from wattwalk_core.errors import InputError


@pytest.mark.parametrize(
    ('given', 'own'),
    [
        ([], []),
        (['a', '--json', 'b'], ['a', '--json', 'b']),
        (['a', '--ros-args', '-p', 'x:=1', '--', 'b'], ['a', 'b']),
        (['--ros-args', '-r', 'a:=b', '--', '--', 'c', '--ros-args'], ['--', 'c']),
    ],
)
def test_arguments_for_ros_are_left_out_as_rclpy_does(given, own, monkeypatch):
    assert own_arguments(given) == own == remove_ros_args(given)
    monkeypatch.setattr(sys, 'argv', ['program', *given])
    assert own_arguments() == own


def test_bad_input_ends_with_one_line_and_exit_code_2(capsys):
    @command
    def refuse(args):
        raise InputError(f'{args} are bad')

    assert refuse(['a']) == 2
    assert capsys.readouterr().err.endswith(": ['a'] are bad\n")


def test_the_body_of_an_entry_point_is_imported_once_its_arguments_are_read(
    tmp_path, monkeypatch, capsys
):
    (tmp_path / 'slow_body.py').write_text('def run(number):\n    return number + 1\n')
    monkeypatch.syspath_prepend(str(tmp_path))

    @entry_point('slow_body:run', 'Counts.', '')
    def count(parser, args):
        if not args:
            raise InputError('give a number')
        return int(args[0])

    assert count([]) == 2
    assert 'give a number' in capsys.readouterr().err
    assert 'slow_body' not in sys.modules
    assert count(['2']) == 3
    monkeypatch.delitem(sys.modules, 'slow_body')


WAITING = """
import sys, time
from wattwalk_core.command import command

@command
def main(args):
    try:
        print('ready', flush=True)
        while True:
            time.sleep(0.1)
    except BaseException as error:
        if 'import' in args:
            raise ImportError('initialization failed') from error
        raise
    finally:
        print('closed', flush=True)

sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('arguments', [(), ('import',)])
def test_a_signal_ends_a_command_after_its_finally_clauses_with_the_usual_code(number, arguments):
    process = subprocess.Popen(
        [sys.executable, '-c', WAITING, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == 'ready\n'
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (128 + number, 'closed\n', '-c: interrupted\n')


SWALLOWING = """
import time
print('ready', flush=True)
try:
    time.sleep(0.5)
except BaseException:
    pass
print('imported', flush=True)
"""
LOSING = """
import time
class Slow:
    def __del__(self):
        print('ready', flush=True)
        time.sleep(0.5)
Slow()
print('imported', flush=True)
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('where', ['imported', 'destructor'])
def test_a_signal_that_an_import_or_a_destructor_would_lose_ends_a_command(
    number, where, tmp_path
):
    (tmp_path / 'slow.py').write_text(SWALLOWING if where == 'imported' else '')
    slow = 'import slow' if where == 'imported' else LOSING.replace('\n', '\n        ')
    program = WAITING.replace("print('ready', flush=True)", slow)
    process = subprocess.Popen(
        [sys.executable, '-c', program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    )
    assert process.stdout.readline() == 'ready\n'
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (128 + number, '-c: interrupted\n')
    assert out.endswith('closed\n')


def test_control_characters_of_bad_input_do_not_reach_the_terminal():
    assert str(InputError('no \x1b[31mname\nhere')) == r'no \x1b[31mname here'
    assert len(str(InputError('x' * 10_000))) < 1000


def test_importing_a_library_leaves_the_hooks_of_the_interpreter():
    program = (
        'import importlib, pkgutil, sys, wattwalk_core\n'
        'before = sys.excepthook, sys.unraisablehook\n'
        'assert before == (sys.__excepthook__, sys.__unraisablehook__)\n'
        'names = [module.name for module in pkgutil.iter_modules(wattwalk_core.__path__)]\n'
        'for name in names: importlib.import_module(f"wattwalk_core.{name}")\n'
        'assert (sys.excepthook, sys.unraisablehook) == before\n'
        'print(len(names))'
    )
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 10


def test_ctrl_c_while_the_module_of_a_command_is_imported_ends_with_one_line():
    importing = (
        'from wattwalk_core import early; early.install()\n'
        'import time; print("ready", flush=True); time.sleep(60)'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', importing],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == 'ready\n'
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=30)[1] == '-c: interrupted\n'


def test_ctrl_c_that_an_extension_module_makes_an_import_error_of_ends_with_one_line():
    importing = (
        'from wattwalk_core import early; early.install()\n'
        'import time; print("ready", flush=True)\n'
        'try:\n    time.sleep(60)\n'
        'except KeyboardInterrupt as error:\n'
        '    raise ImportError("initialization failed") from error\n'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', importing],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == 'ready\n'
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=30)[1] == '-c: interrupted\n'
    assert process.returncode == -signal.SIGINT


def test_a_signal_in_the_interpreters_own_end_makes_no_traceback():
    program = (
        'import atexit, sys, time\nfrom wattwalk_core.command import command\n'
        'def slow():\n    print("ending", flush=True)\n    time.sleep(60)\n'
        'atexit.register(slow)\n'
        '@command\ndef main(args):\n    return 0\n'
        'sys.exit(main())\n'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == 'ending\n'
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=30)[1] == ''
    assert process.returncode == -signal.SIGINT


def test_a_reader_that_leaves_early_ends_a_command_without_a_traceback():
    code = (
        'import sys\nfrom wattwalk_core.command import command\n\n\n'
        '@command\ndef speak(args):\n'
        '    for i in range(100_000):\n        print(i)\n\n\nsys.exit(speak())\n'
    )
    with subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as speaker:
        assert speaker.stdout.readline() == '0\n'
        speaker.stdout.close()
        assert speaker.stderr.read() == ''
        assert speaker.wait() == 128 + signal.SIGPIPE
