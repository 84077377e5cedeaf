"""Seconds that are left out of the judgement on the page, and by the command named beside it."""

import json
import shlex

import pytest
from power_lab.commands.arguments import compare as compare_command
from power_lab.commands.arguments import fit as fit_command
from workbench_page import BROWSER, page_of, served

playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
pytestmark = pytest.mark.skipif(BROWSER is None, reason='no Chromium on this machine')


def test_seconds_left_out_on_the_page_are_left_out_by_its_command_and_come_back(
    bag, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    model, complaints = tmp_path / 'base.yaml', []
    assert fit_command([str(bag), '--effects', 'shaft,copper_loss,idle', '-o', str(model)]) == 0
    with (
        playwright.sync_playwright() as running,
        served(tmp_path / 'page', bag, '--model', model) as bench,
    ):
        browser = running.chromium.launch(executable_path=BROWSER, args=['--no-sandbox'])
        page = page_of(browser, bench.address, complaints)
        out = page.get_by_role('button', name='Leave the framed seconds out')
        page.locator('#plot-map .main-svg').first.wait_for()
        page.locator('#traces-words', has_text='in which it is worst').wait_for()
        state = f'/api/sessions/{bench.ask("/api/sessions")[1]["sessions"][0]["name"]}/state'
        before = bench.ask(state)[1]
        out.click()
        page.locator('#left-out', has_text='Left out of all that is judged').wait_for()
        after = bench.ask(state)[1]
        (span,) = after['view']['hidden']
        assert span == pytest.approx(before['view']['worst'], abs=0.03)
        page.locator('#plot-strip text', has_text='left out').first.wait_for()

        def seconds(view):
            return max(one['samples'] for one in view['scores']['drives'].values()) / 50

        gone = seconds(before['view']) - seconds(after['view'])
        assert span[1] - span[0] - 0.1 <= gone <= span[1] - span[0] + 2.5, 'and whole seconds'
        words = shlex.split(page.locator('#left-out pre.command').inner_text())
        assert words[:4] == ['ros2', 'run', 'power_lab', 'compare']
        assert '--without' in words
        assert compare_command([*words[4:], '--json', 'out.json']) == 0
        (told,) = json.loads((tmp_path / 'out.json').read_text())['models']
        for meter, own in told['drives'].items():
            shown = after['view']['scores']['drives'][meter]['rmse_w']
            assert shown == pytest.approx(own['rmse_w'], rel=1e-6)
        page.get_by_role('button', name='Take them in again').click()
        page.locator('#left-out p').wait_for(state='detached')
        again = bench.ask(state)[1]
        assert again['view']['scores']['drives'] == before['view']['scores']['drives']
        page.locator('#undo').click()
        page.locator('#left-out p').wait_for()
        page.locator('#undo').click()
        page.locator('#left-out p').wait_for(state='detached')
        browser.close()
    assert complaints == []
