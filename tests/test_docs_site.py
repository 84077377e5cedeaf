"""The documentation site builds, loads nothing from a network and agrees with the code."""

import html
import json
import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from urllib.parse import urlsplit

import pytest
from commands_start import entry_points

ROOT = Path(__file__).resolve().parents[1]
COMMANDS = ROOT / 'docs' / 'reference' / 'commands'
COLUMNS = '88'
BROWSER = next(
    filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), None
)
LOADED = re.compile(
    r'<(?:script|img|iframe|source|video|audio|embed)\b[^>]*\bsrc="([^"]+)"'
    r'|<link\b(?=[^>]*\brel="(?:stylesheet|icon|preload|modulepreload|preconnect)")'
    r'[^>]*\bhref="([^"]+)"|url\(([^)]+)\)'
)


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    if any(find_spec(name) is None for name in ('mkdocs', 'material', 'mkdocstrings')):
        pytest.skip('needs requirements-docs.txt')
    folder = tmp_path_factory.mktemp('site')
    done = subprocess.run(
        [sys.executable, '-m', 'mkdocs', 'build', '--strict', '--site-dir', folder],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def page_text(page):
    """Text of a page without its marks, as a reader sees it."""
    body = page.read_text(encoding='utf-8')
    return html.unescape(re.sub(r'<[^>]+>', '', body))


def test_every_package_with_commands_has_a_page_of_them():
    packages = {package for package, _ in entry_points()}
    pages = {page.stem for page in COMMANDS.glob('*.md')} - {'index'}
    assert pages == packages
    navigation = (ROOT / 'mkdocs.yml').read_text(encoding='utf-8')
    assert {name for name in packages if f'commands/{name}.md' in navigation} == packages


def test_the_page_of_every_command_agrees_with_its_help(site):
    known = entry_points()
    starts = '; '.join(
        f'print({f"@@{package} {name}"!r}); run(__import__({module!r}, fromlist=["x"]).{function})'
        for (package, name), (module, function) in known.items()
    )
    script = (
        'from contextlib import suppress\n'
        'def run(main):\n    with suppress(SystemExit):\n        main(["--help"])\n' + starts
    )
    done = subprocess.run(
        [sys.executable, '-c', script],
        env=os.environ | {'COLUMNS': COLUMNS, 'NO_COLOR': '1'},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    _, *helps = done.stdout.split('@@')
    assert len(helps) == len(known)
    for printed in helps:
        title, _, text = printed.partition('\n')
        package, name = title.split()
        page = page_text(site / 'reference' / 'commands' / f'{package}.html')
        assert text.startswith(f'usage: ros2 run {package} {name}')
        assert text.strip() in page, f'{package} {name}'


def test_the_page_of_effects_has_every_effect_of_the_catalogue_with_its_formula(site):
    from power_estimator.effects import builtin_catalogue

    catalogue = builtin_catalogue()
    page = page_text(site / 'reference' / 'effects.html')
    shown = [name for name in catalogue if catalogue[name].kind != 'discrepancy']
    assert len(shown) > 20
    for name in shown:
        assert catalogue[name].formula in page, name
        assert catalogue[name].excitation.text in page, name
        assert all(f'{term.symbol} [{term.unit}]' in page for term in catalogue[name].terms)


def test_no_page_shows_the_marks_of_a_table_or_a_list_as_text(site):
    for page in site.rglob('*.html'):
        body = re.sub(r'(?s)<(pre|code|script)\b.*?</\1>', '', page.read_text(encoding='utf-8'))
        for paragraph in re.findall(r'(?s)<p>(.*?)</p>', body):
            assert '|--' not in paragraph, page
            assert not re.search(r'^- ', paragraph, re.MULTILINE), page


@pytest.mark.skipif(BROWSER is None, reason='no Chromium')
def test_the_search_finds_pages_where_the_site_is_opened_from_a_folder(site, tmp_path):
    done = subprocess.run(
        [BROWSER, '--headless=new', '--no-sandbox', '--disable-gpu', '--dump-dom',
         '--virtual-time-budget=15000', f'--user-data-dir={tmp_path}',
         f'{(site / "index.html").as_uri()}?q=coulomb_friction'],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert 'reference/effects.html' in done.stdout.split('md-search-result__list')[1]


def loaded_from_elsewhere(text):
    """Addresses that a browser would fetch from another machine."""
    found = (next(filter(None, groups)).strip('\'"') for groups in LOADED.findall(text))
    return [address for address in found if urlsplit(address).netloc]


def test_no_page_and_no_style_sheet_loads_anything_from_a_network(site):
    pages = [*site.rglob('*.html'), *site.rglob('*.css')]
    assert len(pages) > 30
    for page in pages:
        found = loaded_from_elsewhere(page.read_text(encoding='utf-8'))
        assert not found, f'{page.relative_to(site)}: {found}'


def test_addresses_that_a_browser_would_fetch_are_seen():
    text = (
        '<script src="https://a/x.js"></script><link rel="stylesheet" href="//b/y.css">'
        '<a href="https://c">c</a><img src="d.png"> @import url("https://e/z.css");'
    )
    assert loaded_from_elsewhere(text) == ['https://a/x.js', '//b/y.css', 'https://e/z.css']


def test_a_page_of_every_kind_is_in_the_navigation(site):
    for folder in ('tutorials', 'how-to', 'reference', 'explanation', 'results'):
        pages = [page.stem for page in (ROOT / 'docs' / folder).glob('*.md')]
        assert pages
        front = (site / 'index.html').read_text(encoding='utf-8')
        assert all(f'{folder}/{page}.html' in front for page in pages), folder


def words_of_page(title):
    """Keys that a section of the page of JSON keys names."""
    text = (ROOT / 'docs' / 'reference' / 'json.md').read_text(encoding='utf-8')
    section = text.split(f'<!-- keys: {title} -->')[1].split('\n## ')[0]
    return {word for code in re.findall(r'`([^`]+)`', section) for word in code.split('.')}


NAMED = {'topics', 'streams', 'shape', 'bounds', 'error_by_shift', 'gain'}
"""Keys whose entries go by names or values, not by keys."""


def keys_of(content):
    """All keys of a JSON value but names of drives, paths, topics and the like."""
    if isinstance(content, list):
        return set().union(*map(keys_of, content))
    if not isinstance(content, dict):
        return set()
    found = {key for key in content if re.fullmatch(r'[a-z][a-z0-9_]*', key)}
    for key, value in content.items():
        inner = value.values() if key in NAMED and isinstance(value, dict) else [value]
        found |= set().union(*map(keys_of, inner))
    return found


WALK = str(ROOT / 'bags' / 'walk_small')
KNEE = ('--drives', 'LF_KFE')


FIT = (WALK, *KNEE, '--effects', 'shaft,copper_loss,idle', '-o')


@pytest.fixture(scope='module')
def base(tmp_path_factory):
    """Model file of a knee."""
    from power_lab.commands.arguments import fit

    file = tmp_path_factory.mktemp('model') / 'base.yaml'
    assert fit([*FIT, str(file)]) == 0
    return str(file)


@pytest.mark.parametrize(
    ('title', 'command', 'arguments'),
    [
        ('info', 'power_recordings.commands.arguments:info', (WALK,)),
        ('sync', 'power_calibration.commands.arguments:sync', (WALK, *KNEE)),
        (
            'benchmark',
            'power_estimator.commands.arguments:benchmark',
            (WALK, '--models', f'ppn:{ROOT / "bags" / "ppn_small"}'),
        ),
        ('fit', 'power_lab.commands.arguments:fit', (*FIT, 'again.yaml')),
        (
            'compare',
            'power_lab.commands.arguments:compare',
            (WALK, *KNEE, '--models', 'base.yaml'),
        ),
        (
            'budget',
            'power_lab.commands.arguments:budget',
            (WALK, *KNEE, '--battery', '907Wh'),
        ),
        (
            'add',
            'power_lab.commands.arguments:add',
            ('viscous_friction', *KNEE, '--to', 'base.yaml', '--bag', WALK, '-o', 'better.yaml'),
        ),
    ],
)
def test_every_key_of_a_real_result_is_on_the_page(
    title, command, arguments, base, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    given = [base if word == 'base.yaml' else word for word in arguments]
    assert resolve_name(command)([*given, '--json', 'result.json']) == 0
    result = json.loads((tmp_path / 'result.json').read_text(encoding='utf-8'))
    keys = keys_of(result)
    assert len(keys) > 4
    assert keys <= words_of_page(title)
