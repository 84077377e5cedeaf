"""`ros2 run power_workbench replay_session`: the steps of a workbench session taken again."""

import argparse
import tempfile
from pathlib import Path

from wattwalk_core.console import progress, write_json
from wattwalk_core.errors import InputError

from power_workbench.sessions.replay import replay_steps
from power_workbench.sessions.steps import SessionRecord


def run(options: argparse.Namespace) -> int:
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
        steps = replay_steps(session, folder, options.output or Path(place), show)
    same = all(step.same for step in steps)
    content = [
        {'step': s.label, 'rmse_w': s.now, 'session_w': s.before, 'same': s.same} for s in steps
    ]
    write_json(options.json, {'same': same, 'steps': content})
    for step in steps:
        kept, now = (_errors(errors) for errors in (step.before, step.now))
        print(f'{step.label}: {now}' + ('' if step.same else f' — the session had {kept}'))
    print('the same numbers as in the session' if same else 'these are not the same numbers')
    return 0 if same else 1


def _errors(errors: dict[str, float]) -> str:
    return ', '.join(f'{meter} {value:.6g} W' for meter, value in errors.items())
