"""Models of effects made from recordings: fitted from nothing, and with effects added."""

from collections.abc import Sequence

from power_estimator.effects.fit.design import Active
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.training import Material, fit_model
from power_estimator.judge.judge import Judge


def fitted(
    judge: Judge,
    effects: Sequence[Active],
    name: str,
    *,
    base: str | None = None,
    per: str = 'type',
    seed: int = 0,
) -> tuple[EffectModel, Material]:
    """A model of effects with its held-out error as the beginning of its history."""
    own = judge.material(base, per)
    model, _ = fit_model(
        name,
        own,
        effects,
        judge.catalogue,
        base=base,
        fitted_on=judge.recordings.identities,
        seed=seed,
    )
    judged = judge.score(model)
    entry = {
        'step': 'fit',
        'effects': list(model.effects),
        'recordings': [entry['name'] for entry in judge.recordings.identities],
        'held_out': judged.held_out,
        'rmse_w': judged.rmse,
    }
    return model.with_history(entry), own


def extended(
    judge: Judge,
    model: EffectModel,
    new: Sequence[Active],
    name: str,
    *,
    per: str = 'type',
    seed: int = 0,
) -> EffectModel:
    """A model with effects added and all coefficients fitted anew."""
    effects = [*model.structure.actives, *new]
    better, _ = fitted(judge, effects, name, base=model.base, per=per, seed=seed)
    entry = {
        **better.history[-1],
        'step': 'add',
        'added': [active.name for active in new],
        'rmse_before_w': judge.score(model).rmse,
    }
    return better.with_history(*model.history, entry)
