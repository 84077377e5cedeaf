"""The command that does what a step or a button of the page does."""

import os
import shlex
from collections.abc import Sequence
from pathlib import Path

from power_workbench.sessions.steps import SessionRecord, SessionStep


def shown_path(path: str | Path) -> str:
    """A path as one would type it: relative where it lies below the present folder."""
    text = os.path.relpath(path)
    return str(path) if text.startswith('..') else text


class Commands:
    """Commands of a session in its folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def of(self, record: SessionRecord, index: int) -> str:
        """The command of a step of the history."""
        before, step = record.go(index), record.steps[index]
        opened, spec = before.opened, before.spec(self._folder)
        output = self._folder / step.model
        if step.without:
            after = record.go(index + 1)
            return self.compare(after) if after.spec(self._folder) else self.budget(after)
        if step.kind == 'open':
            return _joined('power_recordings info', [*map(shown_path, step.recordings)])
        if step.kind == 'effects':
            return _joined('power_lab fit BAG', ['--effects-path', shown_path(step.file)])
        if opened is None:
            return ''
        bags = [*map(shown_path, opened.recordings)]
        if step.kind == 'load':
            return self.compare(before, self._spec(step.file))
        if step.kind == 'add':
            words = ['add', *step.effects, '--to', self._spec(spec), '--bag', *bags]
            return self._power_lab(before, [*words, '-o', shown_path(output), *_options(step)])
        effects: Sequence[str] = step.effects
        if step.kind == 'remove':
            effects = [name for name in effects_before(before) if name not in step.effects]
        words = ['fit', *bags, '--effects', ','.join(effects)]
        words += ['--base', step.base] if step.base else []
        return self._power_lab(before, [*words, '-o', shown_path(output), *_options(step)])

    def compare(self, record: SessionRecord, spec: str = '') -> str:
        """The command that judges the present model."""
        model = spec or self._spec(record.spec(self._folder))
        return self._power_lab(record, ['compare', *self._bags(record), '--models', model])

    def budget(self, record: SessionRecord) -> str:
        """The command that accounts for the power."""
        spec = record.spec(self._folder)
        model = ['--model', self._spec(spec)] if spec.endswith(('.yaml', '.yml')) else []
        return self._power_lab(record, ['budget', *self._bags(record), *model])

    def diagnose(self, record: SessionRecord, *more: str) -> str:
        """The command that finds out which effect the present model misses."""
        model = self._spec(record.spec(self._folder))
        words = ['diagnose', *self._bags(record), '--model', model, *more]
        return self._power_lab(record, words)

    def discover(self, record: SessionRecord, output: str) -> str:
        """The command that learns what no catalogue has."""
        model = self._spec(record.spec(self._folder))
        words = ['discover', *self._bags(record), '--model', model, '-o', shown_path(output)]
        return self._power_lab(record, words)

    def imported(
        self, file: str, content: object, map_file: Path = Path(), output: Path = Path()
    ) -> str:
        """The command that imports a log; without files, the one that shows its columns."""
        words = [shown_path(file)]
        if output == Path():
            return _joined('power_recordings import', [*words, '--list'])
        words += ['--map', shown_path(map_file), '-o', shown_path(output)]
        return _joined('power_recordings import', words)

    def _bags(self, record: SessionRecord) -> list[str]:
        return [] if record.opened is None else [*map(shown_path, record.opened.recordings)]

    def _spec(self, spec: str) -> str:
        return shown_path(spec) if spec.endswith(('.yaml', '.yml')) else spec

    def _power_lab(self, record: SessionRecord, words: Sequence[str]) -> str:
        opened, more = record.opened, []
        if opened is not None:
            more += ['--drives', *opened.drives] if opened.drives else []
            more += ['--without', ','.join(opened.without)] if opened.without else []
            more += ['--slow-meter'] if opened.slow else []
            more += ['--ignore-unit-conflicts'] if opened.anyway else []
        if record.effect_files:
            more += ['--effects-path', *map(shown_path, record.effect_files)]
        return _joined('power_lab', [*words, *more])


def effects_before(record: SessionRecord) -> list[str]:
    """Effects that the steps of a session have put into the present model, where these tell."""
    names: list[str] = []
    for step in record.done:
        if step.kind == 'fit':
            names = list(step.effects)
        elif step.kind == 'add':
            names += step.effects
        elif step.kind == 'remove':
            names = [name for name in names if name not in step.effects]
    return names


def _options(step: SessionStep) -> list[str]:
    per = ['--per', step.per] if step.per else []
    return [*per, '--seed', str(step.seed)] if step.seed else per


def _joined(command: str, words: Sequence[str]) -> str:
    return f'ros2 run {command} {shlex.join(words)}'
