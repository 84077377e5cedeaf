"""The rest of the loop in a real browser: an effect of no catalogue, learned, read, run, added."""

import pytest
from power_estimator.effects import load_catalogue
from power_estimator.effects.model_file.yaml_file import read_model
from power_workbench.commands.arguments import replay_session as replay_command
from power_workbench.sessions.steps import SessionRecord
from workbench_page import BROWSER, page_of, served

playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
pytestmark = pytest.mark.skipif(BROWSER is None, reason='no Chromium on this machine')

KNOWN = {
    'copper_loss': 'copper loss in the winding',
    'viscous_friction': 'viscous friction',
    'coulomb_friction': 'Coulomb friction',
    'rotor_inertia': 'rotor inertia',
    'idle': 'idle draw',
}


@pytest.fixture(scope='module')
def rubbing(tmp_path_factory):
    """A walk of 60 s of two drives that rub at some angles, from sim_bridge."""
    from sim_bridge.offline.run import run_offline
    from sim_bridge.plant.parameters import Plant

    plant = Plant.load('anymal_c').unit(3)
    effects: dict[str, bool | float] = {name: name in KNOWN for name, _ in plant.effects}
    effects['position_rub'] = 2.5
    return run_offline(
        tmp_path_factory.mktemp('bags') / 'walk',
        duration=60.0,
        seed=5,
        plant=plant.with_effects(**effects),
        drives=('LF_HFE', 'LF_KFE'),
    )


@pytest.fixture(scope='module')
def learned(rubbing, tmp_path_factory):
    """The page from fit to the effect that it learned, ran by a click and added."""
    folder, complaints = tmp_path_factory.mktemp('learned'), []
    with (
        playwright.sync_playwright() as running,
        running.chromium.launch(executable_path=BROWSER, args=['--no-sandbox']) as browser,
        served(folder, rubbing) as bench,
    ):
        page = page_of(browser, bench.address, complaints)
        page.get_by_role('button', name='Fit', exact=True).wait_for()
        for effect in ('viscous_friction', 'coulomb_friction', 'rotor_inertia'):
            page.locator('label.choice', has_text=KNOWN[effect]).first.click()
        page.get_by_role('button', name='Fit', exact=True).click()
        page.get_by_role('button', name='Find what is missing').click()
        page.locator('#verdict').wait_for()
        told = page.locator('#verdict').inner_text()
        page.get_by_role('button', name='Discover what no catalogue has').click()
        page.locator('#discovered').wait_for()
        sentence = page.locator('#discovered').inner_text()
        page.locator('[data-shape] .main-svg').first.wait_for()
        buttons = [one.inner_text() for one in page.locator('.selection button').all()]
        (session,) = (folder / 'workbench').iterdir()
        kinds_before = [step.kind for step in SessionRecord.read(session).steps]
        page.get_by_role('button', name='Run this file').click()
        add = page.locator('.selection').get_by_role('button', name='Add position_')
        add.wait_for()
        add.click()
        stairs = page.locator('#stairs-words', has_text='From')
        stairs.wait_for()
        fallen = stairs.inner_text()
        page.context.close()
    return {
        'session': session,
        'verdict': told,
        'sentence': sentence,
        'buttons': buttons,
        'kinds_before': kinds_before,
        'stairs': fallen,
        'complaints': complaints,
    }


def test_the_page_describes_what_no_catalogue_has_in_a_formula(learned):
    assert 'position' in learned['sentence']
    assert 'W on LF_HFE, LF_KFE' in learned['sentence']
    assert learned['complaints'] == []


def test_the_file_of_the_effect_is_run_by_a_click_that_says_so_and_not_before(learned):
    assert learned['buttons'] == ['Run this file']
    assert learned['kinds_before'] == ['open', 'fit']


def test_the_error_falls_when_the_learned_effect_is_added(learned):
    steps = SessionRecord.read(learned['session']).steps
    assert [step.kind for step in steps] == ['open', 'fit', 'effects', 'add']
    before, after = (sum(steps[index].rmse_w.values()) for index in (1, 3))
    assert after < 0.6 * before
    assert 'step' in learned['stairs']
    catalogue = load_catalogue(list(learned['session'].glob('effects_*.py')))
    model = read_model(learned['session'] / steps[3].model, catalogue)
    assert any(name.startswith('position_') for name in model.effects)


def test_the_session_replays_to_the_same_numbers_where_its_effects_may_run(
    learned, tmp_path, capsys
):
    arguments = [str(learned['session']), '-o', str(tmp_path / 'again')]
    assert replay_command(arguments) == 2
    assert 'read them, then give --run-effects' in capsys.readouterr().err
    assert replay_command([*arguments, '--run-effects']) == 0
    assert 'the same numbers as in the session' in capsys.readouterr().out
