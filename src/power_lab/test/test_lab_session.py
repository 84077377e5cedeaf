"""The loop in Python."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from power_estimator.judge.estimator import JudgeSettings
from power_estimator.judge.judge import Judge
from power_lab.commands.arguments import add as add_command
from wattwalk_core.errors import InputError

from power_lab import Session

ROOT = Path(__file__).resolve().parents[3]
WALK = ROOT / 'bags' / 'walk_small'


@pytest.fixture(scope='module')
def lab():
    return Session.open(WALK).fit('shaft copper_loss idle')


def test_the_lines_of_the_readme_run(monkeypatch, capsys):
    (lines,) = re.findall(r'```python\n(.*?)```', (ROOT / 'README.md').read_text('utf-8'), re.S)
    assert len(lines.split('\n')) - lines.count('\n\n') - 1 == 5
    monkeypatch.chdir(ROOT)
    exec(lines, {})
    sentence, first, last = capsys.readouterr().out.splitlines()
    assert sentence.startswith(
        'The series spring and rotor inertia are missing: '
        'with them the held-out error falls from 31.69 to 17.78 W'
    )
    assert first.split() == ['31.69', 'W', 'fit']
    error, step = last.split(' W  ')
    assert float(error) < 4.0
    assert step == 'viscous_friction, spring, rotor_inertia, load_friction'


def test_each_step_returns_another_session_and_leaves_the_one_before(lab):
    before = lab.effects
    better = lab.add('load_friction')
    assert lab.effects is before
    assert str(lab) == 'walk_small: shaft, copper_loss, idle'
    assert str(Session(lab.judge)) == 'walk_small: no model yet'
    assert better.effects.effects == ('shaft', 'copper_loss', 'idle', 'load_friction')
    assert better.score.rms_w < lab.score.rms_w
    less = better.remove('load_friction')
    assert less.effects.effects == before.effects
    assert less.score.rms_w == pytest.approx(lab.score.rms_w, abs=1e-6)
    assert [entry['step'] for entry in less.effects.history] == ['fit', 'add', 'fit']


def test_a_diagnosis_is_judged_by_the_settings_of_the_sessions_judge(lab):
    knee = replace(lab.recordings, data=lab.recordings.data.drives(['LF_KFE']))
    settings = JudgeSettings(settling=5.0)
    usual, later = (Judge(knee, lab.judge.catalogue, one) for one in (None, settings))
    own = Session(later).fit('shaft copper_loss idle')
    assert own.score.rms_w != pytest.approx(replace(own, judge=usual).score.rms_w, abs=0.01)
    found = own.diagnose()
    assert found.judged.before.rms_w == pytest.approx(own.score.rms_w, abs=1e-6)
    assert found.sentence in str(found).splitlines()  # as the command prints it


def test_effects_are_added_and_removed_with_coefficients_shared_as_before(lab, tmp_path):
    def owners(model):
        return [group.type.name for group in model.groups]

    assert owners(lab.effects) == owners(lab.add('load_friction').effects) == ['HAA', 'HFE', 'KFE']
    own = lab.fit('shaft copper_loss idle', per='drive')
    drives = owners(own.effects)
    assert len(drives) == 12
    assert owners(own.add('load_friction').effects) == drives
    assert owners(own.remove('idle').effects) == drives
    assert owners(own.add('load_friction', per='type').effects) == owners(lab.effects)
    file, better = own.save(tmp_path / 'own.yaml'), tmp_path / 'better.yaml'
    add_command(['load_friction', '--to', str(file), '--bag', str(WALK), '-o', str(better)])
    assert owners(own.load(str(better)).effects) == drives


def test_the_staircase_has_the_figures_of_a_comparison(lab):
    better = lab.add(['load_friction'])
    stairs = better.stairs()
    comparison = better.compare('mechanical_power')
    compared = comparison.models
    assert str(comparison).splitlines()[1].split() == [
        f'{compared[1].rms_w:.2f}',
        'W',
        compared[1].name,
    ]
    assert stairs.errors == pytest.approx([lab.score.rms_w, compared[0].rms_w], abs=1e-6)
    assert stairs.steps == ('fit', 'load_friction')
    assert stairs.figure()['data'][0]['x'] == ['fit', 'load_friction']


def test_sessions_and_models_are_compared_as_files_are(lab):
    better = lab.add('load_friction')
    by_session, by_model = (lab.compare(other).models for other in (better, better.model))
    assert [one.rms_w for one in by_session] == [lab.score.rms_w, better.score.rms_w]
    assert [one.rms_w for one in by_model] == [one.rms_w for one in by_session]


def test_a_printed_model_has_a_line_with_unit_and_interval_for_each_coefficient(lab):
    first, *rest = str(lab.model).splitlines()
    assert first == f'model: {", ".join(lab.effects.effects)}'
    group = lab.effects.groups[0]
    value = group.coefficients['copper_loss'][0]
    line = next(line for line in rest if line.startswith(f'{group.type.name}  copper_loss'))
    assert f'k = {value.value:.3g} (' in line
    assert 'W/(N·m)²' in line


def test_a_saved_model_is_loaded_and_judged_alike(lab, tmp_path):
    again = lab.load(str(lab.save(tmp_path / 'base.yaml')))
    assert again.score.rmse == pytest.approx(lab.score.rmse, abs=1e-6)
    assert again.effects.name == 'model'


def test_a_step_that_cannot_be_is_refused_in_a_line(lab):
    with pytest.raises(InputError, match="'idle' is in the model already"):
        lab.add('idle')
    with pytest.raises(InputError, match="'spring' is not in the model"):
        lab.remove('spring')
    with pytest.raises(InputError, match='no effect is left'):
        lab.remove('shaft copper_loss idle')
    with pytest.raises(InputError, match='there is no model yet'):
        Session(lab.judge).diagnose()
    with pytest.raises(InputError, match='mechanical_power is not made of effects'):
        lab.load('mechanical_power').add('idle')


def test_importing_the_package_loads_no_analysis():
    code = 'import sys, power_lab; sys.exit("numpy" in sys.modules)'
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0


def test_effects_on_a_base_predict_as_they_do_from_their_file(lab, tmp_path):
    added = lab.fit('idle', base='torque_squared')
    data, again = lab.recordings.data, lab.load(str(added.save(tmp_path / 'own.yaml')))
    power = added.model.predict(data)
    assert np.isfinite(power).any()
    assert np.allclose(power, again.model.predict(data), rtol=1e-4, atol=1e-3, equal_nan=True)
