"""Commands end to end on a simulated recording, and on bad input."""

import argparse
import errno
import json
import os
import shlex
import shutil
import textwrap
from pathlib import Path

import numpy as np
import pytest
import yaml
from power_estimator.judge.recordings import load
from power_lab.challenge.challenge import (
    HIDDEN,
    SEALED,
    UNMODELLED,
    Challenge,
    draw,
    score,
    seal,
    unseal,
)
from power_lab.commands.arguments import add as add_command
from power_lab.commands.arguments import compare as compare_command
from power_lab.commands.arguments import diagnose as diagnose_command
from power_lab.commands.arguments import execute as execute_command
from power_lab.commands.arguments import fit as fit_command
from power_lab.commands.arguments import reveal
from power_lab.commands.arguments import to_plant as to_plant_command
from power_lab.commands.options import next_command, unused
from power_recordings.card import Card
from sim_bridge.offline.run import run_offline
from sim_bridge.plant.parameters import Plant

KNOWN = 'shaft,copper_loss,viscous_friction,coulomb_friction,rotor_inertia,idle'


@pytest.fixture(scope='module')
def base(bag, tmp_path_factory):
    path = tmp_path_factory.mktemp('models') / 'base.yaml'
    assert fit_command([str(bag), '--effects', KNOWN, '-o', str(path)]) == 0
    return path


def test_the_next_command_has_the_same_recordings_and_choices(tmp_path, monkeypatch):
    options = argparse.Namespace(
        bags=[Path('b 1')], drives=['*_KFE'], without=['2:3'], effects_path=[Path('e.py')]
    )
    options.slow, options.anyway = True, False
    added = next_command('add', options, 'idle', '--to', 'm.yaml', '-o', 'n.yaml')
    assert added == (
        "next: ros2 run power_lab add idle --to m.yaml -o n.yaml --bag 'b 1' "
        "--drives '*_KFE' --without 2:3 --effects-path e.py --slow-meter"
    )
    options.anyway = True
    learned = next_command('discover', options, '--model', 'm.yaml')
    assert learned.startswith("next: ros2 run power_lab discover 'b 1' --model m.yaml --drives")
    assert learned.endswith(' --slow-meter --ignore-unit-conflicts')
    monkeypatch.chdir(tmp_path)
    assert unused('better.yaml') == 'better.yaml'
    (tmp_path / 'better.yaml').touch()
    assert unused('better.yaml') == 'better2.yaml'


def test_a_hidden_effect_is_found_added_and_the_error_falls(bag, base, tmp_path, capsys):
    found, html, motion = (tmp_path / name for name in ('d.json', 'd.html', 'next.yaml'))
    outputs = ['--json', str(found), '--report', str(html), '--motion', str(motion)]
    assert diagnose_command([str(bag), '--model', str(base), *outputs]) == 0
    told = json.loads(found.read_text())
    assert told['verdict'] == 'named'
    assert told['effects'] == ['load_friction']
    assert set(told) >= {
        *('verdict', 'effects', 'measurement', 'candidates', 'leftover', 'next_recording'),
        *('drives', 'notes', 'any_missing', 'limits', 'residual'),
    }
    for term in ('time_offset', 'power_gain', 'current_offset', 'torque_bias', 'velocity_lag'):
        assert set(told['measurement'][term]) >= {'value', 'interval', 'matters'}
    assert told['measurement']['velocity_lag']['value'] == pytest.approx(0.004, abs=0.0015)
    best = told['candidates'][0]
    assert best['name'] == 'load_friction'
    assert best['probability'] >= 0.95
    assert best['explains_w'] > 0.2
    assert best['interval'][0] < best['coefficient'] < best['interval'][1]
    assert best['delta_rmse_w'] > 0.2
    assert {'r2', 'worst'} <= set(told['leftover'])
    executed = yaml.safe_load(motion.read_text())
    assert executed['segments']
    assert all(segment['seconds'] > 0 for segment in executed['segments'])
    assert 'Friction that grows with load is missing' in html.read_text()
    shown = capsys.readouterr().out
    assert shown.index('power balance of LF_KFE') < shown.index('named')
    assert 'active effects' in shown

    better, compared = tmp_path / 'better.yaml', tmp_path / 'c.json'
    program, arguments = shown.splitlines()[-1].split(' add ')
    assert program == 'next: ros2 run power_lab'
    arguments = shlex.split(arguments.replace('better.yaml', str(better)))
    assert arguments[:3] == ['load_friction', '--to', str(base)]
    assert add_command(arguments) == 0
    assert [e['step'] for e in yaml.safe_load(better.read_text())['history']] == ['fit', 'add']
    models = [str(base), str(better), 'mechanical_power']
    assert compare_command([str(bag), '--models', *models, '--json', str(compared)]) == 0
    told = {model['name']: model for model in json.loads(compared.read_text())['models']}
    assert set(told) == {'base', 'better', 'mechanical_power'}
    errors = [told[name]['drives']['LF_KFE']['rmse_w'] for name in told]
    assert errors[1] < 0.7 * errors[0] < errors[2]
    assert told['better']['effects'][-1] == 'load_friction'
    assert set(told['base']['drives']['LF_KFE']) >= {'r2', 'rmse_w', 'bias_w'}
    assert told['base']['regimes'][0]['text']

    plant = tmp_path / 'plant.yaml'
    assert to_plant_command([str(better), '-o', str(plant)]) == 0
    effects = dict(Plant.load(plant).effects)
    assert effects['load_friction'].scale == pytest.approx(2.5, rel=0.4)
    assert effects['stribeck_friction'].scale == 0.0


def test_where_nothing_is_missing_it_says_what_is_open_and_how_to_see_it(bag, tmp_path, capsys):
    model, found = tmp_path / 'whole.yaml', tmp_path / 'd.json'
    effects = ['--effects', f'{KNOWN},load_friction', '-o', str(model)]
    assert fit_command([str(bag), *effects]) == 0
    assert diagnose_command([str(bag), '--model', str(model), '--json', str(found)]) == 0
    told = json.loads(found.read_text())
    assert (told['verdict'], told['residual']) == ('no_evidence', None)
    assert told['any_missing'] < 0.95
    stays = f'{told["unexplained"]["rms_w"]:.2f} W ('
    assert stays in told['sentence']
    assert told['unexplained']['rms_w'] <= told['drives']['LF_KFE']['rmse_w']
    assert capsys.readouterr().out.splitlines()[-1] == (
        f'next: ros2 run power_lab diagnose {bag} --model {model} --motion next.yaml'
    )
    chances = {row['name']: row['probability'] for row in told['candidates']}
    assert max(chances.values()) < 0.95
    open_ = [one['effect'] for one in told['limits']]
    assert open_ == [name for name, chance in chances.items() if chance >= 0.05]
    assert all(one['needs'] for one in told['limits'])
    assert told['next_recording']['segments']


def test_a_users_own_effect_is_fitted_and_kept_by_name(bag, tmp_path):
    mine, path = tmp_path / 'mine.py', tmp_path / 'own.yaml'
    mine.write_text(
        textwrap.dedent(
            """
            import numpy as np
            from power_estimator.effects import Effect, Term

            class Cable(Effect):
                name = 'cable_drag'
                physics = 'the cable pulls at large angles'
                formula = 'c·|q|·|w|'
                terms = (Term('c', 'N·m/rad', 0.0, 50.0),)

                def regressors(self, signals, **shape):
                    return np.abs(signals.position * signals.velocity)[..., None]
            """
        )
    )
    own = ['--effects-path', str(mine)]
    effects = ['--effects', f'{KNOWN},cable_drag', '-o', str(path)]
    assert fit_command([str(bag), *effects, *own]) == 0
    assert compare_command([str(bag), '--models', str(path), *own]) == 0
    assert compare_command([str(bag), '--models', str(path)]) == 2


def fails(capsys, command, arguments):
    assert command([str(argument) for argument in arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert 'Traceback' not in error
    assert error.count('\n') == 0
    return error


def test_a_fit_onto_a_full_disk_leaves_neither_model_nor_json(bag, tmp_path, capsys, monkeypatch):
    written = []

    def fsync(descriptor):
        written.append(descriptor)
        if len(written) > 1:
            raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', fsync)
    outputs = ['-o', str(tmp_path / 'm.yaml'), '--json', str(tmp_path / 'm.json')]
    assert fit_command([str(bag), '--effects', 'shaft,idle', *outputs]) == 2
    assert len(written) == 2
    assert 'the disk is full' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('effects', 'words'),
    [
        ('shaft,magic', "unknown effect 'magic'; known are"),
        ('regeneration', 'did you mean regeneration_efficiency (of the power that'),
        ('regeneration', 'at the bus) or regeneration_limit (the supply takes nothing back'),
        ('series_spring', 'did you mean spring (the'),
        ('iron_los', 'did you mean iron_loss ('),
        ('shaft coper_loss', "unknown effect 'coper_loss'; did you mean copper_loss (the current"),
        ('all', "unknown effect 'all'; known are shaft, copper_loss"),
        ('shaft,shaft', 'one is named twice in shaft,shaft'),
        ('power_gain', 'errors of the measurement'),
        (',', 'effects: none is named'),
    ],
)
def test_fit_refuses_effects_that_make_no_sense(bag, tmp_path, capsys, effects, words):
    out = tmp_path / 'base.yaml'
    said = fails(capsys, fit_command, [bag, '--effects', effects, '-o', out])
    assert words in said
    assert not ('did you mean' in said and 'known are' in said), 'a list buries the name'
    assert not out.exists()


def test_an_effect_cannot_be_added_twice(bag, base, tmp_path, capsys):
    arguments = ['idle', '--to', base, '--bag', bag, '-o', tmp_path / 'b.yaml']
    assert "'idle' is active in" in fails(capsys, add_command, arguments)


def test_missing_recordings_models_and_drives_are_named(bag, base, tmp_path, capsys):
    nowhere = tmp_path / 'nowhere'
    assert 'nowhere' in fails(capsys, diagnose_command, [nowhere, '--model', base])
    gone = [bag, '--model', tmp_path / 'gone.yaml']
    assert 'gone.yaml' in fails(capsys, diagnose_command, gone)
    assert 'magic' in fails(capsys, diagnose_command, [bag, '--model', 'magic'])
    drives = [bag, '--model', base, '--drives', 'RH_KFE']
    assert 'RH_KFE' in fails(capsys, diagnose_command, drives)
    twice = [bag, '--models', base, base]
    assert 'twice' in fails(capsys, compare_command, twice)
    ending = [bag, '--model', base, '--report', tmp_path / 'r.pdf']
    assert '.html' in fails(capsys, diagnose_command, ending)


def test_a_user_effect_that_raises_or_returns_nan_ends_in_one_line(bag, tmp_path, capsys):
    for body, words in (('1 / 0', 'ZeroDivisionError'), ('signals.torque[..., None] / 0', 'NaN')):
        mine = tmp_path / 'mine.py'
        mine.write_text(
            'from power_estimator.effects import Effect, Term\n'
            'class Mine(Effect):\n'
            "    name, physics, formula = 'mine', 'p', 'f'\n"
            "    terms = (Term('c', 'W'),)\n"
            '    def regressors(self, signals, **shape):\n'
            f'        return {body}\n'
        )
        arguments = [bag, '--effects', 'shaft,mine', '-o', tmp_path / 'm.yaml']
        arguments += ['--effects-path', mine]
        with np.errstate(all='ignore'):
            assert words in fails(capsys, fit_command, arguments)


def test_a_recording_too_short_or_too_still_says_what_is_missing(tmp_path, capsys):
    short = run_offline(tmp_path / 'short', duration=6.0, seed=1, drives=('LF_KFE',))
    assert fit_command([str(short), '--effects', 'shaft,idle', '-o', f'{tmp_path}/m.yaml']) == 0
    little, after = capsys.readouterr().out.splitlines()[-3::2]
    assert little.startswith('5.5 s are little: believe the intervals')
    assert after == 'next: record 80 s or more, and fit that'
    arguments = [short, '--model', tmp_path / 'm.yaml']
    assert 'record 9 s or more' in fails(capsys, diagnose_command, arguments)
    stands = {'duration': 25.0, 'seed': 1, 'controller': 'stand', 'drives': ('LF_HAA',)}
    still = run_offline(tmp_path / 'still', **stands)
    error = fails(capsys, fit_command, [still, '--effects', 'shaft', '-o', 'm.yaml'])
    assert all(part in error for part in ('no drive moves', 'record motion at several speeds'))


def test_a_challenge_is_sealed_and_revealed(tmp_path, capsys):
    bag = tmp_path / 'riddle'
    bag.mkdir()
    challenge = draw(5)
    seal(challenge.content(), bag)
    assert challenge.hidden[0] not in (bag / SEALED).read_text()
    assert unseal(bag) == challenge.content()
    found = tmp_path / 'd.json'
    found.write_text(json.dumps({'verdict': 'named', 'effects': list(challenge.hidden)}))
    assert reveal([str(bag), '--diagnosis', str(found)]) == 0
    out = capsys.readouterr().out
    assert 'inverter loss' in out
    assert 'is right' in out


def test_a_damaged_or_missing_seal_is_said(tmp_path, capsys):
    assert 'no challenge' in fails(capsys, reveal, [tmp_path])
    (tmp_path / SEALED).write_text('rubbish\n')
    assert 'damaged' in fails(capsys, reveal, [tmp_path])


def test_seeds_draw_every_kind_of_challenge():
    drawn = [draw(seed) for seed in range(300)]
    hidden = {c.hidden[0] for c in drawn if c.hidden}
    assert hidden == {*HIDDEN, *UNMODELLED}
    assert {c.expected for c in drawn} == {'named', 'none_of_the_above', 'no_evidence'}
    assert all(not set(c.hidden) & set(c.known) for c in drawn)
    assert draw(7) == draw(7)


def test_a_challenges_plant_has_what_is_known_and_what_is_hidden_and_nothing_else():
    challenge = Challenge(('stribeck_friction',), 2.0, ('shaft', 'copper_loss', 'idle'), 4)
    plant = challenge.plant(Plant.load('anymal_c'))
    on = {name: effect.scale for name, effect in plant.effects if effect.scale > 0}
    assert on == {'copper_loss': 1.0, 'idle': 1.0, 'rotor_inertia': 1.0, 'stribeck_friction': 2.0}
    assert plant.unit_number == 4


@pytest.mark.parametrize(
    ('verdict', 'effects', 'expected'),
    [
        ('named', ['spring'], 'right'),
        ('named', ['idle'], 'wrong'),
        ('named', ['spring', 'idle'], 'wrong'),
        ('ambiguous', ['spring', 'idle'], 'in the set'),
        ('ambiguous', ['idle'], 'wrong'),
        ('no_evidence', [], 'missed'),
        ('none_of_the_above', [], 'missed'),
    ],
)
def test_a_diagnosis_is_scored_by_the_answer(verdict, effects, expected):
    answer = {'hidden': ['spring'], 'expected': 'named'}
    assert score(answer, {'verdict': verdict, 'effects': effects}) == expected


def test_the_controller_of_a_card_is_used_where_recordings_differ(bag, base, tmp_path):
    other = tmp_path / 'other'
    shutil.copytree(bag, other)
    card = Card.load(other)
    Card(**{**card.__dict__, 'controller': 'another'}).save(other)
    out = tmp_path / 'c.json'
    models = ['--models', str(base), '--json', str(out)]
    assert compare_command([str(bag), str(other), *models]) == 0
    assert json.loads(out.read_text())['seconds'] > 80


MOTION = """
format: motion/1
drives: [LF_KFE]
segments:
- {mode: rest, seconds: 3}
- {mode: velocity, speed: 2.0, load: 10.0, seconds: 3}
- {mode: velocity, speed: -2.0, load: 10.0, seconds: 3}
- {mode: torque, torque: 10.0, speed: 0.0, seconds: 5}
- {mode: torque, low: -8.0, high: 8.0, frequency: 1.0, seconds: 5}
- {mode: position, frequency: 2.0, amplitude: 0.3, load: 0.0, seconds: 5}
"""


def test_the_recording_that_was_asked_for_is_executed_on_the_bench(tmp_path):
    file, bag = tmp_path / 'next.yaml', tmp_path / 'next'
    file.write_text(MOTION)
    assert execute_command([str(file), '-o', str(bag)]) == 0
    data = load([bag]).data
    since = data.time - data.time[0]
    assert data.names == ('LF_KFE',)
    assert since[-1] == pytest.approx(24.0, abs=1.0)
    fast = data.velocity[(since > 3.7) & (since < 5.3)]
    assert fast.mean() == pytest.approx(2.0, abs=0.4)
    held = data.torque[(since > 11.5) & (since < 13.5)]
    assert held.mean() == pytest.approx(10.0, rel=0.25)
    swing = data.velocity[since > 20.0]
    assert np.abs(swing).max() > 1.5


def test_recordings_of_a_robot_and_of_one_drive_are_judged_on_what_they_share(bag, tmp_path):
    file, one = tmp_path / 'next.yaml', tmp_path / 'next'
    file.write_text(MOTION)
    assert execute_command([str(file), '-o', str(one)]) == 0
    both = load([bag, one])
    assert both.data.names == ('LF_KFE',)
    assert set(both.data.recording.tolist()) == {0, 1}


def test_the_bench_takes_the_robot_of_a_challenge_without_opening_the_seal(tmp_path, capsys):
    bag, file, out = (tmp_path / name for name in ('riddle', 'next.yaml', 'next'))
    bag.mkdir()
    file.write_text(MOTION)
    challenge = Challenge(('idle',), 2.0, ('shaft', 'copper_loss'), 7)
    seal(challenge.content(), bag)
    assert Challenge.of(unseal(bag)) == challenge
    assert execute_command([str(file), '--challenge', str(bag), '-o', str(out)]) == 0
    assert 'idle' not in capsys.readouterr().out + Card.load(out).notes
    data = load([out]).data
    rest = (data.time - data.time[0] > 1.0) & (data.time - data.time[0] < 2.5)
    usual = 8.2  # W, of the plant; twice that and what holds the pendulum
    assert data.power[rest].mean() == pytest.approx(2 * usual, rel=0.25)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (('format: motion/1', 'format: song/1'), "expected 'motion/1', there is 'song/1'"),
        (('mode: rest', 'mode: dance'), "mode: expected 'rest', 'velocity'"),
        (('seconds: 3', 'seconds: -3'), 'seconds: expected 0.001 to 36000 s, there is -3'),
        (('speed: 2.0', 'speed: fast'), "speed: expected -1000 to 1000 rad/s, there is 'fast'"),
        (('speed: 2.0', 'spin: 2.0'), 'segments[1]: unknown key'),
        (('segments:', 'parts:'), "unknown key 'parts'"),
        (('LF_KFE', 'LF_TAIL'), "no drive 'LF_TAIL'"),
    ],
)
def test_a_motion_that_makes_no_sense_is_refused(tmp_path, capsys, change, words):
    file = tmp_path / 'next.yaml'
    file.write_text(MOTION.replace(*change))
    assert words in fails(capsys, execute_command, [file, '-o', tmp_path / 'bag'])
