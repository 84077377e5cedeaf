"""A session's steps taken again, with the errors of then beside those of now."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

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
    found: list[Replayed] = []

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
            source = Source.of(after)
            if step.kind == 'load' and step.model:
                # The model as the session kept it; its file may have changed since.
                step = replace(step, file=str(folder / step.model))
            name = step.model or 'model_0.yaml'
            result = worker.shape(tell, source, taken.spec(output), step, output / name)
            label = f'{step.kind} {", ".join(step.effects)}'
            found.append(Replayed(label, step.rmse_w, result['view'].errors))
        taken = after
    return found
