"""Commands and modules that the documentation, help and messages name are there."""

import re
from pathlib import Path

from commands_start import entry_points

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {path.parent.name for path in ROOT.glob('src/*/setup.py')}
PAGES = [*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md'), *ROOT.glob('bags/*.md')]
SOURCES = [ROOT / 'demo.py', *ROOT.glob('src/*/[a-z]*/**/*.py'), *ROOT.glob('bench/*.py')]


def module_file(name: str) -> Path | None:
    """The file of a module, or of the one that a name in it belongs to; None without one."""
    package, *parts = name.split('.')
    place = ROOT / 'src' / package / package
    for part in parts:
        if (place / f'{part}.py').is_file():
            return place / f'{part}.py'
        place /= part
    return place / '__init__.py' if place.is_dir() else None


def test_every_command_that_is_named_exists():
    known, named = entry_points(), 0
    for path in (*PAGES, *SOURCES):
        for package, name in re.findall(
            r'ros2\s+run\s+([a-z_]+)\s+([a-z_]+)', path.read_text(encoding='utf-8')
        ):
            assert (package, name) in known, f'{path}: ros2 run {package} {name}'
            named += 1
    assert named > 150


def test_every_benchmark_that_a_page_has_run_is_a_program():
    named = {
        name
        for path in PAGES
        for name in re.findall(r'python (bench/\w+\.py)', path.read_text(encoding='utf-8'))
    }
    assert len(named) > 5
    no_program = {name for name in named if '__main__' not in (ROOT / name).read_text('utf-8')}
    assert no_program == set()


def test_every_module_that_a_page_names_exists():
    pattern = re.compile(rf'\b({"|".join(PACKAGES)})((?:\.[a-z_]\w*)+)')
    for path in PAGES:
        if path.name == 'migration.md':  # tells of former ones, too
            continue
        for package, rest in pattern.findall(path.read_text(encoding='utf-8')):
            if not rest.endswith('.md'):
                assert module_file(package + rest), f'{path}: {package}{rest}'


def test_the_list_of_former_modules_names_present_ones():
    text = (ROOT / 'docs' / 'reference' / 'former_modules.csv').read_text(encoding='utf-8')
    head, *rows = (row.split(',') for row in text.splitlines())
    assert head == ['former', 'now']
    assert len(rows) > 300
    assert len({former for former, _ in rows}) == len(rows)
    for _, name in rows:
        found = module_file(name)
        assert found is not None, name
        assert found.stem == name.split('.')[-1]
