"""The pages in a real browser, without a network."""

import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from power_lab.commands import arguments
from power_lab.report import figures
from wattwalk_core.pages.page import Page

BROWSER = next(
    filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), None
)
needs_browser = pytest.mark.skipif(BROWSER is None, reason='no Chromium on this machine')


def page(tmp_path):
    made = Page('Named: base')
    made.add('<p class="kind named">Named</p><h1 id="verdict">Spring is missing.</h1>')
    time = np.arange(3000) / 50.0
    measured = 30 + 20 * np.sin(time)
    residual = {'base': np.cos(time), 'with spring': 0.2 * np.cos(time)}
    made.tabs(
        {
            name: made.figure(figures.traces(time, measured, residual, 0.1), name, size='tall')
            for name in ('LF_HFE', 'LF_KFE')
        }
    )
    stairs = figures.Stairs(('base', '+ spring'), (1.2, 0.4), noise=0.2).figure()
    made.add(made.figure(stairs, 'staircase'))
    bars = figures.candidates(['spring', 'idle <b>'], [0.8, 0.1], [True, False])
    made.add(made.figure(bars, 'candidates'))
    grid = np.random.default_rng(0).normal(size=(3, 3000))
    made.add(made.figure(figures.torque_speed_map(*grid, 1.0), 'map'))
    made.text('5 < 6 & so on')
    made.table(['a', 'b'], [['x', 1.0]], numbers=(1,), bold=(0,))
    path = tmp_path / 'page.html'
    made.write(path)
    return path


def browse(path, tmp_path, *extra):
    command = [
        *(BROWSER, '--headless', '--no-sandbox', '--disable-gpu', '--disable-quic'),
        *('--no-first-run', '--disable-background-networking', '--disable-component-update'),
        *('--disable-sync', '--enable-logging=stderr', '--virtual-time-budget=15000'),
        *(f'--user-data-dir={tmp_path / "profile"}', *extra, path.as_uri()),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)


def test_the_page_asks_for_nothing_from_outside(tmp_path):
    text = page(tmp_path).read_text()
    own = text[: text.index('<script type="application/json"')]
    assert not re.search(r'(?:src|href)\s*=', own)
    assert "default-src 'none'" in own


def test_what_is_shown_is_escaped_and_the_figures_are_sound_json(tmp_path):
    text = page(tmp_path).read_text()
    assert '5 &lt; 6 &amp; so on' in text
    data = re.search(r'id="figures">(.*?)</script>', text, re.DOTALL).group(1)
    content = json.loads(data.replace('<\\/', '</'))
    assert len(content['figures']) == 5
    assert set(content['colors'].values()) >= {'measured', 'base', 'better'}


def test_a_stretch_is_chosen_where_the_error_is_largest():
    residual = np.zeros(5000)
    residual[3000:3100] = 5.0
    part = figures.worst_stretch(residual)
    assert part.start <= 3000
    assert part.stop >= 3100


def test_a_stretch_spans_no_gap():
    residual = np.zeros(1000)
    residual[450:550] = 5.0
    part = figures.worst_stretch(residual, [slice(0, 500), slice(500, 1000)])
    assert (part.start, part.stop) in {(0, 500), (500, 1000)}
    assert figures.worst_stretch(residual, [slice(0, 540), slice(540, 1000)]) == slice(0, 540)


def test_an_error_without_variation_is_not_drawn():
    assert figures.error_over('position', np.zeros(500), {'base': np.ones(500)}) is None


def test_a_staircase_outside_a_page_has_the_colours_of_a_light_one():
    bars = figures.Stairs(('base', '+ spring'), (1.2, 0.4), noise=0.2).figure()['data'][0]
    assert list(bars['marker']['color']) == ['#d55e00', '#0072b2']


def test_the_level_of_noise_is_named_beside_the_bars_and_not_on_them():
    layout = figures.Stairs(('base',), (1.2,), noise=1.1).figure()['layout']
    (label,) = layout['annotations']
    assert (label['x'], label['xanchor']) == (1, 'left')
    assert layout['margin']['r'] > 6 * len(label['text'])


@needs_browser
def test_a_browser_draws_every_visible_figure_without_a_complaint(tmp_path):
    found = browse(page(tmp_path), tmp_path, '--dump-dom')
    said = [line for line in found.stderr.splitlines() if 'CONSOLE' in line]
    assert [line for line in said if 'chrome://' not in line] == [], 'of the page, not the browser'
    assert 'data-ready="yes"' in found.stdout
    assert found.stdout.count('class="main-svg"') >= 8
    assert 'Spring is missing.' in found.stdout
    assert '1.20 W' in found.stdout
    assert 'sensor noise 0.20 W' in found.stdout


@needs_browser
def test_a_table_with_many_long_headings_wraps_these_before_it_scrolls(tmp_path):
    made = Page('Gait')
    columns = [*['stride s', 'swing s', 'impact N'] * 2, *['KFE torque above 20 Hz'] * 4]
    made.table(columns, [[1.25] * 10], numbers=range(10))
    path = tmp_path / 'gait.html'
    made.write(path)
    told = 'document.title = (one => one.scrollWidth - one.clientWidth)'
    script = f"<script>{told}(document.querySelector('.scroll'))</script>"
    path.write_text(path.read_text() + script)
    shown = browse(path, tmp_path, '--window-size=1100,600', '--dump-dom').stdout
    assert '<title>0</title>' in shown


@needs_browser
def test_light_and_dark_are_drawn_in_their_own_colours(tmp_path):
    path = page(tmp_path)
    light = browse(path, tmp_path, '--dump-dom').stdout
    dark = browse(path, tmp_path, '--dump-dom', '--blink-settings=preferredColorScheme=0').stdout
    assert 'rgb(27, 31, 36)' in light
    assert light.count('rgb(27, 31, 36)') > dark.count('rgb(27, 31, 36)')


@pytest.mark.parametrize('command', ['compare --models', 'diagnose --model'])
def test_a_reader_of_the_table_that_leaves_early_leaves_the_page(
    bag, tmp_path, monkeypatch, command
):
    name, option = command.split()
    read, write = os.pipe()
    os.close(read)
    monkeypatch.setattr(sys, 'stdout', os.fdopen(write, 'w'))
    outputs = ['--json', str(tmp_path / 'a.json'), '--report', str(tmp_path / 'a.html')]
    with pytest.raises(SystemExit, match='1'):  # of rich, which leaves stdout to the null device
        getattr(arguments, name)([str(bag), option, 'mechanical_power', *outputs])
    assert {path.name for path in tmp_path.iterdir()} == {'a.json', 'a.html'}
