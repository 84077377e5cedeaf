"""One model on the same recordings has one error, whoever states it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from power_estimator.commands.arguments import benchmark as benchmark_command
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.judge.estimator import JudgeSettings
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import load
from power_estimator.judge.result import over_meters
from power_lab.budget import choice
from power_lab.commands.arguments import add as add_command
from power_lab.commands.arguments import budget as budget_command
from power_lab.commands.arguments import compare as compare_command
from power_lab.commands.arguments import diagnose as diagnose_command
from power_lab.commands.arguments import fit as fit_command
from power_workbench.sessions.source import Source
from power_workbench.sessions.steps import SessionStep
from power_workbench.sessions.worker import SessionWorker
from simulated_leg import bag  # noqa: F401

from power_lab import Session

WALK = Path(__file__).resolve().parents[1] / 'bags' / 'walk_small'
EFFECTS = 'shaft,copper_loss,idle'
ADDED = 'viscous_friction'


@pytest.fixture(scope='module', params=['walk_small', 'leg'])
def recording(request):
    return WALK if request.param == 'walk_small' else request.getfixturevalue('bag')


@pytest.fixture(scope='module')
def models(recording, tmp_path_factory):
    """A model as the commands fit it, and with an effect added."""
    folder = tmp_path_factory.mktemp('models')
    base, better = (str(folder / f'{name}.yaml') for name in ('base', 'better'))
    assert fit_command([str(recording), '--effects', EFFECTS, '-o', base]) == 0
    add = [ADDED, '--to', base, '--bag', str(recording), '-o', better]
    assert add_command(add) == 0
    return base, better


def written(command, folder, *arguments):
    file = folder / 'out.json'
    assert command([*map(str, arguments), '--json', str(file)]) == 0
    return json.loads(file.read_text())


def by_drive(content):
    return {name: scores['rmse_w'] for name, scores in content['drives'].items()}


def over_drives(content):
    return over_meters(by_drive(content).values())


def ignored(*_):
    pass


@pytest.fixture
def short_pieces(monkeypatch):
    """Choose models on a part of the recordings, as of those that are long for their drives."""
    monkeypatch.setattr(choice, '_FEWEST', 2)
    monkeypatch.setattr(choice, '_DRIVE_SECONDS', 0.0)


def test_every_command_the_page_and_python_state_the_same_error(
    recording, models, tmp_path, short_pieces
):
    fit, add = yaml.safe_load(Path(models[1]).read_text())['history']
    lab = Session.open(recording).load(models[1])
    source, worker = Source((str(recording),)), SessionWorker()
    page = worker.judge(ignored, source, models[1])['view'].content
    step = SessionStep('add', effects=(ADDED,))
    added = worker.shape(ignored, source, models[0], step, tmp_path / 'page.yaml')
    stairs = lab.stairs().errors
    report, told = tmp_path / 'why.html', []
    worker.budget(told.append, source, models[1])
    assert [bool(one['content'].get('first')) for one in told] == [True, False]
    (compared,) = written(compare_command, tmp_path, recording, '--models', models[1])['models']
    diagnosed = written(
        diagnose_command, tmp_path, recording, '--model', models[1], '--report', report
    )
    stated = {
        'history of add': over_meters(add['rmse_w'].values()),
        'staircase': stairs[1],
        'compare': over_drives(compared),
        'benchmark': over_drives(
            written(benchmark_command, tmp_path, recording, '--models', models[1])['models'][0]
        ),
        'diagnose': over_drives(diagnosed),
        'budget': written(budget_command, tmp_path, recording, '--model', models[1])[
            'held_out_rmse_w'
        ],
        'Session': lab.score.rms_w,
        'page, judged': over_drives(page),
        'page, step': over_drives(added['view'].content),
        'page, line': worker.line(ignored, source, models[1])['rmse_w'],
        'page, budget': told[-1]['content']['held_out_rmse_w'],
    }
    assert stated == pytest.approx(dict.fromkeys(stated, stated['Session']), abs=1e-6)
    assert by_drive(diagnosed) == pytest.approx(by_drive(compared), abs=1e-6)
    before = over_meters(fit['rmse_w'].values())
    for error in (before, stated['Session']):
        assert f'{error:.2f}' in report.read_text()
    assert over_meters(add['rmse_before_w'].values()) == pytest.approx(before, abs=1e-6)
    assert stairs[0] == pytest.approx(before, abs=1e-6)
    assert before > stated['Session']


def test_a_chosen_model_has_the_error_that_compare_gives_it(recording, short_pieces):
    lab = Session.open(recording)
    assert choice.judge_of_pieces(lab.judge) is not lab.judge
    found = lab.budget()
    assert found.chosen
    assert found.error_w == pytest.approx(replace(lab, given=found.model).score.rms_w, abs=1e-6)


def test_a_recording_beside_with_a_faulty_meter_changes_no_error(models, recording, bag):  # noqa: F811
    lab = Session.open(recording).load(models[1])
    drives = [name for name in lab.judge.prepared.names if name.startswith('LF')]
    alone = load([recording], drives)
    both = load([recording, bag if recording == WALK else WALK], drives)
    beside = both.data.recording == 1
    faulty = np.where(beside[:, None], 1.2 * both.data.power + 10.0, both.data.power)
    sound, both = both, replace(both, data=replace(both.data, power=faulty.astype(np.float32)))
    one, two, three = (Judge(given).score(lab.model) for given in (alone, both, sound))
    rows = Judge(both).prepared.recording == 0
    own = np.sqrt(np.nanmean(np.square(two.residual[rows]), axis=0))
    assert dict(zip(drives, own, strict=True)) == pytest.approx(
        {name: score.rmse_w for name, score in one.drives.items()}, abs=1e-6
    )
    assert two.rms_w > three.rms_w, 'the fault shows'


def test_settings_of_a_session_reach_every_fit(bag, monkeypatch):  # noqa: F811
    asked = FitSettings(bootstraps=50)
    seen = []
    made = Fitter.__init__

    def noted(fitter, *arguments, **how):
        made(fitter, *arguments, **how)
        seen.append(fitter.settings)

    monkeypatch.setattr(Fitter, '__init__', noted)
    opened = Session.open(bag, settings=JudgeSettings(fit=asked))
    lab = opened.fit(EFFECTS)
    on_base = opened.fit('viscous_friction', base='mechanical_power')
    for step in (lab.diagnose, lab.discover, on_base.discover, lab.budget, opened.budget):
        step()
    assert set(seen) == {asked}
