"""Energy budgets: parts that add up, intervals, levers, commands."""

import json
import re
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure, evaluate
from power_estimator.effects.signals.prepared import WHOLE
from power_estimator.effects.split import split
from power_estimator.live.estimator import stream_of
from power_lab.budget import choice
from power_lab.budget.account import Account
from power_lab.budget.levers import Lever, carried_over, parse_changes
from power_lab.budget.tables import headline
from power_lab.budget.tally import Tally, block_sums, blocks_of, interval, phase_masks
from power_lab.commands.arguments import budget as budget_command
from power_lab.report.budget_page import fanned
from wattwalk_core.errors import InputError

from power_lab import Session

EFFECTS = 'shaft copper_loss viscous_friction coulomb_friction idle'


@pytest.fixture(scope='module')
def lab(bag):
    """A model of a leg that lacks its load friction."""
    return Session.open(bag).fit(EFFECTS)


@pytest.fixture(scope='module')
def found(lab):
    """Its budget with a battery."""
    return lab.budget(battery=100.0)


def test_a_first_look_has_the_watts_of_the_budget_and_no_intervals(lab, found):
    looks = []
    again = lab.budget(battery=100.0, first=looks.append)
    (first,) = looks
    for early, late, last in zip(
        first.account.rows(), again.account.rows(), found.account.rows(), strict=True
    ):
        assert early.mean_w == pytest.approx(late.mean_w)
        assert late.mean_w == last.mean_w
        assert np.isnan(early.interval).all()
        assert np.isfinite(late.interval).all()
    assert first.levers == ()
    assert np.isnan(first.error_w)


def test_a_model_says_nothing_of_drives_that_it_does_not_know(lab):
    data = lab.judge.recordings.data
    strange = replace(data, names=('a', 'b', 'c'))
    assert np.isnan(lab.effects.predict(strange)).all()
    assert lab.effects.by_part(strange) == {}
    stream = stream_of(lab.effects, strange.names, data.rate)
    assert np.isnan(stream.advance(strange.rows(slice(0, 8)))).all()
    half = replace(data, names=('LF_HAA', 'b', 'c'))
    known = lab.effects.predict(half)
    np.testing.assert_allclose(known[:, 0], lab.effects.predict(data)[:, 0], rtol=1e-6)
    assert np.isnan(known[:, 1:]).all()


def test_parts_of_a_model_sum_to_its_power(lab):
    known = builtin_catalogue()
    names = (
        *('shaft', 'copper_loss', 'winding_heating', 'viscous_friction', 'load_friction'),
        *('rotor_inertia', 'spring', 'idle', 'line_resistance', 'regeneration_efficiency'),
    )
    structure = Structure(
        tuple(
            Active.of(known[name], {'motor': 1.0} if name == 'load_friction' else None)
            for name in names
        )
    )
    signals = lab.judge.prepared.signals
    sizes = (0.02, 0.0, 0.0, 4.0, 0.1, 0.05, 0.004, 8.0, 0.1, 0.3)
    coefficients = np.tile(sizes, (3, 1))
    parts = split(structure, coefficients, signals)
    assert set(parts.parts) == set(names)
    assert sum(parts.parts.values()) == pytest.approx(evaluate(structure, coefficients, signals))


def test_friction_counts_at_the_shaft_and_its_copper_loss_as_copper(lab):
    known = builtin_catalogue()
    structure = Structure(
        tuple(Active.of(known[name]) for name in ('shaft', 'copper_loss', 'viscous_friction'))
    )
    signals = lab.judge.prepared.signals
    found = split(structure, np.tile((0.02, 3.0), (3, 1)), signals).parts
    torque, speed = signals.torque, signals.velocity
    assert found['viscous_friction'] == pytest.approx(3.0 * speed**2)
    assert found['copper_loss'] == pytest.approx(0.02 * (torque + 3.0 * speed) ** 2)


def test_a_chosen_effect_that_does_not_lower_the_held_out_error_is_dropped(lab, monkeypatch):
    few = [*EFFECTS.split(), 'load_friction', 'cogging']  # the leg has no cogging
    monkeypatch.setattr(choice, 'chosen_effects', lambda judge: few)
    model = choice.chosen_model(lab.judge)
    assert model.effects == tuple(few[:-1])
    assert choice.held_out_w(model) < choice.held_out_w(lab.effects)


def test_a_headline_names_kinds_of_parts_and_the_surest_lever(found):
    said = headline(found.account, [Lever('idle=0.9', -1.26, (-1.4, -1.1))])
    assert headline(found.account, found.levers) in ' '.join(str(found).split())
    assert said.endswith('; 10 % less idle saves most, 1.3 W')
    assert 'copper and cables' in said
    unsure = [Lever('gear_ratio=1.1', -9.0, (-20.0, 1.0))]
    assert headline(found.account, unsure) == headline(found.account)
    assert re.search(r'% \(-?\d+ … -?\d+ %\) is unexplained', said)


def test_phases_divide_the_time_of_a_drive():
    torque = np.array([[1.0], [1.0], [-1.0], [5.0]])
    speed = np.array([[2.0], [-2.0], [2.0], [0.01]])
    masks = phase_masks(torque, speed, np.array([0.05]), None)
    names = ('driving', 'braking', 'rest')
    assert [[bool(m) for m in masks[n][:, 0]] for n in names] == [
        [True, False, False, False],
        [False, True, True, False],
        [False, False, False, True],
    ]


def test_a_phase_of_two_drives_has_the_mean_of_all_their_rows_in_it():
    def tally(watts, rows):
        return Tally(('a',), np.full((2, 1, 2), watts * rows), np.full((2, 1), rows))

    both = Tally.beside([tally(10.0, 3.0), tally(20.0, 1.0)])
    assert both.means[0, 0].tolist() == [25.0, 0.0, 25.0]  # 2 · (3·10 + 1·20)/4


def test_blocks_that_are_drawn_anew_keep_the_sums_of_their_seconds():
    block = blocks_of([slice(0, 3), slice(3, 5)], 2)
    assert block.tolist() == [0, 0, 1, 2, 2]
    rows, often = np.arange(5.0)[:, None], np.array([[2.0, 0.0, 1.0]])
    sums, counts = block_sums(rows, [np.ones(5, bool)], block, often)
    assert sums[:, 0, 0].tolist() == [10.0, 9.0]
    assert counts[:, 0].tolist() == [5.0, 6.0]


def test_an_interval_holds_its_estimate():
    draws = np.concatenate([[5.0], np.linspace(0.0, 1.0, 101)])
    assert interval(draws).tolist() == [pytest.approx(0.05), 5.0]


def test_rows_add_up_to_what_was_metered(found):
    content = found.json()
    for name in ('LF_HAA', 'LF_KFE', 'robot'):
        rows = [r for r in content['rows'] if r['drive'] == name and r['phase'] == 'all']
        metered = found.account.tallies[name].means[0, 0, -1]
        assert sum(row['mean_w'] for row in rows) == pytest.approx(metered)
        assert sum(row['share'] for row in rows) == pytest.approx(1.0)
    assert content['total_w'] + content['unexplained_w'] == pytest.approx(content['metered_w'])


def test_energies_of_the_phases_add_up_to_those_of_all_rows(found):
    rows = found.json()['rows']

    def energy(phase):
        chosen = [r for r in rows if r['drive'] == 'LF_KFE' and r['phase'] == phase]
        return sum(row['energy_wh'] for row in chosen)

    apart = sum(map(energy, ('driving', 'braking', 'rest')))
    assert apart == pytest.approx(energy('all'), rel=1e-6)


def test_what_the_joints_give_back_is_negative_and_apart_from_their_work(found):
    shares = {s.effect: s for s in found.account.shares('LF_KFE')}
    assert shares['shaft'].mean_w > 0.0 > shares['regeneration'].mean_w
    braking = {s.effect: s for s in found.account.shares('LF_KFE', 'braking')}
    driving = {s.effect: s for s in found.account.shares('LF_KFE', 'driving')}
    assert braking['regeneration'].mean_w < driving['regeneration'].mean_w


def test_a_drive_of_no_type_stands_beside_the_types():
    drives = {name: 1 for name in ('LEFT_HIP', 'LEFT_KNEE', 'RIGHT_HIP', 'RIGHT_KNEE', 'WAIST')}
    tallies = {n: SimpleNamespace(drives=k) for n, k in (drives | {'HIP': 2, 'KNEE': 2}).items()}
    account = Account('walk', tallies | {WHOLE: SimpleNamespace(drives=5)}, ('all',))
    assert account.groups == ['HIP', 'KNEE', 'WAIST']


def test_labels_of_small_flows_do_not_meet():
    values = [70.0, 1.0, 2.0, 1.0, 20.0]
    begins = fanned(values, sum(values))
    centres = np.add(begins, 0.5 * np.array(values))
    assert np.diff(centres).min() >= 0.09 * sum(values) - 1e-9
    assert begins[0] + begins[-1] + values[-1] == pytest.approx(sum(values))  # about the middle


def test_a_battery_lasts_its_energy_over_the_power(found):
    content = found.json()
    hours = content['runtime_h']['all']
    assert hours['hours'] == pytest.approx(100.0 / content['metered_w'])
    assert hours['interval'][0] <= hours['hours'] <= hours['interval'][1]


def test_less_idle_saves_that_share_of_it(lab, found):
    idle = sum(group.coefficients['idle'][0].value for group in found.model.groups)
    (lever,) = lab.budget({'idle': 0.5}).levers
    assert lever.change == 'idle=0.5'
    assert lever.mean_w == pytest.approx(-0.5 * idle, rel=1e-6)


def test_a_longer_gear_saves_copper_loss_with_the_square_of_its_ratio(lab):
    copper = Session(lab.judge).fit('shaft copper_loss idle')
    share = next(s for s in copper.budget().account.shares('robot') if s.effect == 'copper_loss')
    (lever,) = copper.budget({'gear_ratio': 1.25}).levers
    assert lever.mean_w == pytest.approx(-share.mean_w * (1 - 1.25**-2), rel=0.03)


def test_the_table_of_levers_begins_with_the_largest(found):
    saved = [lever.mean_w for lever in found.levers]
    assert saved == sorted(saved)
    assert saved[0] < 0.0


def test_a_lever_that_an_effect_does_not_tell_of_is_refused(lab):
    more = lab.add('field_weakening')
    with pytest.raises(InputError, match='gear_ratio: what becomes of field_weakening is not'):
        more.budget({'gear_ratio': 1.1})
    assert any('gear_ratio' in reason for reason in more.budget().refused)


@pytest.mark.parametrize('lever', ['payload', 'friction', 'gear_ratio'])
def test_a_torque_with_friction_in_it_is_not_scaled(lab, lever):
    signals = lab.judge.prepared.signals
    signals = replace(signals, at_motor=np.ones(len(signals.names), dtype=bool))
    with pytest.raises(InputError, match=f"{lever}: the torque of .* is the motor's"):
        carried_over(lab.effects, signals, lever, 0.9)


@pytest.mark.parametrize('text', ['gear=2', 'idle', 'idle=much', 'idle=-1', 'idle=1.1,idle=2'])
def test_a_change_that_is_no_lever_and_factor_is_refused(text):
    with pytest.raises(InputError, match='--change'):
        parse_changes(text)


def test_the_budget_of_a_model_from_elsewhere_adds_up(lab, bag, tmp_path):
    half = Session.open(bag).fit('shaft copper_loss idle')
    stranger = half.save(tmp_path / 'model.yaml')
    stranger.write_text(stranger.read_text().replace('sha256: ', 'sha256: 0'))
    content = Session.open(bag).load(str(stranger)).budget().json()
    rows = [r for r in content['rows'] if r['drive'] == 'robot' and r['phase'] == 'all']
    assert 'measurement' not in {row['effect'] for row in rows}
    assert sum(row['mean_w'] for row in rows) == pytest.approx(content['metered_w'])


def test_recordings_are_compared_with_the_first(lab, bag, tmp_path):
    other = tmp_path / 'again'
    shutil.copytree(bag, other)
    content = Session.open(bag, other).load(str(lab.save(tmp_path / 'm.yaml'))).budget().json()
    assert [one['name'] for one in content['recordings']] == [bag.name, 'again']
    metered = [
        row
        for row in content['differences']
        if (row['drive'], row['phase'], row['effect']) == ('robot', 'all', 'metered')
    ]
    assert [row['recording'] for row in metered] == ['again']
    assert metered[0]['mean_w'] == pytest.approx(0.0, abs=1e-6)


def test_the_command_chooses_a_model_and_writes_all_results(bag, tmp_path, capsys):
    told, page, pictures = tmp_path / 'b.json', tmp_path / 'b.html', tmp_path / 'pictures'
    arguments = [str(bag), '--battery', '907Wh', '--json', str(told), '--report', str(page)]
    assert budget_command([*arguments, '--figures', str(pictures)]) == 0
    printed = capsys.readouterr().out
    assert 'chosen by its error on held-out data' in printed
    content = json.loads(told.read_text())
    keys = {'rows', 'total_w', 'metered_w', 'unexplained_w', 'energy_wh', 'levers', 'runtime_h'}
    assert keys <= content.keys()
    assert {'drive', 'phase', 'effect', 'mean_w', 'interval', 'share'} <= content['rows'][0].keys()
    assert {'stance', 'swing'} <= {row['phase'] for row in content['rows']}
    assert {path.name for path in pictures.iterdir()} >= {'flow.svg', 'bars.png', 'gait.svg'}
    text = page.read_text().partition('<script')[0]
    assert text.count('<svg') >= 4
    assert not [mark for mark in ('src="http', 'url(http', 'href="http') if mark in text]


def test_the_command_refuses_a_battery_without_energy(bag, capsys):
    with pytest.raises(SystemExit):
        budget_command([str(bag), '--battery', '3V'])
    assert '3V' in capsys.readouterr().err


def test_the_command_refuses_a_model_without_effects(bag, capsys):
    assert budget_command([str(bag), '--model', 'torque_squared']) == 2
    assert 'not made of effects' in capsys.readouterr().err
