"""Heavy work of a session, done in its own process by the functions that the commands call."""

import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from power_estimator.effects import Catalogue, load_catalogue
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import read_model
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded, load
from power_estimator.judge.result import over_meters
from power_estimator.loader import load_model
from power_lab.budget.budget import Budget
from power_lab.budget.efficiency_map import efficiency_maps
from power_lab.budget.gait_cycle import GaitCyclePower
from power_lab.budget.tables import headline
from power_lab.challenge.bench_recording import record_on_bench, shortened
from power_lab.compare.comparison import compare
from power_lab.session import Session
from power_lab.structure.words import in_words, verdict_in_words
from power_recordings.reading.bag_folder import find
from wattwalk_core.console import finite
from wattwalk_core.errors import InputError
from wattwalk_core.files import read_bytes, write_whole
from wattwalk_core.yaml_file import SIZE

from power_workbench.files import logs
from power_workbench.sessions.described import (
    described_model,
    described_recording,
    described_shapes,
)
from power_workbench.sessions.opened_cache import KeptOpening, OpenedCache
from power_workbench.sessions.source import Findings, Source
from power_workbench.sessions.steps import SessionStep
from power_workbench.views.coarse import coarse_view
from power_workbench.views.view import PowerView, judged_view, measured_view

if TYPE_CHECKING:
    # They take seconds to import, which the first picture does not wait for.
    from power_lab.diagnose.outcome import Outcome

Show = Callable[[str, Any], None]
_PREVIEWED = 10  # candidates, the most probable ones


class SessionWorker:
    """Work of a session: each public method is a request that the worker process serves.

    The recordings loaded last and the outcome of the last diagnosis are kept. `show` takes a kind
    of message, `progress` or `view`, and its content. `spec` is a model as commands take it, ''
    for none. InputError is for what the user can correct.
    """

    def __init__(self, cache: OpenedCache | None = None) -> None:
        """cache: of what was read before; None reads everything anew."""
        self._cache = OpenedCache(None) if cache is None else cache
        self._opened: Source | None = None
        self._loaded: Loaded | None = None
        self._reading = threading.RLock()
        self._outcome: tuple[Source, str, Outcome] | None = None

    @staticmethod
    def prepare() -> None:
        """Import what only a diagnosis needs, before one is asked for."""
        import power_lab.diagnose.outcome  # noqa: F401  slow to import

    def open(self, show: Show, source: Source, spec: str) -> dict[str, Any]:
        """Read recordings, showing views as they come; return view, recordings and sha256."""
        key = self._cache.key(source)
        kept = self._cache.opening(key)
        if kept is None:
            kept = self._read(show, source, key)
        else:
            show('view', kept.view)
        if not spec:
            return kept.result
        view = self._judged(show, source, self._load(show, source), spec)
        show('view', view)
        return {**kept.result, 'view': view}

    def _read(self, show: Show, source: Source, key: str) -> KeptOpening:
        """Read recordings: a first look at a part of them, all of them, then their quality."""
        if source.without:
            whole = self.open(show, source.whole, '')
            view = self._measured(self._load(show, source))
            kept = KeptOpening(view, whole['recordings'], whole['sha256'])
        else:
            show('progress', 'a first look')
            coarse = coarse_view(source.recordings, source.drives)
            if coarse is not None:
                show('view', coarse)
            loaded = self._load(show, source)
            view = self._measured(loaded)
            show('view', view)
            show('progress', 'checking the quality of the recordings')
            described = tuple(described_recording(own) for own in loaded.recordings)
            kept = KeptOpening(view, described, tuple(own['sha256'] for own in loaded.identities))
            # The aligned signals of the file need less memory than those that were read.
            self._cache.keep_loaded(key, loaded, [Path(path) for path in source.recordings])
            self._loaded = self._cache.loaded(key) or self._loaded
        self._cache.keep_opening(key, kept)
        return kept

    @staticmethod
    def _measured(loaded: Loaded) -> PowerView:
        return measured_view(loaded, Judge(loaded).material().prepared)

    def effects(self, show: Show, files: Sequence[str]) -> dict[str, Any]:
        """Check that files of effects can be run; return an empty result, InputError if not."""
        load_catalogue([Path(file) for file in files])
        return {}

    def judge(self, show: Show, source: Source, spec: str) -> dict[str, Any]:
        """Return {view} of the model on the recordings, or of the measurement without one."""
        loaded = self._load(show, source)
        view = self._judged(show, source, loaded, spec) if spec else self._measured(loaded)
        return {'view': view}

    def shape(
        self, show: Show, source: Source, spec: str, step: SessionStep, output: Path
    ) -> dict[str, Any]:
        """Make the model of a step (load, fit, add, remove) at output, and judge it.

        Returns {view, model: the file's name, '' where none was written}.
        """
        catalogue = source.catalogue()
        loaded = self._load(show, source)
        if step.kind == 'load':
            if not step.file.endswith(('.yaml', '.yml')):
                load_model(step.file, catalogue)
                return {'view': self._judged(show, source, loaded, step.file), 'model': ''}
            read_model(Path(step.file), catalogue)
            write_whole(output, read_bytes(Path(step.file), 'model', SIZE))
        else:
            show('progress', 'fitting')
            self._made(loaded, catalogue, spec, step, output.stem).save(output)
        return {'view': self._judged(show, source, loaded, str(output)), 'model': output.name}

    def diagnose(self, show: Show, source: Source, spec: str, seed: int = 0) -> Findings:
        """Find the effect that the model misses; seed: of the random draws."""
        outcome = self._diagnosed(show, source, spec, seed)
        content = outcome.json()
        content['kind'] = verdict_in_words(outcome.verdict, len(content['effects']))
        for row in content['candidates']:
            row['words'] = in_words(row['name'])
        shown = outcome.diagnosis.candidates[:_PREVIEWED]
        explained = {one.name: one.explained for one in shown}
        part = outcome.prepared.part
        if part is not None:
            explained = {name: part.everywhere(own) for name, own in explained.items()}
        return Findings(content, explained)

    def budget(self, show: Callable[[Mapping[str, Any]], None], source: Source, spec: str) -> None:
        """Show the budget by the model, or by a chosen one where the model has no effects.

        A first look without intervals comes first. Runs in a thread beside the other requests.
        """

        def tell(content: Mapping[str, Any]) -> None:
            show({'source': source, 'spec': spec, 'content': finite(content)})

        def told(found: Budget) -> dict[str, Any]:
            return {
                **found.json(),
                'headline': headline(found.account, found.levers),
                'robot': found.account.first,
                'refused': found.refused,
            }

        def first(found: Budget) -> None:
            tell({**told(found), 'origin': ', '.join(found.model.effects), 'first': True})

        try:
            lab = self._lab(lambda *_: None, source)
            own = lab.load(spec) if spec else lab
            lab = own if isinstance(own.given, EffectModel) else lab
            found = lab.budget(first=first)
            cycle = GaitCyclePower.of(found.pictured)
            pictures = {
                'efficiency': [one.json() for one in efficiency_maps(found)],
                'gait': None if cycle is None else cycle.json(),
            }
            tell({**told(found), 'origin': found.origin, **pictures})
        except InputError as error:
            tell({'error': str(error)})
        except Exception as error:
            traceback.print_exc()
            tell({'error': f'{type(error).__name__}: {error}'})

    def report(self, show: Show, source: Source, spec: str, output: Path) -> str:
        """Write the diagnosis as an HTML page to output; return its name."""
        outcome = self._diagnosed(show, source, spec)
        show('progress', 'writing the report')
        from power_lab.report.page import write_diagnosis  # slow to import: plots

        write_diagnosis(output, outcome, [], source.catalogue())
        return output.name

    def discover(
        self, show: Show, source: Source, spec: str, output: Path, seed: int = 0
    ) -> dict[str, Any]:
        """Learn effects that no catalogue has, write them to output, and return JSON content."""
        lab = self._lab(show, source).load(spec)
        outcome = lab.discover(show=partial(show, 'progress'), seed=seed)
        if outcome.written:
            write_whole(output, outcome.source())
        return {
            **outcome.json(),
            'file': output.name if outcome.written else '',
            'path': str(output) if outcome.written else '',
            'shapes': described_shapes(outcome),
        }

    def bench(
        self,
        show: Show,
        source: Source,
        spec: str,
        drive: str,
        seconds: float | None,
        motion: Path,
        output: Path,
    ) -> str:
        """Record the proposed motion of a drive on the simulated bench; return the path.

        seconds: to which the motion is cut; motion, output: files to write.
        """
        from power_lab.challenge.challenge import SEALED  # slow to import: the simulator

        outcome = self._diagnosed(show, source, spec)
        proposed = outcome.motion if seconds is None else shortened(outcome.motion, seconds)
        folders = [find(Path(path)).folder for path in source.recordings]
        riddle = next((folder for folder in folders if (folder / SEALED).exists()), None)
        tell = partial(show, 'progress')
        record_on_bench(proposed, drive, motion, output, riddle, tell)
        return str(output)

    look_at_log = staticmethod(logs.look)
    preview_log = staticmethod(logs.preview)
    import_log = staticmethod(logs.bring_in)

    def line(self, show: Show, source: Source, spec: str) -> dict[str, Any]:
        """Return name and held-out RMS error in W of another model on the recordings."""
        catalogue = source.catalogue()
        loaded = self._load(show, source)
        show('progress', 'comparing the other model')
        (told,) = compare(loaded, [spec], catalogue).json()['models']
        errors = [own['rmse_w'] for own in told['drives'].values()]
        return {'name': spec, 'rmse_w': over_meters(errors)}

    def _diagnosed(self, show: Show, source: Source, spec: str, seed: int = 0) -> 'Outcome':
        if self._outcome is not None and self._outcome[:2] == (source, spec):
            return self._outcome[2]
        lab = self._lab(show, source).load(spec)
        show('progress', 'trying every effect of the catalogue')
        outcome = lab.diagnose(seed)
        self._outcome = (source, spec, outcome)
        return outcome

    def _lab(self, show: Show, source: Source) -> Session:
        return Session(Judge(self._load(show, source), source.catalogue()))

    def _load(self, show: Show, source: Source) -> Loaded:
        with self._reading:
            if self._loaded is None or self._opened != source.whole.unchecked:
                self._loaded = self._outcome = self._opened = None
                loaded = self._cache.loaded(self._cache.key(source.whole))
                if loaded is None:
                    show('progress', 'reading the recordings')
                    paths = [Path(path) for path in source.recordings]
                    loaded = load(paths, source.drives, slow=source.slow, anyway=source.anyway)
                self._loaded, self._opened = loaded, source.whole.unchecked
            known = tuple(one['sha256'] for one in self._loaded.identities)
            if source.sha256 and source.sha256 != known:
                raise InputError(
                    f'{", ".join(source.recordings)}: these are not the recordings that the '
                    'session was made on (another sha256); open them anew'
                )
            return self._loaded.without(source.without)

    def _judged(self, show: Show, source: Source, loaded: Loaded, spec: str) -> PowerView:
        show('progress', 'comparing the model with the measurement')
        catalogue = source.catalogue()
        comparison = compare(loaded, [spec], catalogue)
        return judged_view(comparison, loaded, described_model(spec, catalogue))

    def _made(
        self, loaded: Loaded, catalogue: Catalogue, spec: str, step: SessionStep, name: str
    ) -> Session:
        lab = Session(Judge(loaded, catalogue))
        options: dict[str, Any] = {'name': name, 'seed': step.seed}
        options |= {'per': step.per} if step.per else {}
        if step.kind == 'fit':
            return lab.fit(step.effects, base=step.base or None, **options)
        lab = lab.load(spec)
        change = lab.add if step.kind == 'add' else lab.remove
        return change(step.effects, **options)
