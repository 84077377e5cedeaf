"""Tracking of recordings: alarms, the index, and recordings that say nothing."""

import json
import shutil

import numpy as np
import pytest
from aligned_bag import write
from power_estimator.judge.recordings import load
from power_fleet.commands.arguments import track as track_command
from power_fleet.track import reading
from power_lab.commands.arguments import fit as fit_command
from truth_circuit import Truth, record

KNOWN = ('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle')


@pytest.fixture(scope='module')
def days(tmp_path_factory):
    """Twelve short walks by date of which the last six have half as much friction again."""
    folder = tmp_path_factory.mktemp('days')
    bags = []
    for index in range(12):
        effects = dict.fromkeys(KNOWN, 1.0)
        if index >= 6:
            effects['coulomb_friction'] = np.array([1.0, 1.5, 1.0])
        bag = write(folder / f'walk{index:02d}', record(Truth(effects, 'walk', 20.0, index, 3)))
        (bag / 'card.yaml').write_text(
            f"robot: leg\ncreated: '2026-03-{index + 1:02d}T08:00:00'\ntemperature: 20\n"
        )
        bags.append(str(bag))
    base = folder / 'base.yaml'
    assert fit_command([bags[0], '--effects', ','.join(('shaft', *KNOWN)), '-o', str(base)]) == 0
    return bags, base


def test_recordings_with_a_hidden_step_of_friction_end_in_one_alarm(days, tmp_path, capsys):
    bags, base = days
    told, page = tmp_path / 't.json', tmp_path / 't.html'
    outputs = ['--json', str(told), '--report', str(page), '--workers', '1']
    assert track_command([*bags[::-1], '--model', str(base), *outputs]) == 0
    content = json.loads(told.read_text())
    series = {(one['drive'], one['effect']): one for one in content['series']}
    knee = series['LF_HFE', 'coulomb_friction']
    assert [point['recording'] for point in knee['points']] == [f'walk{i:02d}' for i in range(12)]
    change = knee['change']
    assert change['verdict'] == 'step'
    assert change['at'] == 'walk06'
    # Half of the circuit's 1.8 N·m; the fitted level has other friction of its shape in it.
    assert change['to'] - change['from'] == pytest.approx(0.9, abs=0.12)
    assert change['interval'][0] < change['to'] < change['interval'][1]
    changed = [key for key, one in series.items() if one['change']['verdict'] != 'steady']
    assert changed == [('LF_HFE', 'coulomb_friction')]
    (alarm,) = content['alarms']
    assert 'LF_HFE: coulomb friction changed' in alarm
    assert '2026-03-07' in alarm
    assert 'coulomb friction' in page.read_text()
    assert f'power_lab diagnose {bags[6]} --model' in capsys.readouterr().out.replace('\n', ' ')


def test_an_effect_that_the_model_lacks_is_named_by_diagnosis_and_tracked(tmp_path):
    base = tmp_path / 'base.yaml'
    base.write_text(
        f'format: power_model/1\nname: base\neffects: [shaft, {", ".join(KNOWN)}, rotor_inertia]\n'
    )
    bags = []
    for index in range(12):
        effects = dict.fromkeys((*KNOWN, 'rotor_inertia'), 1.0)
        if index >= 6:
            effects['load_friction'] = np.array([0.0, 0.0, 2.0])
        bag = write(tmp_path / f'walk{index:02d}', record(Truth(effects, 'walk', 20.0, index, 3)))
        (bag / 'card.yaml').write_text(f"robot: leg\ncreated: '2026-03-{index + 1:02d}'\n")
        bags.append(bag)
    page = tmp_path / 't.html'
    content = tracked_json(bags, base, tmp_path / 'a.json', '--report', str(page))
    (missed,) = content['unmodelled']
    assert (missed['drive'], missed['added']) == ('LF_KFE', ['load_friction'])
    assert missed['after']['effects'] == ['load_friction']
    assert missed['before']['effects'] == []
    changed = {
        (one['drive'], one['effect']): one['change']
        for one in content['series']
        if one['change']['verdict'] != 'steady'
    }
    assert list(changed) == [('LF_KFE', 'load_friction')]
    change = changed['LF_KFE', 'load_friction']
    assert change['at'] == 'walk06'
    assert change['to'] - change['from'] == pytest.approx(0.2, rel=0.25)  # of the load
    assert change['percent'] is None  # nothing was there before
    assert 'The model lacks it' in content['alarms'][0]
    assert 'The model lacks it' in page.read_text()


def test_a_model_without_effects_is_refused_in_one_line(days, capsys):
    bags, _ = days
    assert track_command([bags[0], '--model', 'torque_squared']) == 2
    error = capsys.readouterr().err.strip()
    assert 'model.yaml' in error
    assert '\n' not in error


@pytest.fixture
def index(tmp_path, monkeypatch):
    monkeypatch.setenv('WATTWALK_INDEX', str(tmp_path / 'index.sqlite3'))


def tracked_json(bags, base, told, *more):
    outputs = ['--json', str(told), '--workers', '1', *more]
    assert track_command([*map(str, bags), '--model', str(base), *outputs]) == 0
    return json.loads(told.read_text())


def test_a_second_run_fits_nothing_and_says_the_same(days, index, tmp_path, monkeypatch):
    bags, base = days
    first = tracked_json(bags[:4], base, tmp_path / 'a.json')
    monkeypatch.setattr(reading, 'load', None)  # nothing may be read
    assert tracked_json(bags[:4], base, tmp_path / 'b.json') == first


def test_another_model_is_fitted_anew(days, index, tmp_path):
    bags, base = days
    first = tracked_json(bags[:2], base, tmp_path / 'a.json')
    other = tmp_path / 'other.yaml'
    other.write_text(
        'format: power_model/1\nname: base\n'
        'effects: [shaft, copper_loss, viscous_friction, coulomb_friction]\n'
    )
    second = tracked_json(bags[:2], other, tmp_path / 'b.json')
    effects = [{one['effect'] for one in content['series']} for content in (first, second)]
    assert effects[0] - effects[1] == {'idle'}


def test_after_an_interruption_finished_recordings_are_not_fitted_again(
    days, index, tmp_path, monkeypatch, capsys
):
    bags, base = days
    read = []

    def interrupted(paths, *rest, **options):
        read.append(paths[0].name)
        if len(read) == 3:
            raise KeyboardInterrupt
        return load(paths, *rest, **options)

    monkeypatch.setattr(reading, 'load', interrupted)
    assert track_command([*bags[:5], '--model', str(base), '--workers', '1']) == 130
    content = tracked_json(bags[:5], base, tmp_path / 'a.json')
    assert read == ['walk00', 'walk01', 'walk02', 'walk02', 'walk03', 'walk04']
    assert len(content['series'][0]['points']) == 5


def test_a_broken_recording_is_named_and_left_out(days, tmp_path):
    bags, base = days
    broken = tmp_path / 'broken'
    broken.mkdir()
    (broken / 'data_0.mcap').write_bytes(b'no recording at all')
    content = tracked_json([bags[0], broken, *bags[1:4]], base, tmp_path / 'a.json')
    (left_out,) = content['left_out']
    assert 'broken' in left_out
    assert [len(one['points']) for one in content['series']] == [4] * len(content['series'])


def test_a_copy_counts_once_and_equal_names_become_longer(days, tmp_path):
    bags, base = days
    for name in ('a', 'b'):
        shutil.copytree(bags[int(name == 'b')], tmp_path / name / 'walk')
    paths = [tmp_path / 'a' / 'walk', tmp_path / 'b' / 'walk', *bags[1:3]]
    content = tracked_json(paths, base, tmp_path / 'a.json')
    (left_out,) = content['left_out']
    assert left_out.startswith(bags[1])
    assert 'taken once' in left_out
    names = [point['recording'] for point in content['series'][0]['points']]
    assert names[:3] == ['a/walk', 'b/walk', 'walk02']


def test_a_recording_that_is_not_there_is_refused(days, capsys):
    bags, base = days
    assert track_command([*bags, 'nowhere', '--model', str(base)]) == 2
    assert 'there is no recording nowhere' in capsys.readouterr().err
