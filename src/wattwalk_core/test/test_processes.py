import os
import signal
import sys
import time

import pytest
from wattwalk_core.processes import ChildProcess, ProcessError, find_program, wait_until


@pytest.fixture
def python(tmp_path):
    """Starts Python code as a child process, and ends it with the test."""
    started = []

    def start(code, **environment):
        log = tmp_path / f'{len(started)}.log'
        started.append(ChildProcess([sys.executable, '-c', code], log, environment))
        return started[-1]

    yield start
    for process in started:
        process.kill()


WAITS = "import time; print('ready', flush=True); time.sleep(600)"
DEAF = (
    'import signal, time; [signal.signal(n, signal.SIG_IGN) for n in (signal.SIGINT, '
    "signal.SIGTERM)]; print('ready', flush=True); time.sleep(600)"
)


def alive(pid):
    try:
        with open(f'/proc/{pid}/stat') as file:
            return file.read().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False


def test_a_line_is_waited_for_and_its_groups_are_returned(python):
    process = python("import time; time.sleep(0.3); print('port 5025'); time.sleep(600)")
    assert process.wait_for_line(r'port (\d+)')[1] == '5025'
    assert process.running


def test_half_a_line_is_not_taken_for_a_line(python):
    process = python(
        "import sys, time; sys.stdout.write('port 50'); sys.stdout.flush(); time.sleep(0.5)\n"
        "print('25'); time.sleep(600)"
    )
    wait_until(lambda: process.output)
    assert process.lines == []
    assert process.wait_for_line(r'port (\d+)')[1] == '5025'


def test_standard_error_and_a_last_line_without_end_belong_to_the_output(python):
    process = python("import sys; print('out', flush=True); sys.stderr.write('bad')")
    assert process.wait() == 0
    assert process.lines == ['out', 'bad']
    assert process.wait_for_line('^bad$')


def test_a_process_that_ends_without_the_line_is_told_with_its_last_one(python):
    process = python("print('the device is gone'); raise SystemExit(3)")
    with pytest.raises(ProcessError, match="code 3 before it said 'ready': the device is gone"):
        process.wait_for_line('ready')


def test_success_and_a_run_that_goes_on_are_told_from_failure(python):
    fine, failed = python('pass'), python("print('no such bag'); raise SystemExit(2)")
    fine.succeed()
    with pytest.raises(ProcessError, match=r'^1 ended with code 2: no such bag \(.*/1.log\)$'):
        failed.succeed()
    with pytest.raises(ProcessError, match='code 0'):
        fine.check()
    python(WAITS).check()


def test_waiting_is_bounded(python):
    process = python(WAITS)
    process.wait_for_line('ready')
    began = time.monotonic()
    with pytest.raises(ProcessError, match=r"did not say 'never' within 0\.3 s: ready"):
        process.wait_for_line('never', timeout=0.3)
    with pytest.raises(ProcessError, match=r'did not end within 0\.3 s'):
        process.wait(0.3)
    assert time.monotonic() - began < 10.0
    assert process.running


def test_an_interrupt_ends_a_process_as_ctrl_c_does(python):
    process = python(WAITS)
    process.wait_for_line('ready')
    process.interrupt()
    assert process.wait() == -signal.SIGINT
    assert process.last_line == 'KeyboardInterrupt'
    process.interrupt()


def test_a_process_deaf_to_signals_is_killed_after_the_patience(python):
    process = python(DEAF)
    process.wait_for_line('ready')
    began = time.monotonic()
    assert process.end(0.4) == -signal.SIGKILL
    assert 0.8 <= time.monotonic() - began < 10.0


def test_one_that_listens_is_not_killed(python):
    process = python(
        'import signal, sys, time\n'
        'def end(*_):\n    time.sleep(0.5)\n    sys.exit(7)\n'
        "signal.signal(signal.SIGINT, end); print('ready', flush=True); time.sleep(600)"
    )
    process.wait_for_line('ready')
    assert process.end() == 7
    assert process.end() == 7


def test_children_that_outlive_a_process_are_killed_with_it(python):
    process = python(
        'import subprocess, sys, time\n'
        f'child = subprocess.Popen([sys.executable, "-c", {DEAF!r}])\n'
        "time.sleep(0.2); print('child', child.pid, flush=True); time.sleep(600)"
    )
    child = int(process.wait_for_line(r'child (\d+)')[1])
    process.wait_for_line('ready')
    assert alive(child)
    process.end()
    assert wait_until(lambda: not alive(child), 10.0)


def test_an_error_inside_the_context_ends_the_process(tmp_path):
    def fail_while(process):
        with process:
            process.wait_for_line('ready')
            raise ZeroDivisionError

    process = ChildProcess([sys.executable, '-c', WAITS], tmp_path / 'log')
    with pytest.raises(ZeroDivisionError):
        fail_while(process)
    assert not process.running


def test_a_signal_to_this_process_group_does_not_reach_it(python):
    process = python(WAITS)
    process.wait_for_line('ready')
    assert os.getpgid(process.pid) == process.pid != os.getpgrp()


def test_its_environment_is_this_one_with_what_is_added(python):
    process = python("import os; print(os.environ['HOME'], os.environ['ADDED'])", ADDED='more')
    assert process.wait() == 0
    assert process.output == f'{os.environ["HOME"]} more\n'


def test_cpu_time_is_counted_with_that_of_children(python):
    burn = 'import time; t = time.process_time()\nwhile time.process_time() - t < 0.3: pass\n'
    process = python(
        'import subprocess, sys, time\n'
        f'subprocess.Popen([sys.executable, "-c", {burn + "time.sleep(600)"!r}])\n'
        f'{burn}time.sleep(600)'
    )
    assert wait_until(lambda: process.cpu_seconds() >= 0.55)


def test_a_program_beside_this_python_comes_first_and_one_that_is_missing_is_told():
    name = os.path.basename(sys.executable)
    assert find_program(name) == sys.executable
    with pytest.raises(ProcessError, match='no command no-such-program'):
        find_program('no-such-program')
