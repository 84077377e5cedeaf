"""Held-out errors of a model, and of what a diagnosis adds to it step by step."""

from dataclasses import dataclass, replace

from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.judge.judge import Judge
from power_estimator.judge.result import JudgedModel
from power_estimator.model import PowerModel

from power_lab.compare.comparison import Comparison, comparison
from power_lab.compare.regimes import Regime
from power_lab.diagnose.findings import Diagnosis
from power_lab.structure.words import in_words


@dataclass(frozen=True)
class JudgedSteps:
    """A model, and its structure with the effects of each step, as the judge has them.

    A model of other recordings comes twice: as it is, and refitted here as the steps are.
    """

    comparison: Comparison
    first: int  # place of the model among the steps

    @property
    def model(self) -> JudgedModel:
        """The model as it is."""
        return self.comparison.models[0]

    @property
    def steps(self) -> tuple[JudgedModel, ...]:
        """The model and the steps, all held out alike."""
        return self.comparison.models[self.first :]

    @property
    def before(self) -> JudgedModel:
        """The model, held out as the steps are."""
        return self.comparison.models[self.first]

    @property
    def after(self) -> JudgedModel:
        """With all effects that the diagnosis names."""
        return self.comparison.models[-1]

    @property
    def regimes(self) -> tuple[Regime, ...]:
        """Regimes in which the model fails most."""
        return self.comparison.regimes[0]

    @property
    def regimes_after(self) -> tuple[Regime, ...]:
        """Regimes in which it fails most with all effects that the diagnosis names."""
        return self.comparison.regimes[-1]


def judged_steps(
    judge: Judge, given: PowerModel, model: EffectModel, diagnosis: Diagnosis, spec: str
) -> JudgedSteps:
    """Judge a model as it was given, and its structure with what each step of a diagnosis adds."""

    def grown(actives: tuple[Active, ...], name: str) -> EffectModel:
        known = (
            replace(active, effect=judge.catalogue[active.name])
            if whole and active.name in judge.catalogue and active.effect.kind == 'physics'
            else active
            for active in actives
        )
        structure = Structure((*model.structure.actives, *known))
        return replace(model, name=name, structure=structure, groups=(), fitted_on=(), history=())

    whole = judge.prepared.whole
    actives = diagnosis.actives
    models: list[PowerModel] = [
        grown(actives[:count], f'+ {", ".join(in_words(one.name) for one in actives[:count])}')
        for count in range(1, len(actives) + 1)
    ]
    elsewhere = not (given is model and judge.refits(model))
    if elsewhere and models:
        models.insert(0, grown((), f'{model.name}, refitted here'))
    found = comparison(judge, [given, *models], [spec, *(one.name for one in models)])
    return JudgedSteps(found, int(elsewhere and bool(models)))
