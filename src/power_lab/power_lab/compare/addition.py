"""Effects added to a model: the refit, and its held-out errors before and after."""

from collections.abc import Sequence
from typing import Any

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.fit.training import Material, fit_model
from power_estimator.effects.model_file.model import EffectModel

from power_lab.compare.evidence import Examiner


def add_effects(
    model: EffectModel,
    new: Sequence[Active],
    own: Material,
    catalogue: Catalogue,
    name: str,
    identities: Sequence[Any],
    seed: int = 0,
) -> EffectModel:
    """Return a model with more effects, fitted to the material, with an entry in its history."""
    better, _ = fit_model(
        name,
        own,
        [*model.structure.actives, *new],
        catalogue,
        base=model.base,
        fitted_on=identities,
        seed=seed,
    )
    entry = {
        'step': 'add',
        'added': [active.name for active in new],
        'effects': list(better.effects),
        'recordings': [entry['name'] for entry in identities],
        'rmse_before_w': held_out_errors(own, model, catalogue),
        'rmse_w': held_out_errors(own, better, catalogue),
    }
    return better.with_history(*model.history, entry)


def held_out_errors(own: Material, model: EffectModel, catalogue: Catalogue) -> dict[str, float]:
    """Cross-validated error of a model's structure on the material, W by drive."""
    terms = measurement_terms(catalogue, shaft='shaft' in model.effects)
    examiner = Examiner(own.fitter())
    evidence = examiner.examine(
        examiner.fitter.fit(own.structure(model.structure.actives).plus(*terms), iterations=4)
    )
    return {
        drive: float(f'{value:.4g}')
        for drive, value in zip(own.prepared.names, evidence.rmse, strict=True)
    }
