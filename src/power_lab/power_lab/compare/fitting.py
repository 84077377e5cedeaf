"""Models of effects made from recordings: fitted from nothing, and with effects added."""

from collections.abc import Sequence
from typing import Any

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import one_thread_a_product
from power_estimator.effects.fit.design import Active, Prior
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.training import fit_model
from power_estimator.judge.judge import Judge
from power_estimator.loader import on_base
from power_estimator.posterior.intervals import with_intervals
from power_estimator.posterior.priors import MOST_SECONDS
from wattwalk_core.errors import InputError


@one_thread_a_product()
def fitted(
    judge: Judge,
    effects: Sequence[Active],
    name: str,
    *,
    base: str | None = None,
    per: str = 'type',
    seed: int = 0,
    prior: Prior | None = None,
    intervals: bool = True,
) -> EffectModel:
    """Fit a model of effects; its history begins with its held-out error.

    base: model that effects are added to; per: 'type' or 'drive', which shares coefficients;
    prior: distributions of coefficients to start from; intervals: compute them by the posterior,
    which takes most of the time. InputError for recordings that are too short or too still.
    """
    under = judge.base(base)
    names = {active.name for active in effects}
    material = judge.material(under, per)
    model, _ = fit_model(
        name,
        material,
        effects,
        judge.catalogue,
        base=base,
        fitted_on=judge.recordings.identities,
        seed=seed,
        prior={name: own for name, own in (prior or {}).items() if name in names},
    )
    if intervals and not model.prior:  # which the posterior does not know
        judged_on = material.at_most(MOST_SECONDS)
        model = with_intervals(model, judged_on.prepared, judged_on.base_power)
    model = on_base(model, under)
    judged = judge.score(model)
    entry = {
        'step': 'fit',
        'effects': list(model.effects),
        **judge.recordings.judged_on,
        'held_out': judged.held_out,
        'rmse_w': judged.rmse,
    }
    return model.with_history(entry)


def extended(
    judge: Judge, model: EffectModel, new: Sequence[Active], name: str, **how: Any
) -> EffectModel:
    """Add effects to a model and refit all coefficients; how: arguments of `refitted`."""
    better = refitted(judge, model, [*model.structure.actives, *new], name, **how)
    before = judge.score(model)
    entry = {
        **better.history[-1],
        'step': 'add',
        'added': [active.name for active in new],
        'held_out_before': before.held_out,
        'rmse_before_w': before.rmse,
    }
    return better.with_history(*model.history, entry)


def refitted(
    judge: Judge,
    model: EffectModel,
    effects: Sequence[Active],
    name: str,
    *,
    per: str | None = None,
    seed: int = 0,
) -> EffectModel:
    """Fit effects on a model's base and prior; per: 'type' or 'drive', by default the model's."""
    alone = all(group.type.patterns == (group.type.name,) for group in model.groups)
    per = per or ('drive' if model.groups and alone else 'type')
    return fitted(judge, effects, name, base=model.base, per=per, seed=seed, prior=model.prior)


def named_effects(texts: Sequence[str], catalogue: Catalogue) -> list[Active]:
    """Parse names of effects separated by commas or spaces: `shaft,copper_loss idle`.

    Errors of the measurement may be named but are left out, as every fit has them. InputError for
    an unknown or repeated name, and where no effect of the drive is named.
    """
    names = ' '.join(texts).replace(',', ' ').split()
    if not names:
        raise InputError('effects: none is named; for example shaft,copper_loss,idle')
    if len(set(names)) < len(names):
        raise InputError(f'effects: one is named twice in {",".join(names)}')
    effects = [catalogue.get_known(name, 'effects') for name in names]
    actives = [Active.of(effect) for effect in effects if effect.kind == 'physics']
    if not actives:
        errors = f'{", ".join(names)} are errors of the measurement, which every fit has anyway'
        raise InputError(f'effects: {errors}; name effects of the drive')
    return actives
