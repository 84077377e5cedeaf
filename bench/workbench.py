"""
Speed of the workbench in a real browser: first picture, a brush, a candidate's preview; memory.

    python bench/workbench.py [--bag BAG] [--count 20]

Without --bag it simulates ten minutes of a walk of 12 drives. Times are from the click to the
frame in which the page has drawn, in ms; the first picture counts from the request to open the
recording by a server whose worker is there.
"""

import argparse
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from wattwalk_core.processes import ChildProcess

GOALS = {'first picture': 2000.0, 'a brush': 100.0, "a candidate's preview": 300.0}
"""Ms."""
_OPEN = 'import sys; from power_lab.commands.open import main; sys.exit(main(sys.argv[1:]))'
_DRAWN = """async ([name, act]) => {
  const node = document.getElementById(name);
  const start = performance.now();
  const seen = new Promise((done) => node.once('plotly_afterplot', () => done()));
  %s
  await seen;
  await new Promise((done) => requestAnimationFrame(done));
  return performance.now() - start;
}"""
_BRUSH = (
    _DRAWN
    % """
  const where = await import('/page/where.js');
  const { bench } = await import('/page/dom.js');
  const box = { velocity: act.slice(0, 2), torque: act.slice(2) };
  await where.mark({ drive: bench.drive, box });
"""
)
_PREVIEW = (
    _DRAWN
    % """
  const rows = document.querySelectorAll('.candidate');
  rows[act].dispatchEvent(new MouseEvent('mouseenter'));
"""
)


def main() -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--bag', type=Path)
    parser.add_argument('--count', type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        bag = options.bag or _walk(Path(place))
        with _page(Path(place), bag) as (page, process):
            _measure(page, process, options.count)
    return 0


def _walk(folder: Path) -> Path:
    from sim_bridge.offline.run import run_offline

    return run_offline(folder / 'walk', duration=600.0, seed=5, progress=True)


@contextmanager
def _page(folder: Path, bag: Path) -> Iterator[tuple[Any, ChildProcess]]:
    from playwright.sync_api import sync_playwright

    browser = next(filter(None, map(shutil.which, ('chromium', 'google-chrome'))))
    command = [sys.executable, '-c', _OPEN, str(bag.parent), '--no-browser', '--port', '0']
    command += ['--folder', str(folder / 'sessions')]
    with ChildProcess(command, folder / 'open.log') as process, sync_playwright() as running:
        address = process.wait_for_line(r'(http://\S+)', 120)[1]
        made = running.chromium.launch(executable_path=browser, args=['--no-sandbox'])
        page = made.new_page(viewport={'width': 1280, 'height': 900})
        page.set_default_timeout(600_000)
        page.goto(re.sub(r'\x1b\[[0-9;]*m', '', address))
        page.locator('input[name="bag"]').first.wait_for()
        page.wait_for_timeout(6000)
        for box in page.locator('input[name="bag"]').all():
            box.set_checked(box.get_attribute('value') == str(bag.resolve()))
        yield page, process
        made.close()


def _measure(page: Any, process: ChildProcess, count: int) -> None:
    start = time.perf_counter()
    page.get_by_role('button', name='Open', exact=True).click()
    page.locator('#plot-traces .main-svg').first.wait_for()
    print(f'{"":24} {"median":>9} {"p99":>9} {"goal":>9}')
    _print('first picture', [1e3 * (time.perf_counter() - start)])
    start = time.perf_counter()
    page.get_by_role('button', name='Fit', exact=True).click()
    page.locator('#plot-map .main-svg').first.wait_for()
    print(f'fit and compare: {time.perf_counter() - start:.1f} s')
    page.wait_for_timeout(2000)
    rng = np.random.default_rng(0)
    boxes = [[-6 * a, 6 * b, -40 * c, 40 * d] for a, b, c, d in rng.uniform(0.1, 1, (count, 4))]
    brushes = _times(page, lambda i: page.evaluate(_BRUSH, ['plot-traces', boxes[i]]), count)
    _print('a brush', brushes)
    start = time.perf_counter()
    page.get_by_role('button', name='Find what is missing').click()
    page.locator('#verdict').wait_for()
    print(f'diagnose: {time.perf_counter() - start:.1f} s')
    page.wait_for_timeout(1000)
    previews = _times(page, lambda i: page.evaluate(_PREVIEW, ['plot-traces', i % 6]), count)
    _print("a candidate's preview", previews)
    for pid, name in _processes(process.pid):
        print(f'memory of {name}: {_resident(pid):.0f} MB')
    heap = page.evaluate('() => performance.memory.usedJSHeapSize / 1e6')
    print(f'heap of the tab: {heap:.0f} MB')


def _print(name: str, values: list[float]) -> None:
    middle, worst = np.quantile(values, [0.5, 0.99])
    text = f'{name:24} {middle:6.0f} ms {worst:6.0f} ms {GOALS[name]:6.0f} ms'
    print(text, flush=True)


def _times(page: Any, work: Callable[[int], float], count: int) -> list[float]:
    out = []
    for index in range(count):
        out.append(work(index))
        page.wait_for_timeout(150)
    return out


def _processes(pid: int) -> list[tuple[int, str]]:
    children = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
    return [(pid, 'the server'), *((int(child), 'a worker') for child in children)]


def _resident(pid: int) -> float:
    text = Path(f'/proc/{pid}/status').read_text()
    return float(re.search(r'VmRSS:\s+(\d+)', text)[1]) / 1e3  # type: ignore[index]


if __name__ == '__main__':
    sys.exit(main())
