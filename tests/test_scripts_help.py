"""Help of benchmarks and of the scripts that make pictures."""

import ast
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = [
    path
    for path in sorted([*ROOT.glob('bench/*.py'), *ROOT.glob('docs/pictures/*.py')])
    if 'ArgumentParser(' in path.read_text(encoding='utf-8')
]


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda path: path.name)
def test_help_of_a_script_says_what_it_is_for(script, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', [str(script), '--help'])
    monkeypatch.setenv('COLUMNS', '200')
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(script), run_name='__main__')
    assert ended.value.code == 0
    documented = ast.get_docstring(ast.parse(script.read_text(encoding='utf-8')))
    assert documented.splitlines()[0] in ' '.join(capsys.readouterr().out.split())
