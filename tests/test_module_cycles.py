"""The modules of each package import each other one way."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / 'src'
PACKAGES = sorted(file.parent.name for file in SOURCES.glob('*/setup.py'))


def imports(package):
    """Modules by dotted name, each with those of its own package that it imports anywhere."""
    folder = SOURCES / package
    files = {
        '.'.join(file.relative_to(folder).with_suffix('').parts).removesuffix('.__init__'): file
        for file in (folder / package).rglob('*.py')
    }
    found = {}
    for name, file in files.items():
        used = set()
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                used |= {f'{node.module}.{item.name}' for item in node.names} | {node.module}
            elif isinstance(node, ast.Import):
                used |= {item.name for item in node.names}
        # A module's own package is imported before it, whatever it imports.
        found[name] = {u for u in used if u in files and not f'{name}.'.startswith(f'{u}.')}
    return found


@pytest.mark.parametrize('package', PACKAGES)
def test_no_module_imports_itself_through_others(package):
    graph = imports(package)
    assert graph
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(' → '.join(error.args[1]))
