"""The loop in Python."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
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
    verdict, first, last = capsys.readouterr().out.splitlines()
    assert verdict == 'named'
    assert first.split() == ['31.69', 'W', 'fit']
    assert float(last.split()[0]) < 4.0


def test_each_step_returns_another_session_and_leaves_the_one_before(lab):
    before = lab.effects
    better = lab.add('load_friction')
    assert lab.effects is before
    assert better.effects.effects == ('shaft', 'copper_loss', 'idle', 'load_friction')
    assert better.score.rms_w < lab.score.rms_w
    less = better.remove('load_friction')
    assert less.effects.effects == before.effects
    assert less.score.rms_w == pytest.approx(lab.score.rms_w, abs=1e-6)
    assert [entry['step'] for entry in less.effects.history] == ['fit', 'add', 'fit']


def test_the_staircase_has_the_figures_of_a_comparison(lab):
    better = lab.add(['load_friction'])
    stairs = better.stairs()
    compared = better.compare('mechanical_power').models
    assert stairs.errors == pytest.approx([lab.score.rms_w, compared[0].rms_w], abs=1e-6)
    assert stairs.steps == ('fit', 'model')
    assert stairs.figure()['data'][0]['x'] == ['fit', 'model']


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
