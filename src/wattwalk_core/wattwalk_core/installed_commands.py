"""Commands of wheels, which have no `lib/PACKAGE` for `ros2 run` to look in.

    wattwalk PACKAGE COMMAND [ARGUMENT ...]

The same as `ros2 run PACKAGE COMMAND`, without ROS; `lab` stands for `power_lab`.
`pip install 'wattwalk[train]'` adds `training`.
Example: wattwalk lab fit walk_small --effects shaft,copper_loss,idle -o base.yaml
"""

import sys
from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points


def installed_commands() -> dict[str, dict[str, EntryPoint]]:
    """Return the commands that were installed from wheels: {package: {command: entry point}}."""
    found: dict[str, dict[str, EntryPoint]] = {}
    for entry in entry_points(group='wattwalk.commands'):
        found.setdefault(entry.module.partition('.')[0], {})[entry.name] = entry
    return found


def main(args: Sequence[str] | None = None) -> int:
    """Run `PACKAGE COMMAND [ARGUMENT …]` and return its exit code; without a command, list all."""
    package, name, *rest = [*(sys.argv[1:] if args is None else args), '', '']
    known = {key.removeprefix('power_'): value for key, value in installed_commands().items()}
    entry = known.get(package.removeprefix('power_'), {}).get(name)
    if entry is None:
        asked = package not in ('', '-h', '--help')
        lines = (f'  {key:<17}{", ".join(sorted(value))}' for key, value in sorted(known.items()))
        print(*((__doc__ or '').strip(), '', *lines), sep='\n', file=sys.stderr if asked else None)
        if asked:
            print(f'wattwalk: there is no command {package} {name}'.rstrip(), file=sys.stderr)
        return 2 if asked else 0
    sys.argv = [name, *rest[:-2]] if args is None else sys.argv
    code: int = entry.load()(None if args is None else rest[:-2])
    return code


if __name__ == '__main__':
    sys.exit(main())
