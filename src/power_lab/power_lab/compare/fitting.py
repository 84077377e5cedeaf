"""Models of effects made from loaded recordings: fitted from nothing, and with effects added."""

from collections.abc import Sequence

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.training import Material, fit_model, material
from power_estimator.effects.model_file.model import EffectModel

from power_lab.compare.addition import add_effects
from power_lab.recordings import Loaded, base_power


def material_of(loaded: Loaded, catalogue: Catalogue, base: str | None, per: str) -> Material:
    """Material of recordings on a base model's power; InputError as of `material`."""
    power = base_power(loaded, base).power if base else None
    return material(loaded.data, per=per, base=power, catalogue=catalogue, window=loaded.window)


def fitted(
    loaded: Loaded,
    effects: Sequence[Active],
    catalogue: Catalogue,
    name: str,
    *,
    base: str | None = None,
    per: str = 'type',
    seed: int = 0,
) -> tuple[EffectModel, Material]:
    """A model of effects with its error in the fit as the beginning of its history."""
    own = material_of(loaded, catalogue, base, per)
    model, fit = fit_model(
        name, own, effects, catalogue, base=base, fitted_on=loaded.identities, seed=seed
    )
    rmse = {
        meter: float(f'{value:.4g}')
        for meter, value in zip(own.prepared.names, np.sqrt(fit.mse), strict=True)
    }
    entry = {'step': 'fit', 'effects': list(model.effects), 'rmse_w': rmse}
    return model.with_history(entry), own


def extended(
    loaded: Loaded,
    model: EffectModel,
    new: Sequence[Active],
    catalogue: Catalogue,
    name: str,
    *,
    per: str = 'type',
    seed: int = 0,
) -> EffectModel:
    """A model with effects added and all coefficients fitted anew."""
    own = material_of(loaded, catalogue, model.base, per)
    return add_effects(model, new, own, catalogue, name, loaded.identities, seed)
