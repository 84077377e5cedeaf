"""Work in a process of its own: results, errors, cancelling, and its end with its owner."""

import os
import subprocess
import sys

import pytest
from power_workbench.sessions.jobs import JobRunner
from power_workbench.sessions.session import WorkbenchSession
from power_workbench.sessions.source import Source
from power_workbench.sessions.steps import SessionRecord, SessionStep
from wattwalk_core.errors import InputError
from wattwalk_core.processes import wait_until


@pytest.fixture
def heard():
    return []


@pytest.fixture
def runner(heard):
    made = JobRunner(lambda job, kind, content: heard.append((kind, content)))
    yield made
    made.close()


def running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_an_error_that_the_user_can_mend_is_one_line_and_the_worker_goes_on(runner, heard):
    missing = {'source': Source(('/no/such/bag',)), 'spec': ''}
    first = runner.run('open', 'open', missing)
    assert wait_until(lambda: first.state != 'running', 120)
    assert first.state == 'error'
    assert '/no/such/bag' in first.error
    pid = runner.pid
    second = runner.run('effects', 'effects', {'files': []})
    assert wait_until(lambda: second.state != 'running', 60)
    assert second.state == 'done'
    assert runner.pid == pid
    assert heard[-1] == ('done', {})


def test_a_worker_that_cannot_be_started_leaves_no_job_behind(runner, monkeypatch):
    def refuse(*args, **kwargs):
        raise OSError('no memory')

    with monkeypatch.context() as without:
        without.setattr(subprocess, 'Popen', refuse)
        with pytest.raises(OSError, match='no memory'):
            runner.run('effects', 'effects', {'files': []})
    assert not runner.busy
    job = runner.run('effects', 'effects', {'files': []})
    assert wait_until(lambda: job.state == 'done', 120)


def test_a_cancelled_job_ends_with_its_process_and_the_next_one_runs(runner, heard):
    job = runner.run('open', 'open', {'source': Source(('/no/such/bag',)), 'spec': ''})
    pid = runner.pid
    with pytest.raises(RuntimeError):
        runner.run('other', 'effects', {'files': []})
    runner.cancel()
    assert job.state == 'cancelled'
    assert heard == [('cancelled', None)]
    assert not running(pid)
    after = runner.run('effects', 'effects', {'files': []})
    assert wait_until(lambda: after.state != 'running', 120)
    assert after.state == 'done'


def test_a_budget_is_told_beside_the_jobs_and_its_error_is_no_error_of_theirs(runner, heard):
    missing = {'source': Source(('/no/such/bag',)), 'spec': ''}
    runner.beside('budget', missing)
    job = runner.run('effects', 'effects', {'files': []})
    assert wait_until(lambda: {kind for kind, _ in heard} >= {'budget', 'done'}, 120)
    assert job.state == 'done'
    (told,) = (content for kind, content in heard if kind == 'budget')
    assert told['spec'] == ''
    assert '/no/such/bag' in told['content']['error']


def test_a_worker_that_is_killed_is_an_error_and_not_a_wait(runner):
    job = runner.run('open', 'open', {'source': Source(('/no/such/bag',)), 'spec': ''})
    os.kill(runner.pid, 9)
    assert wait_until(lambda: job.state != 'running', 30)
    assert job.state == 'error'
    assert 'ended unexpectedly' in job.error


def test_a_worker_ends_with_the_process_that_owns_it():
    program = (
        'import os; from power_workbench.sessions.jobs import JobRunner\n'
        'runner = JobRunner(lambda *_: None); runner.warm()\n'
        'print(runner.pid, flush=True); os.kill(os.getpid(), 9)'
    )
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    pid = int(run.stdout)
    assert wait_until(lambda: not running(pid), 60)


def test_a_full_disk_leaves_the_session_as_it_was(tmp_path, monkeypatch):
    record = SessionRecord().do(SessionStep('open', recordings=('/no/such/bag',)))
    record = record.do(SessionStep('fit', effects=('idle',), model='model_1.yaml'))
    record.save(tmp_path)
    before = (tmp_path / 'session.yaml').read_bytes()
    session = WorkbenchSession(tmp_path, record, lambda: None)

    def full(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('wattwalk_core.files.os.fsync', full)
    with pytest.raises(InputError, match='disk is full'):
        session.go(1)
    assert session.record == record
    assert (tmp_path / 'session.yaml').read_bytes() == before
    session.close()


EFFECT = """
from power_estimator.effects import Effect, Term

class Drag(Effect):
    name, physics, formula = 'drag', 'a cable drags', 'c'
    terms = (Term('c', 'W', 0.0, 5.0),)

    def regressors(self, signals, **shape):
        return 0.0 * signals.torque[..., None]
"""


def test_effects_that_were_allowed_leave_the_model_and_what_was_learned_as_they_are(tmp_path):
    file = tmp_path / 'effects_1.py'
    file.write_text(EFFECT)
    record = SessionRecord().do(SessionStep('open', recordings=('/no/such/bag',)))
    record = record.do(SessionStep('fit', effects=('idle',), model='model_1.yaml'))
    session = WorkbenchSession(tmp_path, record, lambda: None)
    key = session.judged
    session._seen.views[key], session._seen.learned[key] = 'the view', {'found': 'drag'}
    session.take(SessionStep('effects', file=str(file)))
    assert wait_until(lambda: len(session.record.steps) == 3, 120), session.error
    assert session.judged != key
    assert session.view == 'the view'
    assert session.learned == {'found': 'drag'}
    assert SessionRecord.read(tmp_path).effect_files == (str(file),)
    session.close()


def test_effects_of_a_file_that_was_not_allowed_are_not_run(tmp_path):
    opened = SessionStep('open', recordings=('/no/such/bag',))
    record = SessionRecord().do(opened).do(SessionStep('effects', file='/some/effect.py'))
    session = WorkbenchSession(tmp_path, record, lambda: None)
    session.resume()
    assert 'allow this file to be run' in session.error
    assert session.runner.pid is None
    with pytest.raises(InputError, match='allow'):
        session.take(SessionStep('fit', effects=('idle',)))
    session.close()
