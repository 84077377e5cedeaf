"""Tracking on workers: the same JSON, lost workers, Ctrl-C, and recordings that workers lack."""

import json
import os
import signal
import sys
from multiprocessing import active_children
from pathlib import Path

import pytest
from aligned_bag import write
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.model_file.yaml_file import read_model
from power_estimator.judge.estimator import JudgeSettings
from power_fleet.commands.arguments import track as track_command
from power_fleet.track import reading
from power_fleet.track.outcome import Request
from power_fleet.track.recording_fit import from_bytes
from power_recordings.index.store import RecordingIndex, Stamp
from truth_circuit import Truth, record
from wattwalk_core.errors import InputError
from wattwalk_core.processes import ChildProcess, wait_until

KNOWN = ('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle')
COUNT = 8


@pytest.fixture(scope='module')
def days(tmp_path_factory):
    """Short walks by date, and a model."""
    folder = tmp_path_factory.mktemp('days')
    bags = []
    for index in range(COUNT):
        truth = Truth(dict.fromkeys(KNOWN, 1.0), 'walk', 12.0, index, 1)
        bag = write(folder / f'walk{index:02d}', record(truth))
        (bag / 'card.yaml').write_text(f"robot: leg\ncreated: '2026-03-{index + 1:02d}'\n")
        bags.append(str(bag))
    base = folder / 'base.yaml'
    base.write_text(f'format: power_model/1\nname: base\neffects: [shaft, {", ".join(KNOWN)}]\n')
    return bags, base


@pytest.fixture
def index(tmp_path, monkeypatch):
    path = tmp_path / 'index.sqlite3'
    monkeypatch.setenv('WATTWALK_INDEX', str(path))
    return path


def tracked(days, told, *more):
    bags, base = days
    assert track_command([*bags, '--model', str(base), '--json', str(told), *more]) == 0
    return told.read_text()


@pytest.fixture(scope='module')
def alone(days, tmp_path_factory):
    """JSON of one worker."""
    return tracked(days, tmp_path_factory.mktemp('alone') / 't.json', '--workers', '1')


def test_two_workers_one_of_them_killed_write_the_json_of_one(
    days, alone, index, tmp_path, monkeypatch
):
    keep, kept, killed = RecordingIndex.keep, [], []

    def keep_and_kill(self, *what):
        keep(self, *what)
        kept.append(what[0].path)
        if not killed:
            killed.append(active_children()[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    monkeypatch.setattr(RecordingIndex, 'keep', keep_and_kill)
    assert tracked(days, tmp_path / 't.json', '--workers', '2') == alone
    assert killed
    assert sorted(kept) == sorted(days[0])


def test_after_ctrl_c_the_fits_that_ended_are_not_made_again(
    days, alone, index, tmp_path, monkeypatch
):
    bags, base = days
    program = (
        'import sys; from power_fleet.commands.arguments import track as main; sys.exit(main())'
    )
    given = [*bags, '--model', str(base), '--workers', '2']
    log = tmp_path / 'track.log'
    with ChildProcess([sys.executable, '-c', program, *given], log) as process:
        assert wait_until(lambda: index.exists() and fits_in(index) >= 2, 120.0)
        process.interrupt()
        assert process.wait() == 130
    assert 'Traceback' not in process.output
    assert 'interrupted' in process.last_line
    there = fits_in(index)
    assert 2 <= there < COUNT
    made = []

    def fit(request, stamp):
        made.append(stamp)
        return fit_stamped(request, stamp)

    fit_stamped = reading.fit_stamped
    monkeypatch.setattr(reading, 'fit_stamped', fit)
    assert tracked(days, tmp_path / 't.json', '--workers', '1') == alone
    assert len(made) == COUNT - there


def fits_in(path):
    with RecordingIndex(path) as index:
        return len(index.rows("SELECT 1 FROM answers WHERE kind = 'fit'"))


def test_a_recording_that_a_worker_does_not_see_is_named_with_the_machine():
    request = Request(None, None)
    with pytest.raises(InputError, match=r'/nowhere/walk is not there on .*same path') as refusal:
        reading.fit_stamped(request, Stamp('/nowhere/walk', 1, 1))
    assert '\n' not in str(refusal.value)


def test_a_recording_that_is_another_one_on_the_worker_is_left_out(days):
    stamp = Stamp.of(Path(days[0][0]))
    fitted = reading.fit_stamped(Request(None, None), Stamp(stamp.path, stamp.size + 1, 1))
    assert fitted.facts is None
    assert 'another recording' in json.loads(fitted.content)['unfit']


def test_settings_of_a_request_reach_its_fits(days):
    known = builtin_catalogue()
    model, stamp = read_model(days[1], known), Stamp.of(Path(days[0][0]))
    settings = JudgeSettings(), JudgeSettings(fit=FitSettings(drawn_together=1))
    one, two = (
        from_bytes(reading.fit_stamped(Request(model, known, settings=own), stamp).content)
        for own in settings
    )
    assert (one.values == two.values).all()
    assert (one.covariance != two.covariance).any()


def test_users_effects_reach_the_workers(days, index, tmp_path):
    own = tmp_path / 'fan.py'
    own.write_text(
        'from power_estimator.effects import Effect, Excitation, Term\n\n\n'
        'class Fan(Effect):\n'
        '    """Air that fins move."""\n\n'
        "    name = 'fan'\n"
        "    physics = 'fins move air'\n"
        "    formula = 'k·|w|³'\n"
        "    terms = (Term('k', 'W·s³/rad³', 0.0, 1.0),)\n"
        "    acts_on = 'power'\n"
        "    excitation = Excitation('a ladder of speeds', speeds=(1.0, 2.0, 4.0))\n\n"
        '    def regressors(self, signals, **shape):\n'
        '        return abs(signals.velocity[..., None]) ** 3\n'
    )
    bags, base = days
    model = tmp_path / 'own.yaml'
    model.write_text(base.read_text().replace('idle]', 'idle, fan]'))
    given = ['--effects-path', str(own), '--json', str(tmp_path / 't.json'), '--workers', '2']
    assert track_command([*bags[:2], '--model', str(model), *given]) == 0
    series = json.loads((tmp_path / 't.json').read_text())['series']
    assert 'fan' in {one['effect'] for one in series}


def test_a_scheduler_that_is_no_address_is_refused_in_one_line(days, capsys):
    bags, base = days
    assert track_command([*bags, '--model', str(base), '--scheduler', 'nowhere']) == 2
    error = capsys.readouterr().err.strip()
    assert 'tcp://HOST:PORT' in error
    assert '\n' not in error
