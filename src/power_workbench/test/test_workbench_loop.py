"""The loop in a real browser: open, fit, look, diagnose, add; the numbers of the commands."""

import json
import re
import signal
from pathlib import Path

import pytest
import yaml
from power_lab.budget.tables import headline
from power_lab.commands.arguments import add as add_command
from power_lab.commands.arguments import compare as compare_command
from power_lab.commands.arguments import fit as fit_command
from power_lab.session import Session
from power_workbench.commands.arguments import replay_session as replay_command
from power_workbench.sessions.steps import SessionRecord
from workbench_page import BROWSER, page_of, served

playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
pytestmark = pytest.mark.skipif(BROWSER is None, reason='no Chromium on this machine')

EFFECTS = (
    'mechanical power at the joint',
    'copper loss in the winding',
    'idle draw',
    'viscous friction',
    'Coulomb friction',
    'rotor inertia',
)
KNOWN = 'shaft,copper_loss,idle,viscous_friction,coulomb_friction,rotor_inertia'


@pytest.fixture(scope='module')
def browser():
    with playwright.sync_playwright() as running:
        made = running.chromium.launch(executable_path=BROWSER, args=['--no-sandbox'])
        yield made
        made.close()


def barriers_of(page):
    """Complaints of axe by theme and width, with all that can be unfolded unfolded."""
    axe = pytest.importorskip('axe_playwright_python.sync_playwright')
    found = {}
    for part in page.locator('details').all():
        part.evaluate('part => { part.open = true; }')
    for scheme, width in (('light', 1280), ('dark', 1280), ('light', 390)):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({'width': width, 'height': 900})
        page.wait_for_timeout(500)
        seen = axe.Axe().run(page).response['violations']
        if page.evaluate('() => document.documentElement.scrollWidth') > width:
            seen.append({'id': 'wider than the screen', 'nodes': []})
        for one in seen:
            found[scheme, width, one['id']] = [node['html'] for node in one['nodes']]
    page.emulate_media(color_scheme='light')
    page.set_viewport_size({'width': 1280, 'height': 900})
    return found


def errors(bag, model, folder):
    path = folder / 'compared.json'
    assert compare_command([str(bag), '--models', str(model), '--json', str(path)]) == 0
    (told,) = json.loads(path.read_text())['models']
    return {meter: own['rmse_w'] for meter, own in told['drives'].items()}


def coefficients(path):
    groups = yaml.safe_load(path.read_text())['drives']
    return {
        (name, effect, i): value['value']
        for name, group in groups.items()
        for effect, values in group['coefficients'].items()
        for i, value in enumerate(values)
    }


@pytest.fixture(scope='module')
def walked(bag, browser, tmp_path_factory):
    """The loop as a person walks it, then kill -9; the folder of the session."""
    folder, complaints = tmp_path_factory.mktemp('loop'), []
    with served(folder, bag) as bench:
        page = page_of(browser, bench.address, complaints)
        page.locator('#plot-traces .main-svg').first.wait_for()
        page.get_by_role('button', name='Fit', exact=True).wait_for()
        for name in ('flow', 'efficiency', 'gait'):
            page.locator(f'#plot-{name} .main-svg').first.wait_for()
        budget = page.locator('#headline').inner_text().replace('\xa0', ' ')
        for effect in EFFECTS[3:]:
            page.locator('label.choice', has_text=effect).first.click()
        page.get_by_role('button', name='Fit', exact=True).click()
        page.locator('#plot-map .main-svg').first.wait_for()

        page.get_by_role('radio', name='phase of the stride').check()
        page.locator('#plot-map .xtitle', has_text='stride phase').wait_for()
        stride = page.locator('#stride').inner_text()
        page.locator('#regimes button').first.click()
        sentence = page.locator('#selection')
        sentence.wait_for()
        by_regime = sentence.inner_text()
        page.locator('#plot-map').scroll_into_view_if_needed()
        page.get_by_role('button', name='Clear the mark').click()
        plot = page.locator('#plot-map .nsewdrag').bounding_box()
        across, up = plot['x'] + 0.1 * plot['width'], plot['y'] + 0.1 * plot['height']
        page.mouse.move(across, up)
        page.mouse.down()
        page.mouse.move(across + 0.8 * plot['width'], up + 0.8 * plot['height'], steps=6)
        page.mouse.up()
        sentence.wait_for()
        by_box = sentence.inner_text()
        page.get_by_text('marked', exact=True).first.wait_for()
        page.get_by_role('radio', name='mark a span').check()
        page.locator('#plot-traces').scroll_into_view_if_needed()
        plot = page.locator('#plot-traces .nsewdrag').first.bounding_box()
        page.mouse.move(plot['x'] + 0.3 * plot['width'], plot['y'] + 0.5 * plot['height'])
        page.mouse.down()
        page.mouse.move(plot['x'] + 0.5 * plot['width'], plot['y'] + 0.5 * plot['height'], steps=6)
        page.mouse.up()
        page.locator('#selection', has_text=' s: the model is').wait_for()
        by_span = sentence.inner_text()

        page.get_by_role('button', name='Find what is missing').click()
        verdict = page.locator('#verdict')
        verdict.wait_for()
        told = verdict.inner_text()
        page.locator('.candidate').first.hover()
        page.locator('#plot-traces').get_by_text('error with').first.wait_for()
        barriers = barriers_of(page)
        page.get_by_role('button', name='Add friction that grows with load').first.click()
        stairs = page.locator('#stairs-words', has_text='From')
        stairs.wait_for()
        fallen = stairs.inner_text()
        session = next((folder / 'workbench').iterdir())
        bench.process.send_signal(signal.SIGKILL)
        bench.process.wait()
        page.get_by_text('does not answer').wait_for()
    complaints = [text for text in complaints if 'Failed to load resource' not in text]
    return {
        'folder': folder,
        'budget': budget,
        'session': session,
        'regime': by_regime,
        'box': by_box,
        'stride': stride,
        'span': by_span,
        'verdict': told,
        'stairs': fallen,
        'complaints': complaints,
        'barriers': barriers,
    }


def test_the_page_names_the_hidden_effect_and_the_error_falls_when_it_is_added(walked):
    assert walked['verdict'].startswith('Friction that grows with load is missing')
    assert 'in 1 step' in walked['stairs']
    session = SessionRecord.read(walked['session'])
    assert [step.kind for step in session.steps] == ['open', 'fit', 'add']
    before, after = (sum(step.rmse_w.values()) for step in session.steps[1:])
    assert after < 0.7 * before
    assert walked['complaints'] == []


def test_before_there_is_a_model_the_page_says_where_the_power_goes(walked, bag):
    found = Session.open(bag).budget()
    sentence = headline(found.account, found.levers)
    assert walked['budget'] == f'{sentence[0].upper()}{sentence[1:]}.'


def test_axe_finds_no_barrier_in_light_and_dark_nor_on_a_phone(walked):
    assert walked['barriers'] == {}


def test_the_map_has_the_phase_of_a_walking_robots_stride(walked):
    assert re.fullmatch(r'A stride takes 0\.[4-9]\d s; .* where LF_\w+ has .*', walked['stride'])


def test_map_and_traces_are_linked_both_ways(walked):
    assert 'rms inside against' in walked['regime']
    assert 'torque' in walked['box']
    assert 'velocity' in walked['box']
    assert 'rms inside against' in walked['span']


def test_numbers_of_the_page_are_those_of_the_commands(walked, bag, tmp_path):
    _, fit, add = SessionRecord.read(walked['session']).steps
    base, better = tmp_path / fit.model, tmp_path / add.model
    assert fit_command([str(bag), '--effects', KNOWN, '-o', str(base)]) == 0
    arguments = ['load_friction', '--to', str(base), '--bag', str(bag), '-o', str(better)]
    assert add_command(arguments) == 0
    for model, step in ((base, fit), (better, add)):
        assert errors(bag, model, tmp_path) == pytest.approx(step.rmse_w, rel=1e-6)
        own = coefficients(walked['session'] / step.model)
        assert coefficients(model) == pytest.approx(own, rel=1e-6)


def test_a_session_replays_to_the_same_numbers(walked, tmp_path, capsys):
    found = tmp_path / 'again.json'
    again = tmp_path / 'again'
    arguments = [str(walked['session']), '-o', str(again), '--json', str(found)]
    assert replay_command(arguments) == 0
    assert 'the same numbers as in the session' in capsys.readouterr().out
    assert [step['step'] for step in json.loads(found.read_text())['steps']][1:] == [
        'add load_friction'
    ]
    for name in ('model_1.yaml', 'model_2.yaml'):
        assert coefficients(again / name) == coefficients(walked['session'] / name)


def test_a_session_whose_numbers_were_changed_does_not_replay(walked, tmp_path, capsys):
    text = (walked['session'] / 'session.yaml').read_text()
    session = SessionRecord.read(walked['session'])
    value = next(iter(session.steps[1].rmse_w.values()))
    (tmp_path / 'session.yaml').write_text(text.replace(f'{value}', f'{1.01 * value:.6g}', 1))
    assert replay_command([str(tmp_path)]) == 1
    assert 'not the same numbers' in capsys.readouterr().out


def test_after_a_kill_the_history_up_to_the_last_step_is_there_and_can_be_undone(
    walked, bag, browser
):
    complaints = []
    with served(walked['folder'], bag) as bench:
        page = page_of(browser, bench.address, complaints)
        page.get_by_text('Earlier sessions').click()
        page.get_by_role('button', name=walked['session'].name).click()
        stairs = page.locator('#stairs-words', has_text='From')
        stairs.wait_for()
        assert stairs.inner_text() == walked['stairs']
        page.get_by_role('button', name='Undo').click()
        page.locator('#stairs-words', has_text='The first model').wait_for()
        page.get_by_role('button', name='Redo').click()
        stairs.wait_for()
        page.reload()
        stairs.wait_for()
        assert stairs.inner_text() == walked['stairs']
    session = SessionRecord.read(walked['session'])
    assert (session.at, len(session.steps)) == (3, 3)
    assert Path(session.opened.recordings[0]) == bag
    assert [text for text in complaints if 'Failed to load resource' not in text] == []
