"""Packages and modules use each other as docs/explanation/architecture.md has it."""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / 'src'
PACKAGES = sorted(file.parent.name for file in SOURCES.glob('*/setup.py'))
LONGEST = 400
"""Lines of a file."""
DRIVERS = ('can', 'cantools', 'pyvisa', 'pysoem', 'rclpy')
ANALYSES = (
    'power_estimator',
    'power_lab',
    'power_workbench',
    'power_fleet',
    'power_recordings',
    'sound_levels',
    'power_calibration.analyser',
    'power_calibration.timing',
)
LIVE = ('power_estimator.live.node', 'power_workbench.live.node')
"""Modules of analysing packages that are nodes."""


@cache
def tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding='utf-8'))


def modules(package: str) -> dict[str, Path]:
    """Modules of a package by dotted name; a package by its __init__."""
    folder = SOURCES / package
    return {
        '.'.join(file.relative_to(folder).with_suffix('').parts).removesuffix('.__init__'): file
        for file in (folder / package).rglob('*.py')
    }


def imported(file: Path) -> set[str]:
    """All that a file imports, wherever in it: modules, and names in them as if they were."""
    found = set()
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.Import):
            found |= {item.name for item in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{file}: relative import'
            found |= {node.module, *(f'{node.module}.{item.name}' for item in node.names)}
    return found


def is_below(name: str, above: str) -> bool:
    return f'{name}.'.startswith(f'{above}.')


def rooms() -> dict[str, list[str]]:
    """The table "Rooms": packages, and the packages or sub-packages that each uses."""
    text = (ROOT / 'docs' / 'explanation' / 'architecture.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| `src/(\w+)/` \|.*\| (.*) \|$', text, re.MULTILINE)
    return {package: re.findall(r'`([\w.]+)`', uses) for package, uses in rows}


def foreign(package: str) -> dict[str, str]:
    """Imports of other packages, by module, with a file that has them."""
    found = {}
    for name, file in modules(package).items():
        for used in imported(file):
            if used.partition('.')[0] in {*PACKAGES} - {package}:
                found[used] = name
    return found


def test_the_table_of_rooms_names_every_package():
    assert {*rooms()} == {path.parent.name for path in SOURCES.glob('*/package.xml')}


@pytest.mark.parametrize('package', PACKAGES)
def test_a_package_imports_what_its_row_allows(package):
    allowed = rooms()[package]
    for used, module in foreign(package).items():
        if '.' in used:
            assert any(is_below(used, name) for name in allowed), f'{module} imports {used}'


@pytest.mark.parametrize('package', PACKAGES)
def test_a_row_allows_no_more_than_is_imported(package):
    used = foreign(package)
    for name in rooms()[package]:
        if name.partition('.')[0] in PACKAGES:
            assert any(is_below(module, name) for module in used), f'{package}: {name}'


def test_packages_use_each_other_one_way():
    graph = {
        package: {name.partition('.')[0] for name in uses} for package, uses in rooms().items()
    }
    TopologicalSorter(graph).prepare()


def check_acyclic(graph: dict[str, set[str]]) -> None:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(' → '.join(error.args[1]))


@pytest.mark.parametrize('package', PACKAGES)
def test_no_module_imports_itself_through_others(package):
    files = modules(package)
    # A module's own package is imported before it, whatever it imports.
    graph = {
        name: {used for used in imported(file) & {*files} if not is_below(name, used)}
        for name, file in files.items()
    }
    assert graph
    check_acyclic(graph)


@pytest.mark.parametrize('package', PACKAGES)
def test_no_folder_imports_itself_through_those_beside_it(package):
    """Folders and single modules of a folder are its rooms, at every depth."""
    files, graph = modules(package), defaultdict(set)
    for name, file in files.items():
        for used in imported(file) & {*files}:
            ours, theirs = name.split('.'), used.split('.')
            pairs = enumerate(zip(ours, theirs, strict=False), 1)
            depth = next((depth for depth, (one, other) in pairs if one != other), None)
            if depth is not None:
                graph['.'.join(ours[:depth])].add('.'.join(theirs[:depth]))
    check_acyclic(graph)


def inner_imports(file: Path) -> Iterator[ast.stmt]:
    """Imports inside functions; of adjoining ones the first."""
    for function in ast.walk(tree(file)):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            found = [n for n in ast.walk(function) if isinstance(n, ast.Import | ast.ImportFrom)]
            ends = {node.end_lineno + gap for node in found for gap in (1, 2)}
            yield from (node for node in found if node.lineno not in ends)


def test_what_a_function_imports_has_its_reason_on_the_line():
    found = [
        f'{file.relative_to(ROOT)}:{node.lineno}'
        for folder in (SOURCES, ROOT / 'embedded', ROOT / 'bench')
        for file in folder.rglob('*.py')
        if 'test' not in file.parts
        for node in inner_imports(file)
        if '#' not in file.read_text(encoding='utf-8').splitlines()[node.lineno - 1]
    ]
    assert found == []


def class_names(folders: list[Path]) -> dict[str, list[Path]]:
    found = defaultdict(list)
    for folder in folders:
        for file in sorted(folder.rglob('*.py')):
            for node in tree(file).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                    found[node.name].append(file.relative_to(ROOT))
    return found


@pytest.mark.parametrize(
    'folders',
    [[SOURCES / package / package for package in PACKAGES], [ROOT / 'embedded'], [ROOT / 'bench']],
    ids=['packages', 'embedded', 'bench'],
)
def test_a_public_class_name_exists_once(folders):
    """embedded/ repeats names of rclpy, so it is looked at by itself."""
    names = class_names(folders)
    assert names
    assert {name: files for name, files in names.items() if len(files) > 1} == {}


def docstrings(file: Path) -> Iterator[tuple[str, str]]:
    """Names and docstrings of a file's module and of all public classes and functions in it."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(tree(file)):
        if isinstance(node, kinds):
            name = getattr(node, 'name', 'module')
            if not name.startswith('_'):
                yield name, ast.get_docstring(node) or ''


def test_docstrings_open_with_a_noun_or_a_verb():
    question = re.compile(r'(What|How|Whether|Where|When|Why)\b')
    found = [
        f'{file.relative_to(ROOT)}: {name}'
        for file in own_files()
        for name, text in docstrings(file)
        if question.match(text)
    ]
    assert found == []


def own_files() -> Iterator[Path]:
    listed = ['git', 'ls-files', '--cached', '--others', '--exclude-standard', '*.py']
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return (ROOT / name for name in names.splitlines() if (ROOT / name).is_file())


def test_no_file_is_longer_than_can_be_kept_in_mind():
    lengths = {file: len(file.read_text(encoding='utf-8').splitlines()) for file in own_files()}
    assert [file.name for file, length in lengths.items() if length > LONGEST] == []


def test_what_only_analyses_needs_no_driver_and_no_ros():
    names = [
        name
        for part in ANALYSES
        for name in modules(part.partition('.')[0])
        if is_below(name, part) and name not in LIVE
    ]
    names += [name for name in modules('power_calibration') if '.commands' in name]
    program = (
        'import sys, importlib\n'
        f'sys.modules.update(dict.fromkeys({DRIVERS!r}))\n'
        f'for name in {names!r}: importlib.import_module(name)\n'
    )
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
