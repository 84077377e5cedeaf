"""Discovery of effects that no catalogue has, on circuits that do not share its formulas."""

import json
from dataclasses import replace
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest
from aligned_bag import write
from discover_truth import recorded
from power_estimator.effects import Term, builtin_catalogue, load_catalogue
from power_estimator.effects.catalogue import Catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.signals.prepared import signals_of
from power_estimator.effects.signals.state import Carried
from power_estimator.effects.training import material
from power_lab.commands.arguments import add as add_command
from power_lab.commands.arguments import compare as compare_command
from power_lab.commands.arguments import discover as discover_command
from power_lab.commands.arguments import fit as fit_command
from power_lab.discover.discovery import Discoverer
from power_lab.discover.effect_file import Written, effect_source
from power_lab.discover.formula import PRIMITIVES, Formula, Place, principal
from power_lab.discover.found import Found, bounds_of, check_bounds
from power_lab.discover.known import same_term
from power_lab.discover.outcome import split
from power_lab.discover.selection import without_known
from power_lab.discover.words import in_short
from power_lab.report.tables import print_discovery
from power_lab.structure.drivers import FACTORS, Driver, Family
from power_lab.structure.memory import after_rest, by_stretch, lagged, play
from power_recordings.alignment.dataset import AlignedDataset
from rich.console import Console

KNOWN = ('shaft', 'copper_loss', 'viscous_friction', 'coulomb_friction', 'rotor_inertia', 'idle')
CATALOGUE = builtin_catalogue()


def wheel(seed=3, seconds=80.0, *, rub=0.0, chopper=0.0, reversals=0.0, viscous=0.0, coulomb=0.0):
    """A small turning drive with 1.3 W/(N·m)² of copper loss, and what is to be found in it."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.0025)
    phase = random.uniform(0, 6, 7)

    def waves(*given):
        return sum(size * np.sin(2 * np.pi * f * time + phase[i]) for i, (size, f) in given)

    w = waves((0, (8.0, 0.31)), (1, (5.0, 0.13)), (2, (3.0, 1.1)))
    torque = waves((3, (1.5, 0.23)), (4, (1.0, 0.71)), (5, (0.5, 1.7)))
    q, a = np.cumsum(w) * 0.0025, np.gradient(w, 0.0025)
    volts = 24.0 + 0.3 * np.sin(0.7 * time + phase[6]) + random.normal(0, 0.01, len(time))
    power = torque * w + 1.3 * torque**2 + 4.2 + viscous * w**2 + coulomb * np.abs(w)
    power = power + rub * (np.cos(q) > 0.7) * np.abs(w)
    power = power + chopper * (volts > 24.15) + reversals * (np.abs(a) > 25.0)
    noisy = power + random.normal(0, 0.1, len(time))
    signals = {
        'position': q,
        'velocity': w + random.normal(0, 0.005, len(time)),
        'torque': torque + random.normal(0, 0.003, len(time)),
        'voltage': volts,
        'current': noisy / volts,
        'power': noisy,
    }
    columns = {name: values[:, None].astype(np.float32) for name, values in signals.items()}
    return AlignedDataset.blank(400.0, ['WHEEL'], time, 'wheel', **columns)


def discovered(data):
    structure = Structure(tuple(Active.of(CATALOGUE[name]) for name in KNOWN))
    terms = measurement_terms(CATALOGUE, shaft=True)
    fitter = material(data).fitter(per_drive=True)
    return Discoverer(fitter, structure.plus(*terms), CATALOGUE).run()


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Two walks of a robot with a rub in a window of position, and a model of what is known."""
    folder = tmp_path_factory.mktemp('discover')
    found = [
        write(
            folder / f'walk{seed}',
            recorded('window of position', 'walk', seed=seed, unit=3, seconds=60.0),
        )
        for seed in (1, 2)
    ]
    base = folder / 'base.yaml'
    assert fit_command([str(found[0]), '--effects', ','.join(KNOWN), '-o', str(base)]) == 0
    return (*found, base)


def test_a_rub_in_a_window_is_written_added_and_halves_the_error_of_another_walk(
    bags, tmp_path, capsys
):
    walk, other, base = bags
    effect, told, page = (tmp_path / name for name in ('effect.py', 'd.json', 'd.html'))
    outputs = ['-o', str(effect), '--json', str(told), '--report', str(page)]
    arguments = [str(walk), '--test', str(other), '--model', str(base), *outputs]
    assert discover_command(arguments) == 0
    content = json.loads(told.read_text())
    (found,) = content['found']
    assert found['kind'] == 'position'
    assert found['transfers'] is True
    assert found['interval'][0] < found['explains_w'] < 1.2 * found['interval'][1]
    assert found['formula'].startswith('motor torque = c·[low < q < high]')
    for drive in found['drives']:
        assert found['bounds'][drive]['low'] < found['bounds'][drive]['high']
    assert 'hypothesis' in found['physics']
    assert 'learned shape' in page.read_text()
    assert f'add {found["name"]}' in capsys.readouterr().out.replace('\n', ' ')

    better, compared = tmp_path / 'better.yaml', tmp_path / 'c.json'
    own = ['--effects-path', str(effect)]
    added = [found['name'], '--to', str(base), '--bag', str(walk), '-o', str(better), *own]
    assert add_command(added) == 0
    models = ['--models', str(base), str(better), '--json', str(compared), *own]
    assert compare_command([str(other), *models]) == 0
    before, after = json.loads(compared.read_text())['models']
    for drive in found['drives']:
        assert after['drives'][drive]['rmse_w'] < 0.5 * before['drives'][drive]['rmse_w']


def test_where_nothing_is_missing_nothing_is_written_and_the_verdict_says_so(tmp_path, capsys):
    walk = write(tmp_path / 'walk', recorded('', 'walk', seed=4, unit=4, seconds=60.0))
    base, effect, told = (tmp_path / name for name in ('base.yaml', 'effect.py', 'd.json'))
    assert fit_command([str(walk), '--effects', ','.join(KNOWN), '-o', str(base)]) == 0
    outputs = ['-o', str(effect), '--json', str(told)]
    assert discover_command([str(walk), '--model', str(base), *outputs]) == 0
    content = json.loads(told.read_text())
    assert content['found'] == []
    assert content['nothing']
    assert not effect.exists()
    assert 'Nothing is proposed' in capsys.readouterr().out


def test_an_effect_that_the_other_recording_lacks_does_not_transfer(bags, tmp_path):
    walk, _, base = bags
    other = write(tmp_path / 'other', recorded('', 'walk', seed=2, unit=3, seconds=60.0))
    told = tmp_path / 'd.json'
    arguments = [str(walk), str(other), '--model', str(base), '-o', str(tmp_path / 'effect.py')]
    assert discover_command([*arguments, '--json', str(told)]) == 0
    content = json.loads(told.read_text())
    assert content['tested_on'] == ['other']
    assert [one['transfers'] for one in content['found']] == [False]


def test_a_fan_is_told_as_a_cycle_in_time_and_never_written_as_an_effect():
    found = discovered(recorded('fan', 'walk', seed=5, unit=5, seconds=100.0)).found
    assert {one.kind for one in found} == {'time'}
    assert all(one.written is None for one in found)
    assert found[0].course.shape.period > 0.0


def test_what_is_switched_on_once_is_told_as_a_step_in_time_on_a_ladder_too():
    found = discovered(recorded('switched on', 'ladder', seed=0, unit=50, seconds=150.0)).found
    assert [one.kind for one in found] == ['time']
    assert 'a step after' in found[0].course.shape.words


def test_what_another_drive_puts_into_the_meter_is_told_as_the_other_drive():
    found = discovered(recorded('cross-talk', 'walk', seed=6, unit=6, seconds=60.0)).found
    assert found[0].kind == 'other_drive'
    for drive, place in found[0].formula.places.items():
        neighbour = ('LF_HAA', 'LF_HFE', 'LF_KFE')[(drive - 1) % 3]
        assert place.family.driver.other == neighbour


@pytest.mark.parametrize('name', ["');import os#", 'a\nb', 'x"""y', '{0}', "it's"])
def test_a_hostile_name_of_a_drive_is_only_text_in_the_file(tmp_path, name):
    driver = Driver(
        'power_of', 'other_drive', f'P of {name}', 'W', 'signals.drawn[:, other]', other=name
    )
    family = Family(driver, FACTORS['one'], 'power')
    formula = Formula(PRIMITIVES['line'], {0: Place(family, {}, 1.0)})
    written = Written(
        name='cross_talk',
        formula=formula,
        physics=f'hypothesis: {name}',
        bounds=[(0.0, 1.0)],
        near=(),
        excitation={'text': name},
        places={name: {'other': name}},
    )
    path = tmp_path / 'effect.py'
    path.write_text(effect_source([written], [name]), encoding='utf-8')
    effect = load_catalogue([path])['cross_talk']
    assert effect.physics == f'hypothesis: {name}'


def test_a_play_sticks_at_its_edges_and_follows_in_between():
    values = np.cumsum(np.random.default_rng(0).normal(0, 0.1, 500))
    state, expected = values[0], []
    for value in values:
        state = min(max(state, value - 0.15), value + 0.15)
        expected.append((value - state) / 0.15)
    assert play(values, None, 0.3) == pytest.approx(np.array(expected), abs=1e-9)


@pytest.mark.parametrize(
    ('state', 'given'),
    [(play, (0.3,)), (lagged, (200.0, 20.0)), (after_rest, (200.0, 0.5, 1.5, 0.0))],
)
def test_what_is_remembered_goes_on_from_block_to_block(state, given):
    values = np.cumsum(np.random.default_rng(0).normal(0, 0.05, 400))
    data = AlignedDataset.blank(
        200.0, ('A',), np.arange(400) / 200.0, 'walk', velocity=values[:, None], torque=1.0
    )
    whole, carried = signals_of(data), Carried()
    found = []
    for start in range(0, 400, 8):  # blocks of eight after up to twelve that were there before
        rows = slice(max(0, start - 12), start + 8)
        signals = replace(signals_of(data.rows(rows)), carried=carried)
        found.append(by_stretch(signals, 0, values[rows], state, *given)[-8:])
    expected = by_stretch(whole, 0, values, state, *given)
    assert np.concatenate(found) == pytest.approx(expected, abs=1e-12)


def test_bounds_of_a_file_keep_the_sign_that_the_bootstrap_is_sure_of():
    between = np.array([[[2.0, 3.0]], [[2.5, 4.0]]])
    values = between.mean(axis=2)
    ((low, high),) = bounds_of(between, values)
    assert low == 0.0
    assert high > 4.0
    ((low, high),) = bounds_of(-between[..., ::-1], -values)
    assert high == 0.0
    assert low < -4.0


def test_bounds_of_a_file_hold_its_coefficients_wherever_the_bootstrap_put_its_interval():
    random = np.random.default_rng(5)
    for _ in range(200):
        ends = np.sort(random.normal(0, 10 ** random.uniform(-3, 3), (2, 2, 2)), axis=2)
        values = random.normal(0, 10 ** random.uniform(-3, 3), (2, 2))
        for (low, high), own in zip(bounds_of(ends, values), values.T, strict=True):
            assert low <= own.min()
            assert own.max() <= high


def test_three_effects_of_a_small_drive_are_written_with_bounds_around_their_own_coefficients(
    tmp_path,
):
    fitter = material(wheel(rub=0.8, chopper=2.5, reversals=5.0)).fitter(per_drive=True)
    assert fitter.scale.torque[0] < 0.1  # bounds of a reference drive would differ
    actives = [Active.of(CATALOGUE[name]) for name in KNOWN]
    structure = Structure(tuple(actives)).plus(*measurement_terms(CATALOGUE, shaft=True))
    nothing_named = Catalogue([CATALOGUE[name] for name in KNOWN])
    found = Discoverer(fitter, structure, nothing_named).run().found
    assert len(found) == 3
    check_bounds(found)
    path = tmp_path / 'effect.py'
    path.write_text(effect_source([one.written for one in found], ()), encoding='utf-8')
    written = load_catalogue([path])
    for one in found:
        effect = written[one.name]
        assert (effect.factors(fitter.scale) == 1.0).all()
        for values in one.coefficients.values():
            for term, value in zip(effect.terms, values, strict=True):
                assert term.lower < value < term.upper


def test_a_file_whose_bounds_exclude_its_coefficient_is_not_written():
    term = Term('c', 'W', 0.6, 2.2)
    effect = SimpleNamespace(terms=(term,))
    one = Found('loss', 'speed', (0,), np.ones(1), (0.1, 0.2), effect=effect)
    check_bounds([replace(one, coefficients={0: (1.0,)})])
    with pytest.raises(ValueError, match=r'loss: c = 0.09831 W is outside'):
        check_bounds([replace(one, coefficients={0: (0.09831,)})])


def test_what_the_catalogue_names_comes_first_and_the_rest_is_found_beside_it():
    few = [Active.of(CATALOGUE[name]) for name in ('shaft', 'copper_loss', 'idle')]
    structure = Structure(tuple(few)).plus(*measurement_terms(CATALOGUE, shaft=True))
    fitter = material(wheel(rub=0.75, viscous=0.05, coulomb=0.3)).fitter(per_drive=True)
    discovery = Discoverer(fitter, structure, CATALOGUE).run()
    assert discovery.named
    assert {one.name for one in discovery.named} <= {
        'viscous_friction',
        'coulomb_friction',
        'iron_loss',
    }
    assert [one.name for one in discovery.found] == ['position_rub']
    (place,) = discovery.found[0].formula.places.values()
    assert place.parameters['middle'] == pytest.approx(0.0, abs=0.1)
    assert place.parameters['half'] == pytest.approx(np.arccos(0.7), abs=0.1)


def test_a_power_that_goes_as_a_term_of_the_model_is_that_term_under_another_name():
    fitter = material(wheel()).fitter(per_drive=True)
    actives = [Active.of(CATALOGUE[name]) for name in KNOWN]
    fit = fitter.fit(Structure(tuple(actives)).with_discrepancies(), iterations=2)
    point = fitter.builder.point(fit.structure, fit.coefficients)
    size = Driver('torque_size', 'torque', '|torque|', 'N·m', 'np.abs(signals.torque[:, column])')
    given = {'square': {}, 'line': {}, 'above': {'limit': 1.5}}
    repeats = {
        name: same_term(
            Formula(
                PRIMITIVES[name],
                {0: Place(Family(size, FACTORS['one'], 'power'), parameters, 1.0)},
            ),
            (fit,),
            point,
            fitter.prepared,
        )
        for name, parameters in given.items()
    }
    assert repeats == {'square': 'copper_loss', 'line': '', 'above': ''}


def test_options_that_repeat_a_term_leave_none_where_they_explain_clearly_more():
    def option(name, score):
        return SimpleNamespace(formula=name, score=score)

    def term_of(formula):
        return 'copper_loss' if formula == 'copper again' else ''

    ranked = [option('copper again', 1.0), option('rub', 0.9)]
    assert without_known(ranked, term_of) == (ranked[1:], 'copper_loss')
    ranked[1] = option('rub', 0.5)
    assert without_known(ranked, term_of) == ([], 'copper_loss')


def test_names_of_effects_stay_whole_and_each_has_a_line_at_eighty_columns():
    found = Found('position_load_friction', 'position', (0,), np.ones(1), (4.674, 5.046))
    outcome = SimpleNamespace(
        sentence='found',
        discovery=SimpleNamespace(found=(found, replace(found, name='torque_loss'))),
        transfers=(None, None),
        own=SimpleNamespace(prepared=SimpleNamespace(names=('WHEEL',))),
    )
    text = StringIO()
    print_discovery(Console(file=text, width=80), outcome)
    lines = text.getvalue().splitlines()
    assert [line.split()[0] for line in lines] == [
        'found',
        'effect',
        'position_load_friction',
        'torque_loss',
    ]
    assert lines[2].split()[1:] == ['position', 'WHEEL', '1.00', 'W', '4.67–5.05', 'W', '–']
    both = replace(found, drives=(0, 1), gain=np.array([9.0, 16.0]))
    outcome.discovery.found = (both,)
    outcome.transfers = (SimpleNamespace(transfers=True),)
    outcome.own.prepared.names = ('LEFT', 'RIGHT')
    text = StringIO()
    print_discovery(Console(file=text, width=80), outcome)
    joint, *own = (line.split() for line in text.getvalue().splitlines()[2:])
    assert joint[1:] == ['position', 'rms', 'of', 'all', '3.54', 'W', '4.67–5.05', 'W', 'yes']
    assert own == [['LEFT', '3.00', 'W'], ['RIGHT', '4.00', 'W']]


def test_a_place_in_the_turn_and_a_ripple_are_told_as_a_person_says_them():
    turn = Driver('angle', 'position', 'q within its turn', 'rad', 'signals.position[:, column]')
    family = Family(turn, FACTORS['sign'], 'torque')
    assert principal({'middle': 6.27})['middle'] == pytest.approx(-0.0132, abs=1e-4)
    wave = Formula(PRIMITIVES['wave'], {0: Place(family, {'order': 2.0}, 1.0)})
    assert 'rubs 2 times per turn: 0.5 N·m' in in_short(wave, {0: (0.3, 0.4)}, ['WHEEL'])


def test_the_last_of_several_recordings_tests_what_the_others_show():
    assert split(['a', 'b', 'c'], []) == (['a', 'b'], ['c'])
    assert split(['a', 'b'], ['c']) == (['a', 'b'], ['c'])
    assert split(['a'], []) == (['a'], [])


def test_a_file_that_is_not_python_is_refused_before_anything_is_read(tmp_path, capsys):
    arguments = ['nowhere', '--model', 'base.yaml', '-o', str(tmp_path / 'effect.txt')]
    assert discover_command(arguments) == 2
    assert '.py' in capsys.readouterr().err
