"""Power models found by name or file."""

from dataclasses import replace
from pathlib import Path
from typing import Final

from wattwalk_core.errors import InputError, quoted

from power_estimator.effects.catalogue import Catalogue, builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import read_model
from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import PROXIES, Proxy

PLAIN: Final = 'plain'
_EFFECTS: Final = ('shaft', 'copper_loss', 'idle')


def load_model(spec: str, catalogue: Catalogue | None = None) -> PowerModel:
    """Return the power model of a name or file; InputError names what is missing or wrong.

    spec: `ppn:FILE_OR_RUN`, a proxy (`torque_squared`), `FILE.yaml` of effects, or `plain`. The
    last is mechanical power, a loss by torque² and a constant draw, not fitted yet. catalogue: the
    effects that a file may name, by default those that are shipped.
    """
    kind, colon, rest = spec.partition(':')
    if colon and kind == 'ppn':
        if not rest:
            raise InputError(f'model {quoted(spec)}: give a run folder or a file, ppn:runs/first')
        return PowerPredictionNetwork.load(Path(rest))
    if spec in PROXIES:
        return Proxy(spec)
    if spec == PLAIN:
        known = builtin_catalogue()
        return EffectModel(PLAIN, Structure(tuple(Active.of(known[name]) for name in _EFFECTS)))
    if spec.endswith(('.yaml', '.yml')):
        model = read_model(Path(spec), catalogue or builtin_catalogue())
        return replace(model, base_model=base_of(model))
    raise InputError(
        f'model {quoted(spec)} is not known; give ppn:RUN, a file that ends in .yaml, or one of '
        f'{", ".join(PROXIES)}'
    )


def load_base(spec: str) -> PowerModel:
    """Return the base model of a model of effects, `ppn:RUN` or a proxy; InputError for others."""
    if spec == PLAIN or spec.endswith(('.yaml', '.yml')):
        raise InputError(
            f'base {quoted(spec)}: a base model is ppn:RUN or a proxy, not a model of effects'
        )
    return load_model(spec)


def base_of(model: EffectModel) -> PowerModel | None:
    """Return the base of a model of effects, a proxy with the factors of its file; or None."""
    if model.base is None or model.base_model is not None:
        return model.base_model
    base = load_base(model.base)
    known = {group.type.name: group.base_factor for group in model.groups}
    factors = {name: factor for name, factor in known.items() if factor is not None}
    if not isinstance(base, Proxy) or not factors:
        return base
    return replace(base, types=tuple(group.type for group in model.groups), factors=factors)


def on_base(model: EffectModel, base: PowerModel | None) -> EffectModel:
    """Return the model of effects on a base; its drive groups keep the factors of a proxy."""
    if not isinstance(base, Proxy):
        return replace(model, base_model=base)
    groups = []
    for group in model.groups:
        kinds = [kind.name for kind in base.types if kind.matches(group.type.patterns[0])]
        groups.append(replace(group, base_factor=base.factors.get(kinds[0]) if kinds else None))
    return replace(model, groups=tuple(groups), base_model=base)
