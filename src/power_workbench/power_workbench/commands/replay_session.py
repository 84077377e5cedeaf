"""`ros2 run power_workbench replay_session`: the steps of a workbench session taken again."""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from wattwalk_core.console import progress, write_json
from wattwalk_core.errors import InputError

from power_workbench.sessions.source import Source
from power_workbench.sessions.steps import SessionRecord
from power_workbench.sessions.worker import SessionWorker

TOLERANCE = 1e-6
"""Of the errors, relative, up to which two runs are the same."""


@dataclass(frozen=True)
class Replayed:
    """One step with the held-out errors of the session and of this run, W by meter."""

    label: str
    before: dict[str, float]
    now: dict[str, float]

    @property
    def same(self) -> bool:
        """True if meters and errors are the session's, to TOLERANCE (of 1 W below that)."""
        return self.before.keys() == self.now.keys() and all(
            abs(self.now[name] - value) <= TOLERANCE * max(abs(value), 1.0)
            for name, value in self.before.items()
        )


def replay_steps(
    session: SessionRecord, folder: Path, output: Path, show: Callable[[str], None]
) -> list[Replayed]:
    """Take the steps of a session that are in force again; models are written into output.

    folder: of the session; show: is called with progress in words. Returns the steps that make a
    model. InputError for recordings that are not those of the session, or are gone.
    """
    worker, taken = SessionWorker(), SessionRecord()
    found = []

    def tell(kind: str, content: object) -> None:
        if kind == 'progress':
            show(str(content))

    for step in session.done:
        after = taken.do(step)
        if step.kind not in ('open', 'effects'):
            if after.opened is None:
                raise InputError(
                    f'the session takes a step {step.kind} before it opens a recording'
                )
            if step.kind == 'load' and step.model:
                # The model as the session kept it; its file may have changed since.
                step = replace(step, file=str(folder / step.model))
            name = step.model or 'model_0.yaml'
            result = worker.shape(tell, Source.of(after), taken.spec(output), step, output / name)
            label = f'{step.kind} {", ".join(step.effects)}'
            found.append(Replayed(label, step.rmse_w, result['view'].errors))
        taken = after
    return found


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
