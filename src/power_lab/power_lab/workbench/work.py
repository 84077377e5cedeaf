"""Work of a session as its worker does it, by the functions that the commands call."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from power_estimator.effects import Catalogue, load_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.training import LEAST_TO_FIT, material
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import read_model, write_model
from power_recordings.quality.check import check_recording
from wattwalk_core.errors import InputError
from wattwalk_core.files import read_bytes, write_whole
from wattwalk_core.yaml_file import SIZE

from power_lab.compare.comparison import compare, open_model
from power_lab.compare.fitting import extended, fitted
from power_lab.diagnose.words import in_words
from power_lab.recordings import Loaded, load
from power_lab.workbench import logs, maps
from power_lab.workbench.bench_run import record_on_bench, shortened
from power_lab.workbench.session import SessionStep
from power_lab.workbench.source import Findings, Source
from power_lab.workbench.view import PowerView, judged_view, measured_view

if TYPE_CHECKING:
    # They take seconds to import, which the first picture does not wait for.
    from power_lab.diagnose.outcome import Outcome
    from power_lab.discover.outcome import DiscoveryOutcome

Show = Callable[[str, Any], None]
_PREVIEWED = 10  # candidates, those in the confidence set and then by what they explain


class Work:
    """Keeps the recordings that were loaded last, and the outcome of the last diagnosis."""

    def __init__(self) -> None:
        self._opened: Source | None = None
        self._loaded: Loaded | None = None
        self._outcome: tuple[Source, str, Outcome] | None = None

    @staticmethod
    def prepare() -> None:
        """Import what only a diagnosis needs, before one is asked for."""
        import power_lab.diagnose.outcome  # noqa: F401

    def open(self, show: Show, source: Source, spec: str) -> dict[str, Any]:
        """Read recordings; views as they come, then what is known of the recordings."""
        loaded = self._load(show, source)
        own = material(loaded.data, least=LEAST_TO_FIT, window=loaded.window)
        view = measured_view(loaded, own.prepared)
        show('view', view)
        if spec:
            view = self._judged(show, source, loaded, spec)
            show('view', view)
        show('progress', 'checking the quality of the recordings')
        return {
            'view': view,
            'recordings': [_described(r) for r in loaded.recordings],
            'sha256': [one['sha256'] for one in loaded.identities],
        }

    def effects(self, show: Show, files: Sequence[str]) -> dict[str, Any]:
        """Check that files of effects can be run; return nothing that is shown."""
        load_catalogue([Path(file) for file in files])
        return {}

    def judge(self, show: Show, source: Source, spec: str) -> dict[str, Any]:
        """The present model on the recordings."""
        loaded = self._load(show, source)
        if not spec:
            return {'view': measured_view(loaded, material(loaded.data).prepared)}
        return {'view': self._judged(show, source, loaded, spec)}

    def shape(
        self, show: Show, source: Source, spec: str, step: SessionStep, output: Path
    ) -> dict[str, Any]:
        """Make the model of a step (load, fit, add, remove) at output, and judge it."""
        catalogue = source.catalogue()
        loaded = self._load(show, source)
        if step.kind == 'load':
            if not step.file.endswith(('.yaml', '.yml')):
                open_model(step.file, catalogue)
                return {'view': self._judged(show, source, loaded, step.file), 'model': ''}
            read_model(Path(step.file), catalogue)
            write_whole(output, read_bytes(Path(step.file), 'model', SIZE))
        else:
            show('progress', 'fitting')
            write_model(self._made(loaded, catalogue, spec, step, output.stem), output)
        return {'view': self._judged(show, source, loaded, str(output)), 'model': output.name}

    def diagnose(self, show: Show, source: Source, spec: str, seed: int = 0) -> Findings:
        """Return which effect the present model misses."""
        outcome = self._diagnosed(show, source, spec, seed)
        content = outcome.json()
        for row in content['candidates']:
            row['words'] = in_words(row['name'])
        singles = {one.name: one for one in outcome.diagnosis.singles}
        names = [row.name for row in outcome.rows][:_PREVIEWED]
        return Findings(content, {name: singles[name].explained for name in names})

    def report(self, show: Show, source: Source, spec: str, output: Path) -> str:
        """Write the page of the diagnosis; return its name."""
        outcome = self._diagnosed(show, source, spec)
        show('progress', 'writing the report')
        from power_lab.report.page import write_diagnosis

        write_diagnosis(output, outcome, [], source.catalogue())
        return output.name

    def discover(
        self, show: Show, source: Source, spec: str, output: Path, seed: int = 0
    ) -> dict[str, Any]:
        """Learn what no catalogue has; its effects are written to output, which is not run."""
        from power_lab.discover.outcome import discover

        catalogue = source.catalogue()
        loaded = self._load(show, source)
        model = open_model(spec, catalogue)
        outcome = discover(
            loaded, model, spec, catalogue, None, lambda text: show('progress', text), seed
        )
        if outcome.written:
            write_whole(output, outcome.source())
        return {
            **outcome.json(),
            'file': output.name if outcome.written else '',
            'path': str(output) if outcome.written else '',
            'shapes': _learned(outcome),
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
        """Record the proposed motion on the simulated bench; return the recording's path."""
        from power_lab.challenge.challenge import SEALED

        outcome = self._diagnosed(show, source, spec)
        proposed = outcome.motion if seconds is None else shortened(outcome.motion, seconds)
        folders = [recording.folder for recording in outcome.loaded.recordings]
        riddle = next((folder for folder in folders if (folder / SEALED).exists()), None)

        def tell(text: str) -> None:
            show('progress', text)

        record_on_bench(proposed, drive, motion, output, riddle, tell)
        return str(output)

    def look_at_log(self, show: Show, file: str) -> dict[str, Any]:
        """Return the columns of a log, and a guessed map."""
        return logs.look(show, file)

    def preview_log(self, show: Show, file: str, content: Mapping[str, Any]) -> dict[str, Any]:
        """Return the signals that a map gives."""
        return logs.preview(show, file, content)

    def import_log(self, show: Show, **given: Any) -> dict[str, Any]:
        """Make a log a recording."""
        return logs.bring_in(show, **given)

    def line(self, show: Show, source: Source, spec: str) -> dict[str, Any]:
        """Another model on the same recordings, as a line beside the staircase."""
        catalogue = source.catalogue()
        loaded = self._load(show, source)
        show('progress', 'comparing the other model')
        (told,) = compare(loaded, [spec], catalogue).json()['models']
        errors = [own['rmse_w'] for own in told['drives'].values() if own['rmse_w'] is not None]
        return {'name': spec, 'rmse_w': float(np.sqrt(np.mean(np.square(errors))))}

    def _diagnosed(self, show: Show, source: Source, spec: str, seed: int = 0) -> 'Outcome':
        if self._outcome is not None and self._outcome[:2] == (source, spec):
            return self._outcome[2]
        from power_lab.diagnose.outcome import diagnose

        catalogue = source.catalogue()
        loaded = self._load(show, source)
        show('progress', 'diagnosing: trying every effect of the catalogue')
        outcome = diagnose(loaded, open_model(spec, catalogue), spec, catalogue, seed)
        self._outcome = (source, spec, outcome)
        return outcome

    def _load(self, show: Show, source: Source) -> Loaded:
        if self._loaded is None or self._opened != source.unchecked:
            show('progress', 'reading the recordings')
            self._loaded = self._outcome = self._opened = None
            paths = [Path(path) for path in source.recordings]
            loaded = load(paths, source.drives, slow=source.slow, anyway=source.anyway)
            self._loaded, self._opened = loaded, source.unchecked
        known = tuple(one['sha256'] for one in self._loaded.identities)
        if source.sha256 and source.sha256 != known:
            raise InputError(
                f'{", ".join(source.recordings)}: these are not the recordings that the session '
                'was made on (another sha256); open them anew'
            )
        return self._loaded

    def _judged(self, show: Show, source: Source, loaded: Loaded, spec: str) -> PowerView:
        show('progress', 'comparing the model with the measurement')
        catalogue = source.catalogue()
        comparison = compare(loaded, [spec], catalogue)
        return judged_view(comparison, described_model(spec, catalogue))

    def _made(
        self, loaded: Loaded, catalogue: Catalogue, spec: str, step: SessionStep, name: str
    ) -> EffectModel:
        effects = _actives(step.effects, catalogue)
        options: dict[str, Any] = {'per': step.per, 'seed': step.seed}
        if step.kind == 'fit':
            base = step.base or None
            return fitted(loaded, effects, catalogue, name, base=base, **options)[0]
        model = read_model(Path(spec), catalogue)
        if step.kind == 'add':
            for effect in step.effects:
                if effect in model.effects:
                    raise InputError(f'{effect!r} is in the model already')
            return extended(loaded, model, effects, catalogue, name, **options)
        for effect in step.effects:
            if effect not in model.effects:
                raise InputError(f'{effect!r} is not in the model')
        left = _actives([e for e in model.effects if e not in step.effects], catalogue)
        less, _ = fitted(loaded, left, catalogue, name, base=model.base, **options)
        return less.with_history(*model.history, *less.history)


def _actives(names: Sequence[str], catalogue: Catalogue) -> list[Active]:
    if not names:
        raise InputError('no effect is left; a model has one or more')
    return [Active.of(catalogue.get_known(name, 'effects')) for name in names]


def described_model(spec: str, catalogue: Catalogue) -> dict[str, Any]:
    """Effects of a model in words, with coefficients and intervals by group of drives."""
    model = open_model(spec, catalogue)
    if not isinstance(model, EffectModel):
        model = EffectModel(model.name, Structure(()), base=spec)
    effects = []
    for active in model.structure.actives:
        rows = []
        for group in model.groups if active in model.structure.free else ():
            values = group.coefficients[active.name]
            for term, value in zip(active.effect.terms, values, strict=True):
                rows.append(
                    {
                        'group': group.type.name,
                        'symbol': term.symbol,
                        'unit': term.unit,
                        'value': value.value,
                        'interval': list(value.interval),
                        'at_bound': value.at_bound or None,
                    }
                )
        effects.append(
            {
                'name': active.name,
                'words': in_words(active.name),
                'physics': active.effect.physics,
                'formula': active.effect.formula,
                'fixed': active.effect.fixed,
                'coefficients': rows,
            }
        )
    return {
        'name': model.name,
        'base': model.base,
        'effects': effects,
        'at_bound': list(model.at_bound),
        'fitted': model.fitted,
        'history': [dict(entry) for entry in model.history],
    }


def _learned(outcome: 'DiscoveryOutcome') -> list[dict[str, Any]]:
    """Learned shapes with their formulas, one of each effect and drive."""
    from power_lab.report.discovery_page import formula_over_shape, standard_error

    names, out = outcome.own.prepared.names, []
    for one in outcome.discovery.found:
        if one.formula is None or one.shapes is None or one.coefficients is None:
            continue
        for drive in one.formula.places:
            shape = one.shapes[drive]
            drawn, axes = formula_over_shape(one, drive)
            out.append(
                {
                    'name': one.name,
                    'drive': names[drive],
                    'formula': one.formula.text(drive),
                    'axes': list(axes),
                    'x': maps.short(shape.nodes),
                    'shape': maps.short(shape.values),
                    'error': maps.short(2.0 * standard_error(shape)),
                    'drawn': maps.short(drawn),
                }
            )
    return out


def _described(recording: Any) -> dict[str, Any]:
    """Card, rates and quality of a recording."""
    quality, card = check_recording(recording), recording.card
    return {
        'path': str(recording.path),
        'name': recording.path.name,
        'seconds': round(recording.duration, 2),
        'card': {
            name: getattr(card, name)
            for name in ('robot', 'unit', 'controller', 'terrain', 'notes')
            if getattr(card, name)
        },
        'notes': [{'time': mark.time, 'text': mark.text} for mark in card.marks],
        'rates': {name: round(float(t.rate), 2) for name, t in quality.topics.items()},
        'torque': dict(quality.torque_at),
        'drives': [
            {'name': name, 'updates_hz': _finite(one.updates_hz)}
            for name, one in quality.drives.items()
        ],
        'findings': [
            {'severity': one.severity, 'drive': one.drive, 'text': one.text}
            for one in quality.findings
        ],
        'problems': list(recording.problems),
    }


def _finite(value: float) -> float | None:
    return round(float(value), 2) if np.isfinite(value) else None
