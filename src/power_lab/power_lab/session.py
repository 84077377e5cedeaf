"""The loop in Python: fit a model, see where it fails, add what it misses, see the error fall."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from power_estimator.effects import Catalogue, load_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import write_model
from power_estimator.judge.estimator import JudgeSettings
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded, load
from power_estimator.judge.result import JudgedModel
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from power_recordings.reading.bag_folder import check_recordings
from wattwalk_core.errors import InputError

from power_lab.budget.budget import Budget, budget
from power_lab.budget.choice import chosen_model, judge_of_pieces
from power_lab.compare.comparison import Comparison, comparison
from power_lab.compare.fitting import extended, fitted, named_effects, refitted
from power_lab.discover.outcome import DiscoveryOutcome, discover
from power_lab.report.figures import Stairs

if TYPE_CHECKING:
    from power_lab.diagnose.outcome import Outcome


@dataclass(frozen=True, repr=False)
class Session:
    """Recordings, and a model that is worked on; each step returns another session.

    Effects are named in one text (`'shaft copper_loss idle'`) or given one by one.
    """

    judge: Judge
    given: PowerModel | None = None
    spec: str = ''  # file or name of a model that was loaded

    def __post_init__(self) -> None:
        if not isinstance(self.judge, Judge):
            raise InputError('a session needs a judge; open recordings with Session.open(FOLDER)')

    @classmethod
    def open(
        cls,
        *recordings: str | Path,
        effects_path: Sequence[str | Path] = (),
        catalogue: Catalogue | None = None,
        settings: JudgeSettings | None = None,
        **how: Any,
    ) -> 'Session':
        """Read recordings; InputError for those that cannot be read or judged.

        effects_path: files of the user's own effects, which are run; settings: of fits and folds;
        how: arguments of `power_estimator.judge.recordings.load`, such as drives.
        """
        paths = [Path(recording) for recording in recordings]
        check_recordings(paths)
        known = catalogue or load_catalogue([Path(file) for file in effects_path])
        return cls(Judge(load(paths, **how), known, settings))

    def __str__(self) -> str:
        known = 'no model yet' if self.given is None else self.given.name
        if isinstance(self.given, EffectModel):
            known = ', '.join(self.given.effects)
        names = ', '.join(one['name'] for one in self.recordings.identities)
        return f'{names}: {known}'

    __repr__ = __str__

    @property
    def recordings(self) -> Loaded:
        """Recordings that models are judged on."""
        return self.judge.recordings

    @property
    def model(self) -> PowerModel:
        """Model that is worked on; InputError before there is one."""
        if self.given is None:
            raise InputError('there is no model yet; fit or load one first')
        return self.given

    @property
    def effects(self) -> EffectModel:
        """Model that is worked on, if made of effects; InputError for a network or a proxy."""
        model = self.model
        if not isinstance(model, EffectModel):
            raise InputError(f'{model.name} is not made of effects; fit them on it as a base')
        return model

    @cached_property
    def score(self) -> JudgedModel:
        """Held-out errors of the model; InputError where no sample can be judged."""
        return self.judge.score(self.model)

    def load(self, spec: str) -> 'Session':
        """Load a model: a file, `ppn:RUN` or the name of a proxy; InputError for another."""
        return replace(self, given=load_model(spec, self.judge.catalogue), spec=spec)

    def fit(self, *effects: str | Sequence[str], name: str = 'model', **how: Any) -> 'Session':
        """Fit a model of effects from nothing; how: base, per, seed, prior as in `fitted`."""
        return self._with(fitted(self.judge, self._named(effects), name, **how))

    def add(self, *effects: str | Sequence[str], name: str = '', **how: Any) -> 'Session':
        """Add effects to the model and refit all; how: per, seed. InputError for one it has."""
        model, new = self.effects, self._named(effects)
        for active in new:
            if active.name in model.effects:
                raise InputError(f'{active.name!r} is in the model already')
        return self._with(extended(self.judge, model, new, name or model.name, **how))

    def remove(self, *effects: str | Sequence[str], name: str = '', **how: Any) -> 'Session':
        """Remove effects from the model and refit; how: per, seed. InputError for one it lacks."""
        model, gone = self.effects, [active.name for active in self._named(effects)]
        for effect in gone:
            if effect not in model.effects:
                raise InputError(f'{effect!r} is not in the model')
        left = [active for active in model.structure.actives if active.name not in gone]
        if not left:
            raise InputError('no effect is left; a model has one or more')
        less = refitted(self.judge, model, left, name or model.name, **how)
        return self._with(less.with_history(*model.history, *less.history))

    def compare(self, *others: 'str | PowerModel | Session') -> Comparison:
        """Compare the model, if there is one, with others.

        others: files, `ppn:RUN`, proxies by name, models, or sessions (their models).
        """
        models = [] if self.given is None else [self.given]
        specs = [self.spec or model.name for model in models]
        for other in others:
            given = other.model if isinstance(other, Session) else other
            models.append(
                load_model(given, self.judge.catalogue) if isinstance(given, str) else given
            )
            spec = other.spec if isinstance(other, Session) else ''
            specs.append(given if isinstance(given, str) else spec or given.name)
        return comparison(self.judge, models, specs)

    def budget(
        self,
        changes: Mapping[str, float] | None = None,
        battery: float | None = None,
        seed: int = 0,
        first: Callable[[Budget], None] | None = None,
    ) -> Budget:
        """Split the metered power by effect, drive and phase, by the model or an automatic one.

        changes: factor by lever, by default 10 % of each; battery: Wh; first: takes a preliminary
        budget without intervals, levers and error before these are computed.
        """
        if self.given is None:
            model = chosen_model(judge_of_pieces(self.judge), seed)
        elif self.effects.fitted:
            model = self.effects
        else:
            model = self.fit(self.effects.effects, name=self.effects.name).effects
        how: dict[str, Any] = {'chosen': self.given is None, 'battery': battery, 'seed': seed}
        if first is not None:
            first(budget(self.judge, model, draws=0, **how))
        return budget(self.judge, model, changes=changes, **how)

    def diagnose(
        self, seed: int = 0, show: Callable[[str], None] = lambda text: None
    ) -> 'Outcome':
        """Find the effects that the model misses; show: takes texts of progress."""
        from power_lab.diagnose.outcome import diagnose  # slow to import: the judge

        spec = self.spec or self.model.name
        return diagnose(self.judge, self.model, spec, seed, show)

    def discover(
        self,
        test: Loaded | None = None,
        show: Callable[[str], None] = lambda text: None,
        seed: int = 0,
    ) -> DiscoveryOutcome:
        """Learn what the model misses and no catalogue has; test: another recording."""
        spec = self.spec or self.model.name
        return discover(self.judge, self.model, spec, test, show, seed)

    def stairs(self) -> Stairs:
        """Held-out errors of the steps by which the model was built."""
        noise = self.judge.prepared.noise
        return Stairs.of(self.effects.history, [self.score], self.recordings, noise)

    def save(self, path: str | Path) -> Path:
        """Write the model of effects to a file; return its path."""
        write_model(self.effects, Path(path))
        return Path(path)

    def _named(self, effects: Sequence[str | Sequence[str]]) -> list[Active]:
        texts = [text for one in effects for text in ([one] if isinstance(one, str) else one)]
        return named_effects(texts, self.judge.catalogue)

    def _with(self, model: EffectModel) -> 'Session':
        return replace(self, given=model, spec='')
