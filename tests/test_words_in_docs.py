"""Pages and help use the field's words, in sentences of at most 30 words."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PATTERNS = ('*.md', 'docs/**/*.md', 'bags/*.md', 'src/*/*/commands/*.py')
FILES = [file for pattern in PATTERNS for file in ROOT.glob(pattern)]
LONGEST = 30
PRIVATE = re.compile(
    r'\b(told|leftovers?|strangers?|idlers?|underlay|likeness|hurry|hurried|haste|pacing|slew'
    r'|first gait|keep_books|asks? for|of (?:its|their|your|one.s) own)\b',
    re.IGNORECASE,
)  # for which the field says reported, residual, unmodelled effect, urgency, requires …


def prose(page: str) -> str:
    """Return a page without code, tables, headings and the targets of links."""
    page = re.sub(r'(?ms)^ *```.*?^ *```', '\n\n', page)
    page = re.sub(r'(?m)^(\||#|<!--|:::).*$', '\n', page)
    return re.sub(r'`[^`]*`', 'code', re.sub(r'\]\([^)]*\)', ']', page))


def help_texts(module: str) -> str:
    """Return the strings of a module of arguments, without their examples."""
    values = (getattr(node, 'value', None) for node in ast.walk(ast.parse(module)))
    return '\n\n'.join(text.split('example')[0] for text in values if isinstance(text, str))


@pytest.mark.parametrize('file', FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_a_page_or_help_has_no_private_word_and_no_long_sentence(file):
    text = (prose if file.suffix == '.md' else help_texts)(file.read_text(encoding='utf-8'))
    sentences = re.split(r'(?<=[.!?])["*)]*\s+|\n\s*\n|\n\s*(?:[-*]|\d+\.) ', text)
    assert PRIVATE.findall(text) == []
    assert [one for one in sentences if len(one.split()) > LONGEST] == []
