"""Benchmark of the lab's reliability: what is counted as true, and how often it was."""

import json

import pytest
import reliability
from judgements import diagnosed
from reliability import (
    beside_hidden,
    by,
    covered,
    detections,
    measurement,
    said,
    share,
)
from reliability_questions import OfPlant, OfRobot, Sealed, plant_questions, robot_questions
from truths import FAMILIES, Case, record

ROW = {
    'family': 'rigid',
    'developed': True,
    'hidden': ['spring'],
    'missing': ['spring'],
    'complete': True,
    'impossible': [],
    'watts': {'spring': 3.0},
    'rms_w': 10.0,
    'statements': [['spring', 0.97], ['idle', 0.6]],
    'seconds': 20.0,
    'intervals': [['A', 'k', 0.95, 0.01, 0.02], ['A', 'k', 0.5, 0.016, 0.02]],
    'coefficients': {'A': {'k': 0.015}},
}


def test_interval_of_a_share_is_the_textbooks():
    assert share(0, 10) == '0.00 [0.00, 0.31] of 10'
    assert share(95, 100) == '0.95 [0.89, 0.98] of 100'
    assert share(0, 0) == '–'


def test_statements_and_intervals_are_held_against_the_truth():
    assert [(e, p, t) for _, e, p, t in said([ROW])] == [
        ('spring', 0.97, True),
        ('idle', 0.6, False),
    ]
    assert [(level, holds) for _, _, level, holds in covered([ROW])] == [
        (0.95, True),
        (0.5, False),
    ]


def test_what_nobody_knows_is_not_counted_but_what_physics_rules_out_is():
    log = ROW | {'complete': False, 'impossible': ['idle'], 'missing': []}
    assert [(effect, true) for _, effect, _, true in said([log])] == [('idle', False)]


def test_effects_too_small_to_find_are_not_missed():
    small = ROW | {'watts': {'spring': 0.2}, 'statements': []}
    table = by([small], 'family', lambda row: row['family'])
    assert list(table.columns[4].cells) == ['–']
    table = by([ROW], 'family', lambda row: row['family'])
    assert list(table.columns[4].cells) == ['1.00 [0.03, 1.00] of 1']


def test_found_effects_are_counted_by_what_known_effects_leave_of_them():
    rows = [ROW | {'apart': {'spring': part * ROW['rms_w']}} for part in (0.06, 0.03, 0.001)]
    rows[0]['statements'] = []
    found = list(detections(rows).columns[1].cells)
    assert [cell.rpartition(' ')[2] for cell in found] == ['1', '2', '3']
    assert [cell.partition(' ')[0] for cell in found] == ['0.00', '0.50', '0.67']


def test_names_of_one_family_find_a_hidden_effect_together():
    either = [['regeneration_limit', 0.49], ['regeneration_efficiency', 0.49]]
    watts = {'regeneration_limit|regeneration_efficiency': 3.0}
    row = ROW | {'missing': ['regeneration_limit'], 'statements': either, 'watts': watts}
    table = by([row], 'family', lambda row: row['family'])
    assert list(table.columns[4].cells) == ['1.00 [0.03, 1.00] of 1']


def test_names_that_come_with_what_is_hidden_in_a_log_are_counted_apart_from_its_own():
    log = ROW | {'family': 'log A', 'hidden': [], 'statements': [['idle', 0.96]]}
    stated = [['spring', 0.97], ['idle', 0.99], ['cogging', 0.95], ['power_gain', 0.99]]
    table = beside_hidden([log, log | {'hidden': ['spring 5%'], 'statements': stated}])
    assert [list(column.cells) for column in table.columns] == [['log A'], ['1'], ['1']]


def test_questions_are_a_sample_that_does_not_change():
    one, two = (plant_questions(list(FAMILIES), 20) for _ in range(2))
    assert one == two
    assert len({question.key for question in one}) == 20 * len(FAMILIES)
    hidden = [question.case.hidden for question in one]
    assert 0.25 < sum(not names for names in hidden) / len(hidden) < 0.55
    assert all(not q.case.hidden for q in plant_questions(['robot'], 20, nulls=True))


def test_scale_of_the_torque_sensor_is_true_to_say():
    sealed = OfPlant(Case('gimbal', 'ladder', 10.0, 1, seed=0)).seal()
    assert isinstance(sealed, Sealed)
    scale = sealed.coefficients['LF_KFE']['torque_scale']
    assert abs(scale - 1) > 0.02
    assert 'torque_scale' in sealed.missing


def test_results_are_kept_and_not_asked_again(tmp_path, capsys):
    out = tmp_path / 'rows.jsonl'
    options = ['--families', 'rigid', '--count', '2', '--seconds', '10', '--drives', '1']
    options += ['--nulls', '--workers', '1', '--out', str(out)]
    assert reliability.main(['--judge', 'stub_judges:omniscient', *options]) == 0
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert [row['words'] for row in rows] == ['never at a loss'] * 2
    assert 'wrong at' in capsys.readouterr().out
    assert reliability.main(['--judge', 'stub_judges:omniscient', *options]) == 0
    assert len(out.read_text().splitlines()) == 2
    assert reliability.main(['--judge', 'stub_judges:broken', *options]) == 0
    assert 'no judge today' in capsys.readouterr().err


def test_scales_are_counted_where_they_are_off_and_where_they_are_not():
    off = ROW | {'missing': ['torque_scale'], 'statements': [['torque_scale', 0.97]]}
    table = measurement([off, ROW])
    assert [next(iter(column.cells)) for column in table.columns] == [
        'torque_scale',
        '1.00 [0.03, 1.00] of 1',
        '1.00 [0.03, 1.00] of 1',
        '0.00 [0.00, 0.97] of 1',
    ]


def test_the_lab_states_a_probability_of_every_effect_and_scale_and_intervals_at_three_levels():
    sealed = OfPlant(Case('rigid', 'ladder', 30.0, 1, seed=1)).seal()
    judgement = diagnosed(sealed.data, sealed.known)
    assert {one.coefficient for one in judgement.intervals} >= {'k', 'idle', 'friction_at_1'}
    assert {one.level for one in judgement.intervals} == {0.5, 0.8, 0.95}
    said_of = judgement.statements.keys()
    assert said_of >= {'spring', 'load_friction', 'power_gain', 'torque_scale'}
    assert not said_of & {*sealed.known}
    assert judgement.words


def test_a_friction_is_found_whose_watts_departures_of_others_took_over():
    case = Case('elastic', 'ladder', 60.0, 1, 3100002, ('coulomb_friction',), strength=2.0)
    sealed = OfPlant(case).seal()
    stated = diagnosed(sealed.data, sealed.known).statements
    assert stated['coulomb_friction'] > 0.9
    assert max(chance for name, chance in stated.items() if name not in sealed.missing) < 0.5


def test_every_other_walk_of_the_robot_has_real_drives():
    questions = robot_questions(40)
    assert sum(question.real for question in questions) == 20
    assert {question.about['developed'] for question in questions if question.real} == {False}
    sealed = OfRobot(4.0, 1, ('spring',), real=True).seal()
    assert sealed.missing == {'spring'}
    assert not {'spring', 'torque_loop', 'battery'} & {*sealed.known}
    assert sealed.coefficients['LF_KFE']['spring'] == pytest.approx(1 / 400)


def test_the_lab_names_copper_that_is_left_out_and_nothing_of_a_null():
    whole = record(Case('rigid', 'walk', seconds=40.0, drives=1, seed=3))
    said_of_whole, said_without = (
        {
            name
            for name, chance in diagnosed(whole.data, known).statements.items()
            if chance >= 0.95
        }
        for known in (whole.known, tuple(n for n in whole.known if n != 'copper_loss'))
    )
    assert said_of_whole == set()
    assert said_without == {'copper_loss'}
