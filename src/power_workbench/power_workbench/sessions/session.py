"""A session at work: its steps, the views and findings that belong to them, its worker."""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from wattwalk_core.errors import InputError

from power_workbench.live.feed import LiveFeed
from power_workbench.sessions.jobs import JobRunner, SessionJob
from power_workbench.sessions.opened_cache import OpenedCache
from power_workbench.sessions.source import Findings, Key, SeenModels, Source
from power_workbench.sessions.steps import SessionRecord, SessionStep, import_command
from power_workbench.views.view import PowerView

_STAGES = {
    'load': 'Loading the model',
    'fit': 'Fitting',
    'add': 'Adding',
    'remove': 'Removing',
    'effects': 'Reading effects',
}

_WORK: Mapping[str, tuple[str, str, Mapping[str, tuple[str, str]]]] = {
    'diagnose': ('Looking for what is missing', 'found', {}),
    'discover': ('Discovering', 'learned', {'output': ('effects', '.py')}),
    'report': ('Writing the report', '', {'output': ('report', '.html')}),
    'bench': ('Simulated bench', '', {'motion': ('next', '.yaml'), 'output': ('recording', '')}),
}
"""Of the present model: words, where the result is kept, and files that it makes."""


class WorkbenchSession:
    """Session of one tab in its folder: its steps, and the worker that takes them.

    Methods may be called from any thread. `changed` is called after every change of `revision`,
    `streamed` at messages of the live view. Results of begun work are in the properties later.
    """

    def __init__(
        self,
        folder: Path,
        record: SessionRecord,
        changed: Callable[[], None],
        streamed: Callable[[], None] = lambda: None,
        cache: OpenedCache | None = None,
    ) -> None:
        self.folder, self.record = folder, record
        self.revision = 0
        self.error = ''
        self.recordings: list[dict[str, Any]] = []
        self.approved: set[str] = set()
        self.log: Mapping[str, Any] = {}
        self.runner = JobRunner(self._heard)
        self.live = LiveFeed(streamed)
        self._changed = changed
        self._lock = threading.RLock()
        self._waiting: deque[SessionStep] = deque()
        self._step: SessionStep | None = None
        self._task: Callable[[Any], None] | None = None
        self._seen = SeenModels()
        self._cache = OpenedCache(None) if cache is None else cache
        self._partial: PowerView | None = None
        self._accounting: tuple[Key, int | None] | None = None  # by which worker

    @property
    def source(self) -> Source:
        """Recordings and effects; InputError before they are open or for effects not allowed."""
        source = Source.of(self.record)
        for file in source.effect_files:
            if file not in self.approved:
                raise InputError(f'the session uses effects of {file}; allow this file to be run')
        return source

    @property
    def allowed_effects(self) -> tuple[str, ...]:
        """Files of effects of the session that may be run."""
        return tuple(file for file in self.record.effect_files if file in self.approved)

    @property
    def spec(self) -> str:
        """Present model as commands take it: a file, ppn:RUN or a proxy; '' without one."""
        return self.record.spec(self.folder)

    @property
    def view(self) -> PowerView | None:
        """View of the present model, or of what is read so far; None at first."""
        return self._seen.views.get(self._key(), self._partial)

    @property
    def findings(self) -> Findings | None:
        """Diagnosis of the present model, None until there is one."""
        return self._seen.found.get(self._key())

    @property
    def budget(self) -> Mapping[str, Any] | None:
        """Energy budget by the present model, None until it is known."""
        return self._seen.budgets.get(self._key())

    @property
    def learned(self) -> Mapping[str, Any] | None:
        """Result of `discover` on top of the present model, None until there is one."""
        return self._seen.learned.get(self._key())

    @property
    def lines(self) -> list[Mapping[str, Any]]:
        """Other models judged on the same recordings: {name, rmse_w} of each."""
        key = self._key()
        return self._seen.lines.get(key[0], []) if key else []

    @property
    def recordings_made(self) -> list[Path]:
        """Recordings that the simulated bench or an import has put into the session's folder."""
        found = self.folder.glob('recording_*/metadata.yaml')
        return sorted(file.parent for file in found)

    def fresh(self, kind: str, suffix: str) -> Path:
        """Return a path KIND_N + suffix in the session's folder that is not there yet."""
        paths = (self.folder / f'{kind}_{number}{suffix}' for number in count(1))
        return next(path for path in paths if not path.exists())

    def _key(self) -> Key | None:
        return None if self.record.opened is None else (Source.of(self.record), self.spec)

    def take(self, *steps: SessionStep) -> None:
        """Begin to take steps one after the other; InputError while other work runs."""
        with self._lock:
            self._require_idle()
            if steps[0].kind not in ('open', 'effects'):
                _ = self.source
            self._waiting.extend(steps)
            self._next()

    def go(self, at: int) -> None:
        """Go to just after step `at` of the history, 0 for before all; InputError at work."""
        with self._lock:
            self._require_idle()
            record = self.record.go(at)
            record.save(self.folder)
            self.record, self._partial = record, None
            self._refresh()
            self._bump()

    def resume(self) -> None:
        """Begin to judge the present model of the session's file."""
        with self._lock:
            self._refresh()
            self._bump()

    def approve(self, file: str) -> None:
        """Let a file of effects of this session be run from now on; InputError for others."""
        with self._lock:
            if file not in {step.file for step in self.record.steps if step.kind == 'effects'}:
                raise InputError(f'the session has no effects of {file!r}')
            self.approved.add(file)
            self._refresh()
            self._bump()

    def begin(self, request: str, **given: Any) -> None:
        """Begin `diagnose`, `discover`, `report` or `bench`; InputError without a model."""
        key, (name, kept, files) = self.judged, _WORK[request]
        made = {argument: self.fresh(*file) for argument, file in files.items()}

        def keep(found: Any) -> None:
            if kept:
                setattr(self._seen, kept, {key: found})

        self.start(name, request, {'source': key[0], 'spec': key[1], **made, **given}, keep)

    def look_at_log(self, file: str) -> None:
        """Begin to list the columns of a log of others; the result is in `log`."""

        def keep(found: Mapping[str, Any]) -> None:
            self.log = {**found, 'turn': self.revision}

        self.start('Reading the log', 'look_at_log', {'file': file}, keep)

    def import_log(self, file: str, content: Mapping[str, Any], *, only_look: bool) -> None:
        """Begin to import a log by the map `content`, or only preview it; result: `log`."""
        given: dict[str, Any] = {'file': file, 'content': content}
        if not only_look:
            number = self.fresh('recording', '').name.rpartition('_')[2]
            given |= {
                'map_file': self.folder / f'import_{number}.yaml',
                'output': self.folder / f'recording_{number}',
            }

        def keep(found: Mapping[str, Any]) -> None:
            command = '' if 'error' in found else import_command(**given)
            self.log = {**self.log, 'result': {**found, 'command': command}, 'turn': self.revision}

        name = 'Previewing' if only_look else 'Importing'
        self.start(name, 'preview_log' if only_look else 'import_log', given, keep)

    def line(self, spec: str) -> None:
        """Begin to judge another model on the recordings; its errors are in `lines`."""
        source = self.source
        keep = partial(self._seen.keep_line, source)
        self.start('Comparing', 'line', {'source': source, 'spec': spec}, keep)

    @property
    def judged(self) -> Key:
        """Recordings and the present model; InputError without one."""
        source, spec = self.source, self.spec
        if not spec:
            raise InputError('there is no model yet; fit or load one first')
        return source, spec

    def start(
        self, name: str, request: str, arguments: Mapping[str, Any], keep: Callable[[Any], None]
    ) -> None:
        """Begin a request that is no step; keep gets the result. InputError while work runs."""
        with self._lock:
            self._require_idle()
            self.error, self._task = '', keep
            self.runner.run(name, request, arguments)
            self._bump()

    def cancel(self) -> None:
        """Cancel the work that runs, and drop the steps that wait."""
        self._waiting.clear()
        self.runner.cancel()

    def close(self) -> None:
        """End the processes; the session stays on disk."""
        self.live.close()
        self.runner.close()

    def _require_idle(self) -> None:
        if self.runner.busy or self._step is not None:
            raise InputError('work is under way; wait for it or cancel it')

    def _next(self) -> None:
        """Begin the next step that waits."""
        if not self._waiting:
            return
        step = self._step = self._waiting.popleft()
        self.error = ''
        try:
            self._begin(step)
        except InputError as error:
            self._failed(str(error))
        self._bump()

    def _begin(self, step: SessionStep) -> None:
        if step.kind == 'effects':
            self.approved.add(step.file)
            files = (*self.record.effect_files, step.file)
            self.runner.run(_STAGES[step.kind], 'effects', {'files': files})
            return
        if step.kind == 'open':
            source = Source.of(self.record.do(step))
            if (kept := self._kept(source)) is not None:
                self._done(kept)
            else:
                self.runner.run('Opening', 'open', {'source': source, 'spec': self.spec})
            return
        output = self.folder / self.record.next_model()
        arguments = {'source': self.source, 'spec': self.spec, 'step': step, 'output': output}
        self.runner.run(f'{_STAGES[step.kind]} {", ".join(step.effects)}', 'shape', arguments)

    def _refresh(self) -> None:
        """Judge the present model again where its view is not kept."""
        key = self._key()
        if key is None:
            return
        if key in self._seen.views:
            self._account()
            return
        try:
            source = self.source
        except InputError as error:
            self.error = str(error)
            return
        kept = None if self.recordings else self._kept(source)
        if kept is not None:
            self._keep(kept)
            return
        request = 'judge' if self.recordings else 'open'
        self.start('Comparing', request, {'source': source, 'spec': self.spec}, self._keep)

    def _kept(self, source: Source) -> dict[str, Any] | None:
        """Show what is known of recordings that were read before, without reading them again.

        Returns the result of `open`; None where they are to be read, or a model to be judged.
        """
        self._partial = None
        kept = self._cache.opening(self._cache.key(source))
        if kept is None or source.sha256 not in ((), kept.sha256):
            return None
        self._partial, self.recordings = kept.view, list(kept.recordings)
        if self.spec:
            return None
        self.runner.warm()
        return kept.result

    def _keep(self, result: Mapping[str, Any]) -> None:
        self.recordings = result.get('recordings', self.recordings)
        key, view = self._key(), result['view']
        assert key is not None
        self._seen.keep(key, view)
        self._partial = None
        self._account()

    def _account(self) -> None:
        """Have the budget of the present model worked out while other work goes on."""
        key = self._key()
        known = self._seen.budgets.get(key)
        if key is None or (known is not None and not known.get('first')):
            return
        if (key, self.runner.pid) == self._accounting:
            return
        with suppress(InputError):
            self.runner.beside('budget', {'source': self.source, 'spec': key[1]})
            self._accounting = key, self.runner.pid

    def _heard(self, job: SessionJob | None, kind: str, content: Any) -> None:
        """Take a message of the worker, in the thread of the runner."""
        with self._lock:
            if job is None:
                self._seen.keep_budget((content['source'], content['spec']), content['content'])
            elif kind == 'view':
                self._partial = content
            elif kind == 'cancelled':
                self._step = self._task = None
                self.error = 'cancelled'
                self._account()
            elif kind in ('error', 'failed'):
                self._failed(job.error)
            elif kind == 'done':
                try:
                    self._done(content)
                except InputError as error:
                    self._failed(str(error))
            self._bump()

    def _done(self, result: Any) -> None:
        task, step = self._task, self._step
        self._task = self._step = None
        if task is not None:
            task(result)
        if step is None:
            return
        view = result.get('view')
        if step.kind == 'open' and not step.sha256:
            step = replace(step, sha256=tuple(result['sha256']))
        if 'model' in result:
            step = replace(step, model=result['model'])
        record = self.record.do(step)
        if view is not None and view.content:
            record = record.judged(view.errors)
        record.save(self.folder)
        before, self.record = self._key(), record
        if step.kind == 'effects':
            self._seen.carry(before, self._key())
        if view is not None:
            self._keep(result)
        self._next()

    def _failed(self, error: str) -> None:
        self.error, self._step, self._task = error, None, None
        self._waiting.clear()
        if self._partial is not None and self._partial.share < 1.0:
            self._partial = None

    def _bump(self) -> None:
        self.revision += 1
        self._changed()
