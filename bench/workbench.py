"""Speed of the workbench in a real browser: first picture, brush, zoom, preview; memory.

    python bench/workbench.py [--bag BAG] [--count 30] [--no-preview]

Without --bag it simulates ten minutes of a walk of 12 drives. Times are from the click to the
frame after the page has drawn. The recording is opened once with an empty cache and five times
in new sessions with what was kept; the preview needs a diagnosis, which takes minutes.
"""

import argparse
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from sim_bridge.offline.run import run_offline
from wattwalk_core.console import output, print_table
from wattwalk_core.processes import ChildProcess

OPENINGS = 5
_OPEN = 'from power_workbench.commands.arguments import open; raise SystemExit(open())'
_FRAME = 'await new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)));'
_OPENED = """async (until) => {
  const { bench } = await import('/page/dom.js');
  const plot = () => document.querySelector('#plot-traces .main-svg');
  const reached = {
    'a first look': () => plot(),
    'the whole': () => plot() && bench.state.view.share === 1,
    ready: () => bench.state.opened.length > 0 && !bench.state.job,
    'the budget': () => document.querySelector('#plot-flow .main-svg'),
    'its intervals': () => document.querySelector('#plot-efficiency .main-svg'),
  };
  const start = performance.now();
  document.querySelector('#recordings-body form button').click();
  const out = {};
  for (const name of until) {
    while (!reached[name]()) await new Promise(requestAnimationFrame);
    FRAME
    out[name] = performance.now() - start;
  }
  return out;
}""".replace('FRAME', _FRAME)
_DONE = """async (act) => {
  const where = await import('/page/where.js');
  const traces = await import('/page/traces.js');
  const { bench } = await import('/page/dom.js');
  const plot = document.getElementById('plot-traces');
  const start = performance.now();
  const drawn = new Promise((done) => plot.once('plotly_afterplot', () => done()));
  %s
  await drawn;
  FRAME
  return performance.now() - start;
}""".replace('FRAME', _FRAME)
_BOX = """
  const box = { velocity: act.slice(0, 2), torque: act.slice(2) };
  await where.mark({ drive: bench.drive, box });
"""
_SPAN = 'await where.markSpan(act);'
_ZOOM = 'traces.setWindow(act);'
_PREVIEW = """
  const rows = document.querySelectorAll('.candidate[data-preview]');
  rows[act % rows.length].dispatchEvent(new MouseEvent('mouseenter'));
"""


def main() -> int:
    """Measure the workbench and print a table of its speed and memory."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--bag', type=Path)
    parser.add_argument('--count', type=int, default=30)
    parser.add_argument('--no-preview', action='store_true', help='no diagnosis, so no preview')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        os.environ['WATTWALK_INDEX'] = str(Path(place) / 'cache' / 'recordings.sqlite3')
        walk = Path(place) / 'walk'
        bag = options.bag or run_offline(walk, duration=600.0, seed=5, progress=True)
        size = sum(file.stat().st_size for file in bag.iterdir())
        rows: list[Cells] = []
        with _bench(Path(place), bag) as (browser, address, process):
            _first(browser, address, bag, rows)
            page = _again(browser, address, bag, rows)
            _use(page, options.count, rows, preview=not options.no_preview)
            _memory(browser, page, process, rows)
    columns = ('what', 'median', 'p99', 'goal', 'of')
    print_table(output(110), columns, rows, f'{bag.name}: {size / 1e6:.0f} MB')
    return 0


Cells = tuple[str, str, str, str, str]


def times(
    rows: list[Cells], name: str, values: Sequence[float], goal: float | None = None
) -> None:
    """Add a row of median and 99th percentile of times in ms, and print it."""
    middle, worst = np.quantile(values, [0.5, 0.99])
    shown = '' if goal is None else f'{goal:.0f} ms'
    rows.append((name, f'{middle:.0f} ms', f'{worst:.0f} ms', shown, str(len(values))))
    print(f'{name}: {middle:.0f} ms', file=sys.stderr, flush=True)


def memory(rows: list[Cells], name: str, megabytes: float, most: float | None = None) -> None:
    """Add a row of memory in MB, with its peak `most`."""
    peak = '' if most is None else f'peak {most:.0f} MB'
    rows.append((name, f'{megabytes:.0f} MB', peak, '', ''))


@contextmanager
def _bench(folder: Path, bag: Path) -> Iterator[tuple[Any, str, ChildProcess]]:
    from playwright.sync_api import sync_playwright  # only this row needs a browser

    program = next(filter(None, map(shutil.which, ('chromium', 'google-chrome'))))
    command = [sys.executable, '-c', _OPEN, str(bag.parent), '--no-browser', '--port', '0']
    command += ['--folder', str(folder / 'sessions')]
    with ChildProcess(command, folder / 'open.log') as process, sync_playwright() as running:
        address = process.wait_for_line(r'(http://\S+)', 120)[1]
        browser = running.chromium.launch(
            executable_path=program, args=['--no-sandbox', '--enable-precise-memory-info']
        )
        yield browser, re.sub(r'\x1b\[[0-9;]*m', '', address), process
        browser.close()


def _page(browser: Any, address: str, bag: Path) -> Any:
    """A new session with the recording ticked, and its worker there."""
    page = browser.new_context(viewport={'width': 1280, 'height': 900}).new_page()
    page.set_default_timeout(600_000)
    page.goto(address)
    page.locator('input[name="bag"]').first.wait_for()
    page.wait_for_timeout(4000)
    for box in page.locator('input[name="bag"]').all():
        box.set_checked(box.get_attribute('value') == str(bag.resolve()))
    return page


def _first(browser: Any, address: str, bag: Path, rows: list[Cells]) -> None:
    page = _page(browser, address, bag)
    seen = ['a first look', 'the whole', 'ready', 'the budget', 'its intervals']
    found = page.evaluate(_OPENED, seen)
    times(rows, 'never read: a first picture, of a part', [found['a first look']], 2000)
    times(rows, 'never read: the whole', [found['the whole']])
    times(rows, 'never read: quality checked, ready to fit', [found['ready']])
    times(rows, 'never read: budget by a model that is chosen', [found['the budget']])
    times(rows, 'never read: its intervals and levers', [found['its intervals']])
    page.context.close()


def _again(browser: Any, address: str, bag: Path, rows: list[Cells]) -> Any:
    """Return the last of the pages."""
    taken = []
    for number in range(OPENINGS):
        page = _page(browser, address, bag)
        taken.append(page.evaluate(_OPENED, ['the whole'])['the whole'])
        if number < OPENINGS - 1:
            page.context.close()
    times(rows, 'read before: first picture, of the whole', taken, 2000)
    return page


def _use(page: Any, count: int, rows: list[Cells], *, preview: bool) -> None:
    start = time.perf_counter()
    page.get_by_role('button', name='Fit', exact=True).click()
    page.locator('#plot-map .main-svg').first.wait_for()
    times(rows, 'fit three effects and compare', [1e3 * (time.perf_counter() - start)])
    page.wait_for_timeout(3000)
    rng = np.random.default_rng(0)
    shares = rng.uniform(0.1, 1, (count, 4)).tolist()
    seconds = page.evaluate('async () => (await import("/page/dom.js")).bench.state.view.seconds')
    boxes = [[-6 * a, 6 * b, -40 * c, 40 * d] for a, b, c, d in shares]
    spans = [[0.5 * a * seconds, (0.5 + 0.5 * b) * seconds] for a, b, *_ in shares]

    def timed(script: str, places: Sequence[Any]) -> list[float]:
        out = []
        for index in range(count):
            out.append(page.evaluate(_DONE % script, places[index]))
            page.wait_for_timeout(150)
        return out

    times(rows, 'brush: a box on the map lights the traces', timed(_BOX, boxes), 100)
    times(rows, 'brush: a span lights the map', timed(_SPAN, spans), 100)
    times(rows, 'zoom to a span', timed(_ZOOM, spans))
    timed(_ZOOM, [[0, seconds]] * count)
    times(rows, 'brush: a box, the whole in the traces', timed(_BOX, boxes), 100)
    if not preview:
        return
    start = time.perf_counter()
    page.get_by_role('button', name='Find what is missing').click()
    page.locator('#verdict').wait_for()
    times(rows, 'diagnose', [1e3 * (time.perf_counter() - start)])
    page.wait_for_timeout(3000)
    times(rows, "a candidate's preview", timed(_PREVIEW, range(count)), 300)


def _memory(browser: Any, page: Any, process: ChildProcess, rows: list[Cells]) -> None:
    memory(rows, 'memory of the server', *_resident(process.pid))
    workers = [_resident(child.pid) for child in psutil.Process(process.pid).children()]
    for own in sorted(workers, reverse=True)[:1]:
        memory(rows, 'memory of the worker', *own)
    told = browser.new_browser_cdp_session().send('SystemInfo.getProcessInfo')['processInfo']
    tabs = [_resident(one['id']) for one in told if one['type'] == 'renderer']
    memory(rows, 'memory of the tab', *max(tabs))
    heap = page.evaluate('() => performance.memory.usedJSHeapSize / 1e6')
    memory(rows, 'of these, heap of its scripts', heap)


def _resident(pid: int) -> tuple[float, float]:
    """Memory of a process now and at most, MB."""
    text = Path(f'/proc/{pid}/status').read_text()
    found = dict(re.findall(r'(VmRSS|VmHWM):\s+(\d+)', text))
    return float(found.get('VmRSS', 0)) / 1e3, float(found.get('VmHWM', 0)) / 1e3


if __name__ == '__main__':
    sys.exit(main())
