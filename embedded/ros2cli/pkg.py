"""`ros2 pkg list | executables`."""

import argparse
from collections.abc import Sequence

from ros2cli.main import CommandError
from ros2cli.run import packages
from ros2cli.verbs import Verbs


def _list(_: argparse.Namespace) -> None:
    for package in sorted(packages()):
        print(package)


def _executables(options: argparse.Namespace) -> None:
    known = packages()
    if options.package is not None and options.package not in known:
        raise CommandError(f"Unknown package name '{options.package}'")
    for package in sorted(known) if options.package is None else [options.package]:
        for executable in sorted(known[package]):
            print(f'{package} {executable}')


def main(argv: Sequence[str]) -> int:
    """Run a verb of `ros2 pkg` and return its exit code."""
    verbs = Verbs('pkg', 'Packages that have executables.')
    verbs.add('list', _list, 'List packages.', 'ros2 pkg list')
    verb = verbs.add(
        'executables', _executables, 'List executables.', 'ros2 pkg executables power_daq'
    )
    verb.add_argument('package', nargs='?', help='package (default: all)')
    return verbs.run(argv)
