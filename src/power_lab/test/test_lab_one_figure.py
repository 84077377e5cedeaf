"""The same model on the same recording has the same figure wherever it is shown."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from power_estimator.commands.arguments import benchmark as benchmark_command
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.model_file.yaml_file import read_model
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import load
from power_lab.commands.arguments import add as add_command
from power_lab.commands.arguments import compare as compare_command
from power_lab.commands.arguments import fit as fit_command
from power_lab.report.figures import Stairs

WALK = str(Path(__file__).resolve().parents[3] / 'bags' / 'walk_small')


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """A model fitted to the walk, one with an effect added, and errors as commands write them."""
    folder = tmp_path_factory.mktemp('models')
    base, better = (str(folder / f'{name}.yaml') for name in ('base', 'better'))
    effects = ['--effects', 'shaft,copper_loss,idle']
    assert fit_command([WALK, *effects, '-o', base]) == 0
    assert add_command(['load_friction', '--to', base, '--bag', WALK, '-o', better]) == 0
    for name, command in (('compare', compare_command), ('benchmark', benchmark_command)):
        file = str(folder / f'{name}.json')
        assert command([WALK, '--models', base, better, '--json', file]) == 0
    return folder


def errors(drives):
    return {name: scores['rmse_w'] for name, scores in drives.items()}


def test_fit_add_compare_and_benchmark_have_the_same_figures(made):
    history = yaml.safe_load((made / 'better.yaml').read_text())['history']
    compared, benchmarked = (
        json.loads((made / f'{name}.json').read_text())['models']
        for name in ('compare', 'benchmark')
    )
    fit, added = history
    for figures in (fit['rmse_w'], added['rmse_before_w'], errors(benchmarked[0]['drives'])):
        assert figures == pytest.approx(errors(compared[0]['drives']), abs=1e-6)
    for figures in (added['rmse_w'], errors(benchmarked[1]['drives'])):
        assert figures == pytest.approx(errors(compared[1]['drives']), abs=1e-6)
    assert compared[0]['total']['r2'] == benchmarked[0]['total']['r2'] < 0.35
    assert {m['held_out'] for m in (fit, added, *compared, *benchmarked)} == {'cross-validated'}


def test_add_draws_no_arrow_between_errors_that_were_held_out_in_different_ways(
    made, tmp_path, capsys
):
    text = (made / 'base.yaml').read_text()
    (identity,) = yaml.safe_load(text)['fitted_on']
    other = tmp_path / 'other.yaml'
    other.write_text(text.replace(identity['sha256'], 'f' * 64))
    for file, arrows in ((made / 'base.yaml', 1), (other, 0)):
        add = ['load_friction', '--to', str(file), '--bag', WALK, '-o', str(tmp_path / 'm.yaml')]
        assert add_command(add) == 0
        out = capsys.readouterr().out
        assert out.split('held-out error')[1].count('→') == arrows
    assert re.search(
        r'W \(cross-validated\); the model before: [\d.]+ W \(other recordings\)', out
    )


def test_errors_of_other_kinds_or_recordings_are_no_steps_of_the_staircase(made):
    loaded = load([Path(WALK)])
    judged = Judge(loaded).score(read_model(made / 'better.yaml', builtin_catalogue()))
    history = yaml.safe_load((made / 'better.yaml').read_text())['history']
    noise = np.array([0.5, 0.5])

    def steps(*entries):
        return Stairs.of(entries, [judged], loaded, noise).steps

    assert steps(*history) == ('fit', 'load_friction')
    in_sample = {key: value for key, value in history[0].items() if key != 'held_out'}
    elsewhere = history[0] | {'recordings': ['another']}
    changed = history[0] | {'sha256': ['0' * 64]}
    cut = history[0] | {'without': ['1@3:5']}
    fewer = history[0] | {'rmse_w': {'LF_HAA': 3.0}}
    assert steps(in_sample, elsewhere, changed, cut, fewer) == ('better',)
    stairs = Stairs.of(history, [judged], loaded, noise)
    assert stairs.errors[0] == pytest.approx(31.69, abs=0.005)
    assert stairs.errors[1] == pytest.approx(judged.rms_w)
