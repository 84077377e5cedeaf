"""`ros2 run wattwalk_bringup live`: all nodes of a measured robot in one terminal."""

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command, command_parser, own_arguments
from wattwalk_core.interruption import DeferredSignals
from wattwalk_core.quoting import printable

from wattwalk_bringup.settings import BringupSettings, arguments

_PERIOD = 0.25  # s
_EPILOG = """\
Each argument replaces an entry of the file. Ctrl-C ends all nodes, the policy runner first,
and so does the end of any of them. Exit code: 0, 1 if a node failed, 2 for bad input.

example, the simulated robot, a minute of it recorded:
  ros2 run wattwalk_bringup live --record bags/walk_1 --duration 60
example, a robot on can0, walking on command after `ros2 service call /start std_srvs/srv/Trigger`:
  ros2 run wattwalk_bringup live --config robot --dbc robot.dbc --mapping robot.yaml
example, settings of your own:
  ros2 run wattwalk_bringup live --config lab.yaml --velocity=0.4,0,0
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run all nodes until Ctrl-C, the end of the duration or of a node; 1 if one failed."""
    options = _parse(own_arguments(args))
    given = {name: text for name, text in vars(options).items() if text is not None}
    settings = BringupSettings.load(given.pop('config')).changed(given)
    return _run(settings)


def _run(settings: BringupSettings) -> int:
    from wattwalk_bringup.display import display
    from wattwalk_bringup.node_group import started
    from wattwalk_bringup.node_set import commands

    wanted = commands(settings)
    folder = Path(tempfile.mkdtemp(prefix='wattwalk_live_'))
    # The recorder counts its own duration.
    limit = settings.duration if settings.duration and not settings.record_counts else 0.0
    with DeferredSignals() as signals, started(wanted, folder) as group:
        begin = time.monotonic()
        with display() as shown:
            while signals.received is None and group.ended is None:
                shown.show(group.nodes)
                if limit and time.monotonic() - begin >= limit:
                    break
                time.sleep(_PERIOD)
            first = group.ended
            failures = group.failures()
            group.end(lambda: shown.show(group.nodes))
        failures += [text for text in group.failures() if text not in failures]
    if first is not None and not failures:
        print(f'{first.name} has ended')
    for text in failures:
        print(printable(f'live: {text}', 1000), file=sys.stderr)
    if failures:
        print(f'live: logs are in {folder}', file=sys.stderr)
        return 1
    if settings.record:
        print(f'next: ros2 run power_recordings info {settings.record}')
    shutil.rmtree(folder)
    return 0


def _parse(own: Sequence[str]) -> argparse.Namespace:
    parser = command_parser(
        'wattwalk_bringup live',
        'The simulated robot or the DAQ of a real one, policy runner, estimator and recorder: '
        'started together, shown in one terminal, ended as one.',
        _EPILOG,
    )
    parser.add_argument(
        '--config', default='sim', metavar='FILE', help='YAML file, or one of sim (default), robot'
    )
    for argument in arguments():
        option = f'--{argument.name.replace("_", "-")}'
        if argument.is_flag:
            actions = parser.add_mutually_exclusive_group()
            actions.add_argument(
                option,
                dest=argument.name,
                action='store_const',
                const='true',
                help=argument.description,
            )
            actions.add_argument(
                option.replace('--', '--no-', 1),
                dest=argument.name,
                action='store_const',
                const='false',
                help=f'not {argument.name}',
            )
        else:
            parser.add_argument(
                option,
                dest=argument.name,
                metavar='|'.join(argument.choices) or argument.name.upper(),
                help=argument.description,
            )
    return parser.parse_args(own)
