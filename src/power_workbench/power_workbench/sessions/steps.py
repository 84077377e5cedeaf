"""Steps of a session, with undo and redo, as a file that is always whole."""

import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Name, Printable, Quantity, parse, schema
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
        others = {'open': 'recordings', 'load': 'file', 'effects': 'file'}
        needed = others.get(self.kind, 'effects')
        if not getattr(self, needed):
            raise InputError(f'a step {self.kind} needs {needed}')
        if self.model and Path(self.model).name != self.model:
            raise InputError(f'model {self.model!r}: give the name of a file beside the session')

    def content(self) -> dict[str, Any]:
        """Return the step as the session's file holds it: what differs from the defaults."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in vars(self).items()
            if name == 'kind' or value not in ((), '', {}, 0, False, 'type')
        }


@schema
class SessionRecord:
    """Steps in their order, of which the first `at` are in force; the others were undone."""

    format: Literal['workbench_session/1'] = FORMAT
    steps: tuple[SessionStep, ...] = ()
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
        """Last step in force that named recordings, None without one."""
        return next((step for step in reversed(self.done) if step.kind == 'open'), None)

    @property
    def shaped(self) -> SessionStep | None:
        """Last step in force that made or loaded a model, None without one."""
        kinds = ('load', 'fit', 'add', 'remove')
        return next((step for step in reversed(self.done) if step.kind in kinds), None)

    def spec(self, folder: Path) -> str:
        """Return the present model as commands take it: file, ppn:RUN, proxy; '' without one."""
        step = self.shaped
        if step is None:
            return ''
        return str(folder / step.model) if step.model else step.file

    @property
    def effect_files(self) -> tuple[str, ...]:
        """Files of the user's own effects, of the steps in force."""
        return tuple(dict.fromkeys(step.file for step in self.done if step.kind == 'effects'))

    def do(self, step: SessionStep) -> 'SessionRecord':
        """Return the record with one more step in force; undone steps are dropped."""
        return replace(self, steps=(*self.done, step), at=self.at + 1)

    def go(self, at: int) -> 'SessionRecord':
        """Return the record with the first `at` steps in force; InputError if there are fewer."""
        if not 0 <= at <= len(self.steps):
            raise InputError(f'the history has {len(self.steps)} steps, not {at}')
        return replace(self, at=at)

    def judged(self, errors: Mapping[str, float]) -> 'SessionRecord':
        """Return the record with held-out errors, W by meter, at the last step in force."""
        if not self.at:
            return self
        steps = list(self.steps)
        steps[self.at - 1] = replace(steps[self.at - 1], rmse_w=dict(errors))
        return replace(self, steps=tuple(steps))

    def next_model(self) -> str:
        """Return a name for a model file that no step has written."""
        used = {step.model for step in self.steps}
        names = (f'model_{number}.yaml' for number in count(max(len(self.steps), 1)))
        return next(name for name in names if name not in used)

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


def shown_path(path: str | Path) -> str:
    """Return a path as one would type it: relative where it lies below the present folder."""
    text = os.path.relpath(path)
    return str(path) if text.startswith('..') else text


@dataclass(frozen=True)
class Commands:
    """Shell commands that do what the steps of a session in a folder did."""

    folder: Path
    record: SessionRecord

    def of(self, index: int) -> str:
        """Return the command of step `index` of the history; '' for none."""
        step = self.record.steps[index]
        before, after = (replace(self, record=self.record.go(at)) for at in (index, index + 1))
        if step.without:
            return after.compare() if after.record.spec(self.folder) else after.budget()
        if step.kind == 'open':
            return _joined('power_recordings info', [*map(shown_path, step.recordings)])
        if step.kind == 'effects':
            return _joined('power_lab fit BAG', ['--effects-path', shown_path(step.file)])
        if before.record.opened is None:
            return ''
        if step.kind == 'load':
            return before.compare(step.file)
        if step.kind == 'add':
            words = ['add', *step.effects, '--to', before._spec(), '--bag', *before._bags()]
        else:
            # A model whose effects are removed is fitted anew with those that are left.
            words = ['fit', *before._bags(), '--effects', ','.join(effects_of(after.record))]
            words += ['--base', step.base] if step.base else []
        words += ['-o', shown_path(self.folder / step.model)]
        words += ['--per', step.per] if step.per else []
        words += ['--seed', str(step.seed)] if step.seed else []
        return before._power_lab(words)

    def compare(self, spec: str = '') -> str:
        """Return the command that judges a model, the present one by default."""
        return self._power_lab(['compare', *self._bags(), '--models', self._spec(spec)])

    def budget(self) -> str:
        """Return the command that accounts for the power."""
        is_file = self.record.spec(self.folder).endswith(('.yaml', '.yml'))
        model = ['--model', self._spec()] if is_file else []
        return self._power_lab(['budget', *self._bags(), *model])

    def on_model(self, verb: str, *more: str) -> str:
        """Return the command `verb` on the present model; more: its last words."""
        return self._power_lab([verb, *self._bags(), '--model', self._spec(), *more])

    def _bags(self) -> list[str]:
        opened = self.record.opened
        return [] if opened is None else [*map(shown_path, opened.recordings)]

    def _spec(self, spec: str = '') -> str:
        """A model, the present one by default, as one would type it."""
        spec = spec or self.record.spec(self.folder)
        return shown_path(spec) if spec.endswith(('.yaml', '.yml')) else spec

    def _power_lab(self, words: Sequence[str]) -> str:
        opened, more = self.record.opened, []
        if opened is not None:
            more += ['--drives', *opened.drives] if opened.drives else []
            more += ['--without', ','.join(opened.without)] if opened.without else []
            more += ['--slow-meter'] if opened.slow else []
            more += ['--ignore-unit-conflicts'] if opened.anyway else []
        if self.record.effect_files:
            more += ['--effects-path', *map(shown_path, self.record.effect_files)]
        return _joined('power_lab', [*words, *more])


def import_command(
    file: str, content: object, map_file: Path = Path(), output: Path = Path()
) -> str:
    """Return the command that imports a log; without output, that which lists its columns."""
    how = ['--map', shown_path(map_file), '-o', shown_path(output)]
    words = [shown_path(file), *(['--list'] if output == Path() else how)]
    return _joined('power_recordings import', words)


def effects_of(record: SessionRecord) -> list[str]:
    """Return the effects that the steps in force have put into the model, if these tell."""
    names: list[str] = []
    for step in record.done:
        if step.kind == 'fit':
            names = list(step.effects)
        elif step.kind == 'add':
            names += step.effects
        elif step.kind == 'remove':
            names = [name for name in names if name not in step.effects]
    return names


def _joined(command: str, words: Sequence[str]) -> str:
    return f'ros2 run {command} {shlex.join(words)}'
