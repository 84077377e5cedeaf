"""The loop in a real browser on a robot's log that others recorded: a hopper of two motors."""

import json
import shutil

import pytest
from power_lab.commands.arguments import add as add_command
from power_lab.commands.arguments import compare as compare_command
from power_lab.commands.arguments import fit as fit_command
from power_workbench.sessions.steps import SessionRecord
from real_logs import REAL
from workbench_page import BROWSER, page_of, served

playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
LOG = REAL / 'hopper_500_hops.mat'
pytestmark = [
    pytest.mark.skipif(BROWSER is None, reason='no Chromium on this machine'),
    pytest.mark.skipif(not LOG.exists(), reason='shared/real_data is not here'),
]


@pytest.fixture(scope='module')
def hopped(tmp_path_factory):
    """The page from the hopper's log to a better model, and again after a reload."""
    folder, complaints = tmp_path_factory.mktemp('hopper'), []
    logs = folder / 'logs'
    logs.mkdir()
    shutil.copy(LOG, logs)
    with (
        playwright.sync_playwright() as running,
        running.chromium.launch(executable_path=BROWSER, args=['--no-sandbox']) as browser,
        served(folder / 'page', logs) as bench,
    ):
        page = page_of(browser, bench.address, complaints)
        page.get_by_text('Import CSV, MAT, HDF5 …').click()
        page.get_by_label('Log', exact=True).select_option(label=f'logs/{LOG.name}')
        page.get_by_role('button', name='Look into it').click()
        page.get_by_role('heading', name=f'Map of {LOG.name}').wait_for()
        page.get_by_role('button', name='Import', exact=True).click()
        page.get_by_text('Imported: ').wait_for()
        page.get_by_role('button', name='Open the recording').click()
        page.get_by_role('button', name='Fit', exact=True).click()
        page.locator('#plot-map .main-svg').first.wait_for()
        page.locator('#plot-map').scroll_into_view_if_needed()
        plot = page.locator('#plot-map .nsewdrag').bounding_box()
        page.mouse.move(plot['x'] + 0.2 * plot['width'], plot['y'] + 0.2 * plot['height'])
        page.mouse.down()
        page.mouse.move(plot['x'] + 0.9 * plot['width'], plot['y'] + 0.9 * plot['height'], steps=6)
        page.mouse.up()
        page.locator('#selection').wait_for()
        box = page.locator('#selection').inner_text()
        page.get_by_role('button', name='Find what is missing').click()
        page.locator('#verdict').wait_for()
        verdict = page.locator('#verdict').inner_text()
        page.get_by_role('button', name='Add inverter loss').first.click()
        stairs = page.locator('#stairs-words', has_text='From')
        stairs.wait_for()
        fallen = stairs.inner_text()
        page.reload()
        stairs.wait_for()
        again = stairs.inner_text()
        page.context.close()
    (session,) = (folder / 'page' / 'workbench').iterdir()
    return {
        'session': session,
        'box': box,
        'verdict': verdict,
        'stairs': (fallen, again),
        'complaints': complaints,
    }


def test_the_page_names_the_loss_of_the_hoppers_inverters_and_what_it_is_worth(hopped):
    assert 'inverter loss is missing' in hopped['verdict'].lower()
    assert 'falls from' in hopped['verdict']
    assert 'rms inside against' in hopped['box']
    assert hopped['complaints'] == []


def test_the_error_falls_a_little_and_is_the_same_after_a_reload(hopped):
    before, after = (
        sum(step.rmse_w.values())
        for step in SessionRecord.read(hopped['session']).steps
        if step.rmse_w
    )
    assert 0.8 * before < after < before
    assert hopped['stairs'][0] == hopped['stairs'][1]


def test_numbers_of_the_page_are_those_of_the_commands(hopped, tmp_path):
    session = SessionRecord.read(hopped['session'])
    opened, fit, add = session.steps
    bag = opened.recordings[0]
    base, better = tmp_path / fit.model, tmp_path / add.model
    effects = ','.join(('shaft', 'copper_loss', 'idle'))
    assert fit_command([bag, '--effects', effects, '-o', str(base)]) == 0
    arguments = ['inverter_loss', '--to', str(base), '--bag', bag, '-o', str(better)]
    assert add_command(arguments) == 0
    for model, step in ((base, fit), (better, add)):
        told = tmp_path / 'compared.json'
        assert compare_command([bag, '--models', str(model), '--json', str(told)]) == 0
        (own,) = json.loads(told.read_text())['models']
        errors = {meter: values['rmse_w'] for meter, values in own['drives'].items()}
        assert errors == pytest.approx(step.rmse_w, rel=1e-6)
