"""`ros2 run power_workbench open`: the workbench, a page on this machine."""

from collections.abc import Sequence
from pathlib import Path

from power_lab.commands import options as common
from wattwalk_core.command import command
from wattwalk_core.errors import InputError

PORT = 8421


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'open',
        'Open the workbench: compare a model with recordings, see where it fails, find out what '
        'it misses, add it and watch the error fall, on one page in the browser.',
        'example: ros2 run power_workbench open bags/walk_small --model base.yaml',
        package='power_workbench',
    )
    add = parser.add_argument
    add('bags', nargs='*', type=Path, metavar='BAG', help='recordings, or folders with some')
    add('--model', metavar='MODEL', help='model.yaml, ppn:RUN or a proxy to begin with')
    add('--drives', nargs='+', default=[], metavar='NAME', help='only these drives')
    common.add_doubts(parser)
    add(
        '--folder',
        type=Path,
        default=Path('workbench'),
        help='of sessions and what they keep (default: workbench)',
    )
    add('--port', type=int, default=PORT, help=f'default {PORT}; 0 takes any that is free')
    add('--host', help='address to listen on beside this machine alone; needs --token')
    add('--token', help='of 16 characters or more, in place of a random one')
    add('--no-browser', action='store_true', help='print the address only')
    options = parser.parse_args(args)
    if not 0 <= options.port <= 65535:
        raise InputError(f'--port {options.port}: it must lie in 0..65535')
    if options.host and not options.token:
        raise InputError(
            f'--host {options.host}: others could reach the page; give a --token of your own '
            'with it, or leave --host out'
        )
    if options.token is not None and (
        len(options.token) < 16 or not options.token.replace('-', '').replace('_', '').isalnum()
    ):
        raise InputError('--token: 16 or more letters, digits, - and _')
    for path in options.bags:
        if not path.exists():
            raise InputError(f'{path} does not exist; name recordings, or folders with some')
    catalogue = common.catalogue_of(options)
    if options.model:
        common.check_models([options.model], catalogue)

    from power_workbench.server.serving import Opening, serve

    return serve(
        Opening(
            bags=tuple(options.bags),
            model=options.model or '',
            drives=tuple(options.drives),
            slow=options.slow,
            anyway=options.anyway,
            effect_files=tuple(map(str, options.effects_path)),
            folder=options.folder,
            host=options.host or '',
            port=options.port,
            token=options.token or '',
            browser=not options.no_browser,
        )
    )
