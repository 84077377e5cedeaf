"""Steps of a session, with undo and redo, as a file that is always whole."""

from collections.abc import Mapping
from dataclasses import field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Length, Name, Printable, Quantity, parse, schema
from wattwalk_core.yaml_file import dump_yaml, read_yaml

FORMAT: Final = 'workbench_session/1'
FILE: Final = 'session.yaml'
_Text = Annotated[str, Printable(0, 4000)]
_Names = tuple[Name, ...]


@schema
class SessionStep:
    """One action of the user.

    open: recordings are read, less the seconds `without` as commands take them; load: a model
    file; fit: a model of effects from nothing, or on a base; add, remove: effects of the model;
    effects: a file of the user's own effects, which is run. `model` is the file in the session's
    folder that the step wrote, `rmse_w` the held-out error by meter that the model had after it.
    """

    kind: Literal['open', 'load', 'fit', 'add', 'remove', 'effects']
    recordings: tuple[_Text, ...] = ()
    sha256: _Names = ()
    drives: _Names = ()
    slow: bool = False
    anyway: bool = False
    without: tuple[_Text, ...] = ()
    file: _Text = ''
    effects: _Names = ()
    per: Literal['', 'type', 'drive'] = ''  # '': by type of a fit, else as in the model
    base: _Text = ''
    seed: int = 0
    model: Annotated[str, Printable(0)] = ''
    rmse_w: dict[str, Annotated[float, Quantity(0.0, 1e12, 'W')]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        needed = {
            'open': 'recordings',
            'load': 'file',
            'fit': 'effects',
            'add': 'effects',
            'remove': 'effects',
            'effects': 'file',
        }[self.kind]
        if not getattr(self, needed):
            raise InputError(f'a step {self.kind} needs {needed}')
        if self.model and Path(self.model).name != self.model:
            raise InputError(f'model {self.model!r}: give the name of a file beside the session')

    def content(self) -> dict[str, Any]:
        """As the session's file holds it: what differs from the defaults."""
        out: dict[str, Any] = {}
        for own in fields(self):  # type: ignore[arg-type]
            value = getattr(self, own.name)
            if own.name == 'kind' or value not in ((), '', {}, 0, False, 'type'):
                out[own.name] = list(value) if isinstance(value, tuple) else value
        return out


@schema
class SessionRecord:
    """Steps in their order; those from `at` on were undone and can be done again."""

    format: Literal['workbench_session/1'] = FORMAT
    steps: Annotated[tuple[SessionStep, ...], Length(0)] = ()
    at: Annotated[int, Quantity(0, 100_000)] = 0

    def __post_init__(self) -> None:
        if self.at > len(self.steps):
            raise InputError(f'at: {self.at} of {len(self.steps)} steps')

    @property
    def done(self) -> tuple[SessionStep, ...]:
        """Steps that are in force."""
        return self.steps[: self.at]

    @property
    def opened(self) -> SessionStep | None:
        """The step that named the recordings."""
        return next((step for step in reversed(self.done) if step.kind == 'open'), None)

    @property
    def shaped(self) -> SessionStep | None:
        """The step that the present model is from."""
        kinds = ('load', 'fit', 'add', 'remove')
        return next((step for step in reversed(self.done) if step.kind in kinds), None)

    def spec(self, folder: Path) -> str:
        """The present model as commands take it: a file, ppn:RUN, a proxy; '' without one."""
        step = self.shaped
        if step is None:
            return ''
        return str(folder / step.model) if step.model else step.file

    @property
    def effect_files(self) -> tuple[str, ...]:
        """Files of the user's own effects."""
        return tuple(dict.fromkeys(step.file for step in self.done if step.kind == 'effects'))

    def do(self, step: SessionStep) -> 'SessionRecord':
        """Take a step; what was undone is forgotten."""
        return replace(self, steps=(*self.done, step), at=self.at + 1)

    def go(self, at: int) -> 'SessionRecord':
        """Go to just after a step of the history; InputError for a step that is not there."""
        if not 0 <= at <= len(self.steps):
            raise InputError(f'the history has {len(self.steps)} steps, not {at}')
        return replace(self, at=at)

    def judged(self, errors: Mapping[str, float]) -> 'SessionRecord':
        """Keep the held-out errors in W with the last step."""
        if not self.at:
            return self
        steps = list(self.steps)
        steps[self.at - 1] = replace(steps[self.at - 1], rmse_w=dict(errors))
        return replace(self, steps=tuple(steps))

    def next_model(self) -> str:
        """Name of a model file that no step has written."""
        used = {step.model for step in self.steps}
        number = len(self.steps)
        while f'model_{number}.yaml' in used or not number:
            number += 1
        return f'model_{number}.yaml'

    def save(self, folder: Path) -> None:
        """Write the session's file, whole or not at all."""
        content = {
            'format': self.format,
            'at': self.at,
            'steps': [step.content() for step in self.steps],
        }
        write_whole(folder / FILE, dump_yaml(content))

    @classmethod
    def read(cls, path: Path) -> 'SessionRecord':
        """Read a session from its file or folder; InputError names the entry that is wrong."""
        file = path / FILE if path.is_dir() else path
        return parse(cls, read_yaml(file, 'session'), f'session {file}')
