"""`ros2 run PACKAGE EXECUTABLE [ARGUMENTS]`."""

import ast
import os
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

from ros2cli.main import CommandError

_OF_WHEELS = 'wattwalk.commands'
USAGE = """usage: ros2 run PACKAGE EXECUTABLE [ARGUMENT ...]

Run an executable of a package; it takes the place of this process.

Example: ros2 run power_daq daq --ros-args -p samples_per_message:=10"""


def prefixes() -> list[Path]:
    """Return the folders below which packages are installed."""
    given = [
        Path(entry) for entry in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if entry
    ]
    return [*given, Path(sys.prefix)]


def packages() -> dict[str, dict[str, Path | EntryPoint]]:
    """Return the executables of each package, by name: files, or entry points of wheels."""
    found: dict[str, dict[str, Path | EntryPoint]] = {}
    for prefix in prefixes():
        for folder in sorted((prefix / 'lib').glob('*')):
            files: dict[str, Path | EntryPoint] = {
                path.name: path
                for path in sorted(folder.glob('*'))
                if path.is_file() and os.access(path, os.X_OK)
            }
            is_package = files or (prefix / 'share' / folder.name / 'package.xml').is_file()
            if is_package and folder.name not in found:
                found[folder.name] = files
    for entry in entry_points(group=_OF_WHEELS):
        found.setdefault(entry.module.partition('.')[0], {}).setdefault(entry.name, entry)
    return found


def summaries(package: str) -> dict[str, str]:
    """Return one-line descriptions of a package's executables, from module docstrings."""
    found = {}
    for script in (*entry_points(group='console_scripts'), *entry_points(group=_OF_WHEELS)):
        if script.dist is None or script.dist.name.replace('-', '_') != package:
            continue
        tree = source(script.module)
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and node.name == script.attr:
                tree = next(map(source, bodies(node)), tree)
        text = ast.get_docstring(tree) or ''
        found[script.name] = text.partition('\n')[0].rpartition('`: ')[2]
    return found


def source(module: str) -> ast.Module:
    """Return a module's syntax tree, an empty one where it has no file."""
    spec = find_spec(module)
    text = Path(spec.origin).read_text(encoding='utf-8') if spec and spec.origin else ''
    return ast.parse(text)


def bodies(command: ast.FunctionDef) -> Iterator[str]:
    """Yield the modules named in a command's decorator, as in `@entry_point('module:run')`."""
    for decorator in command.decorator_list:
        if isinstance(decorator, ast.Call):
            for given in decorator.args:
                if isinstance(given, ast.Constant) and isinstance(given.value, str):
                    yield given.value.partition(':')[0]


def main(argv: Sequence[str]) -> int | None:
    """Replace this process by the executable, or run a wheel's entry point; CommandError."""
    if not argv or argv[0] in ('-h', '--help'):
        print(USAGE)
        return None
    if len(argv) < 2:
        raise CommandError(
            f"which executable of '{argv[0]}'? See 'ros2 pkg executables {argv[0]}'"
        )
    package, executable = argv[:2]
    known = packages()
    if package not in known:
        raise CommandError(
            f"Package '{package}' not found: searching: {', '.join(map(str, prefixes()))}"
        )
    if executable in ('-h', '--help'):
        lines = summaries(package)
        print(f'usage: ros2 run {package} EXECUTABLE [ARGUMENT ...]\n')
        for name in known[package]:
            print(f'  {name:<18}{lines.get(name, "")}'.rstrip())
        return None
    if executable not in known[package]:
        names = ', '.join(known[package]) or 'none'
        raise CommandError(f"No executable '{executable}' in package '{package}', it has: {names}")
    path = known[package][executable]
    if isinstance(path, Path):
        sys.stdout.flush()
        os.execv(path, [str(path), *argv[2:]])
    sys.argv = [executable, *argv[2:]]
    code: int = path.load()()
    return code
