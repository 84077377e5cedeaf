"""The page beside running nodes: power, the model's estimate, notes, an end without orphans."""

import re
from pathlib import Path

import pytest
from power_recordings.card import Card
from wattwalk_core.processes import wait_until
from workbench_page import BROWSER, served

playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
pytestmark = pytest.mark.skipif(BROWSER is None, reason='no Chromium on this machine')

NETWORKS = Path(__file__).resolve().parents[3] / 'bags'
SLOW = 180.0
"""s that a step may take beside much other work."""


@pytest.fixture(scope='module')
def browser():
    with playwright.sync_playwright() as running:
        made = running.chromium.launch(executable_path=BROWSER, args=['--no-sandbox'])
        yield made
        made.close()


def page_of(browser, address):
    page = browser.new_context(viewport={'width': 1280, 'height': 900}).new_page()
    page.set_default_timeout(1000 * SLOW)
    page.goto(address)
    return page


def processes_of(server):
    """Command lines of the processes that a workbench has started, by id."""
    found = {}
    for folder in Path('/proc').iterdir():
        if folder.name.isdigit():
            try:
                words = (folder / 'cmdline').read_text().split('\0')
                parent = re.search(r'^PPid:\s*(\d+)', (folder / 'status').read_text(), re.M)
            except OSError:
                continue
            if parent is not None and int(parent[1]) == server.process.pid:
                found[int(folder.name)] = ' '.join(words)
    return found


def alive(pids):
    return [pid for pid in pids if Path(f'/proc/{pid}').exists()]


def watts(page, name):
    found = re.search(rf'{name} (-?[\d.]+) W', page.locator('#live-now').inner_text())
    return float(found[1]) if found else None


def test_the_page_follows_running_nodes_and_puts_a_note_into_the_card(
    browser, node_process, tmp_path
):
    bag = tmp_path / 'bag'
    live = node_process(
        *('wattwalk_bringup', 'live', '--channel', f'{tmp_path}/bus', '--model', ''),
        *('--record', str(bag)),
    )
    with served(tmp_path / 'page', NETWORKS) as bench:
        page = page_of(browser, bench.address)
        page.get_by_role('button', name='Live', exact=True).click()
        page.get_by_label('Model to compare with').select_option(label='bags/ppn_small')
        page.get_by_role('button', name='Follow the running robot').click()
        page.locator('#live-now', has_text='error').wait_for()
        live.wait_for_output('policy: trot: running', timeout=SLOW)
        seen = set()
        for name in ('measured', 'model'):
            first = watts(page, name)
            assert wait_until(lambda name=name, first=first: watts(page, name) != first, SLOW)
            seen.add(watts(page, name))
        assert all(value is not None for value in seen)
        bars = page.locator('#plot-live-bars .bars path')
        assert wait_until(lambda: bars.count() >= 24, SLOW), 'two bars for each of 12 drives'
        page.get_by_role('radio', name='LF_KFE').check()
        page.locator('#live-now', has_text='LF_KFE: measured').wait_for()
        assert page.locator('#plot-live .scatterlayer .trace').count() == 3

        page.locator('#live-heard', has_text=f'Recording to {bag}').wait_for()
        page.get_by_label('Note').fill('left foot slipped')
        page.get_by_role('button', name='Put a note with its time').click()
        page.locator('#live-kept', has_text=f'is in the card of {bag}').wait_for()
        assert wait_until(lambda: Card.load(bag).marks, SLOW)

        live.interrupt()
        assert live.wait(SLOW) == 0, live.output
        page.locator('#live-said', has_text='drive_supply stopped').wait_for()
        (mark,) = Card.load(bag).marks
        assert mark.text == 'left foot slipped'
        started = processes_of(bench)
        assert any('power_workbench.live.process' in line for line in started.values())
        bench.process.interrupt()
        bench.process.wait(SLOW)
        assert 'Traceback' not in bench.process.output
        assert wait_until(lambda: not alive(started), SLOW)


def test_the_page_says_that_nothing_is_published_and_what_to_start(browser, ros_domain, tmp_path):
    with served(tmp_path / 'page', NETWORKS) as bench:
        page = page_of(browser, bench.address)
        page.get_by_role('button', name='Live', exact=True).click()
        page.get_by_role('button', name='Follow the running robot').click()
        said = page.locator('#live-said', has_text='no drive_supply heard for')
        said.wait_for()
        assert 'ros2 run wattwalk_bringup live' in said.inner_text()
        page.get_by_label('Note').wait_for(state='visible')
        page.get_by_label('Note').fill('nobody records')
        page.get_by_role('button', name='Put a note with its time').click()
        page.locator('#live-kept', has_text='nothing is being recorded').wait_for()
        (session,) = (tmp_path / 'page' / 'workbench').iterdir()
        assert 'nobody records' in (session / 'notes.yaml').read_text()
        (child,) = (
            pid for pid, line in processes_of(bench).items() if 'workbench.live.process' in line
        )
        page.get_by_role('button', name='Follow no longer').click()
        assert wait_until(lambda: not alive([child]), SLOW), 'nobody follows'
        page.get_by_role('button', name='Follow the running robot').click()
        said.wait_for()
        (child,) = (
            pid for pid, line in processes_of(bench).items() if 'workbench.live.process' in line
        )
        bench.process.kill()
        assert wait_until(lambda: not alive([child]), SLOW), 'an orphan is left'
