"""`ros2 run power_workbench replay_session`: the steps of a workbench session taken again."""

from collections.abc import Sequence
from pathlib import Path

from power_lab.commands import options as common
from wattwalk_core.command import command
from wattwalk_core.console import progress, write_json
from wattwalk_core.errors import InputError


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = common.parser(
        'replay_session',
        'Take the steps of a workbench session again and compare the held-out errors with those '
        'that the session kept. Ends with 0 if they are the same, with 1 if not.',
        'example: ros2 run power_workbench replay_session workbench/20261123-101500-1a2b -o again',
        effects=False,
        package='power_workbench',
    )
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

    import tempfile

    from power_workbench.sessions.replay import replay
    from power_workbench.sessions.steps import SessionRecord

    session = SessionRecord.read(options.session)
    folder = options.session if options.session.is_dir() else options.session.parent
    if session.effect_files and not options.run_effects:
        raise InputError(
            f'the session uses effects of {", ".join(session.effect_files)}: these are programs; '
            'read them, then give --run-effects'
        )
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place, progress('reading') as show:
        steps = replay(session, folder, options.output or Path(place), show)
    for step in steps:
        kept, now = (_errors(errors) for errors in (step.before, step.now))
        print(f'{step.label}: {now}' + ('' if step.same else f' — the session had {kept}'))
    same = all(step.same for step in steps)
    print('the same numbers as in the session' if same else 'these are not the same numbers')
    if options.json is not None:
        content = [
            {'step': s.label, 'rmse_w': s.now, 'session_w': s.before, 'same': s.same}
            for s in steps
        ]
        write_json(options.json, {'same': same, 'steps': content})
    return 0 if same else 1


def _errors(errors: dict[str, float]) -> str:
    return ', '.join(f'{meter} {value:.6g} W' for meter, value in errors.items())
