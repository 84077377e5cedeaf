"""Arguments of the commands."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from power_lab.commands import arguments as common
from power_recordings.commands.arguments import add_doubts
from wattwalk_core.command import Arguments, entry_point
from wattwalk_core.errors import InputError

PORT = 8421


@entry_point(
    'power_workbench.commands.open:run',
    'Open the workbench: compare a model with recordings, see where it fails, find out what '
    'it misses, add it and watch the error fall, on one page in the browser.',
    'example: ros2 run power_workbench open bags/walk_small --model base.yaml',
)
def open(parser: ArgumentParser, args: Arguments) -> Namespace:
    common.add_effects_path(parser)
    add = parser.add_argument
    add('bags', nargs='*', type=Path, metavar='BAG', help='recordings, or folders with some')
    add('--model', metavar='MODEL', help='model.yaml, ppn:RUN or a proxy to begin with')
    add('--drives', nargs='+', default=[], metavar='NAME', help='only these drives')
    add_doubts(parser)
    add(
        '--folder',
        type=Path,
        default=Path('workbench'),
        help='of sessions and what they keep (default: workbench)',
    )
    add('--port', type=int, default=PORT, help=f'default {PORT}; 0 takes any that is free')
    add('--host', help='address to listen on beside this machine alone; needs --token')
    add('--token', help='of 16 characters or more, in place of a random one')
    add('--no-browser', dest='browser', action='store_false', help='print the address only')
    options = parser.parse_args(args)
    if not 0 <= options.port <= 65535:
        raise InputError(f'--port {options.port}: it must lie in 0..65535')
    if options.host and not options.token:
        raise InputError(
            f'--host {options.host}: others could reach the page; give a --token '
            'with it, or leave --host out'
        )
    if options.token is not None and (
        len(options.token) < 16 or not options.token.replace('-', '').replace('_', '').isalnum()
    ):
        raise InputError('--token: 16 or more letters, digits, - and _')
    for path in options.bags:
        if not path.exists():
            raise InputError(f'{path} does not exist; name recordings, or folders with some')
    return options


@entry_point(
    'power_workbench.commands.replay_session:run',
    'Take the steps of a workbench session again and compare the held-out errors with those '
    'that the session kept. Ends with 0 if they are the same, with 1 if not.',
    'example: ros2 run power_workbench replay_session workbench/20261123-101500-1a2b -o again',
)
def replay_session(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('session', type=Path, metavar='SESSION', help='its folder, or its session.yaml')
    add('-o', '--output', type=Path, metavar='FOLDER', help='keep the models there')
    add(
        '--run-effects',
        action='store_true',
        help='run the files of effects that the session names; allow only what you trust',
    )
    add('--json', type=Path, metavar='FILE', help='write the errors as JSON')
    options = parser.parse_args(args)
    if not options.session.exists():
        raise InputError(f'{options.session} does not exist; name a session of the workbench')
    return options
