"""Pages of the repository lead where they say."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r'\[[^\]]*\]\(\s*<?([^)\s>]+)>?[^)]*\)|(?:src|href)="([^"]+)"')


def tracked(*patterns):
    listed = subprocess.run(
        ['git', 'ls-files', '-z', '--', *patterns], cwd=ROOT, capture_output=True, check=False
    )
    return [ROOT / name for name in listed.stdout.decode().split('\0') if name]


PAGES = tracked('*.md')


def links(text):
    """Targets of links and pictures within the repository; what is code is none."""
    text = re.sub(r'^```.*?^```', '', text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r'`[^`\n]*`', '', text)
    found = (first or second for first, second in LINK.findall(text))
    return [link for link in found if not re.match(r'[a-z][a-z0-9+.-]*:', link)]


def anchors(page):
    """Names of headings in links, as GitHub forms them."""
    heads = re.findall(r'^#+\s+(.*)$', page.read_text(), flags=re.MULTILINE)
    names = [re.sub(r'[^\w\- ]', '', head.strip().lower()) for head in heads]
    return {name.replace(' ', '-') for name in names}


@pytest.mark.skipif(not PAGES, reason='needs a checkout of git')
def test_relative_links_of_all_pages_lead_to_files_and_headings_in_the_repository():
    files = set(tracked())
    folders = {parent for file in files for parent in file.parents}
    broken = []
    for page in PAGES:
        for link in links(page.read_text()):
            name, _, anchor = link.partition('#')
            target = (page.parent / name).resolve() if name else page
            lost = target not in files | folders
            if lost or (anchor and target.suffix == '.md' and anchor not in anchors(target)):
                broken.append(f'{page.relative_to(ROOT)}: {link}')
    assert not broken


def test_a_link_in_code_is_none_and_a_picture_is_one():
    text = '![a](images/a.png) `[b](c)` [d](e.md#f "title") [g](https://h)\n```\n[i](j)\n```\n'
    assert links(text) == ['images/a.png', 'e.md#f']
