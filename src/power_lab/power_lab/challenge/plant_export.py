"""From a fitted model to the simulator's plant: what was found is switched on there."""

from collections.abc import Callable, Mapping

import numpy as np
from power_estimator.effects.model_file.model import DriveGroup, EffectModel
from sim_bridge.plant.parameters import DriveParameters, Plant
from wattwalk_core.errors import InputError

Strength = Callable[[tuple[float, ...], DriveParameters], float]

_STRENGTHS: Mapping[str, Strength] = {
    'copper_loss': lambda c, p: c[0] * p.torque_constant**2 / p.resistance,
    'viscous_friction': lambda c, p: c[0] / p.viscous,
    'coulomb_friction': lambda c, p: c[0] / p.coulomb,
    'stribeck_friction': lambda c, p: c[0] / p.stribeck,
    'load_friction': lambda c, p: c[0] / p.load_friction,
    'rotor_inertia': lambda c, p: c[0] / p.rotor_inertia,
    'iron_loss': lambda c, p: sum(c) / (p.hysteresis + p.eddy),
    'inverter_loss': lambda c, p: sum(c) * p.torque_constant / p.device_drop,
    'idle': lambda c, p: c[0] / p.idle_power,
    'line_resistance': lambda c, p: c[0] / p.line_resistance,
    'regeneration_efficiency': lambda c, p: c[0] / (1.0 - p.regeneration_efficiency),
    'regeneration_limit': lambda c, p: c[0],
    'spring': lambda c, p: c[0] * p.spring_stiffness,
    'cogging': lambda c, p: float(np.hypot(c[0], c[1])) / p.cogging,
    'winding_heating': lambda c, p: 1.0,
    'field_weakening': lambda c, p: 1.0,
    'magnet_heating': lambda c, p: c[0] / p.magnet_coefficient,
}
_MOST = 10.0


def to_plant(model: EffectModel, plant: Plant) -> tuple[Plant, dict[str, float]]:
    """The plant with the model's effects on at the strength that was fitted, all others off.

    Returns it with the strengths, in multiples of the plant's own, each the mean over the drive
    types. InputError for a model without coefficients or with an effect unknown to the simulator.
    """
    if not model.fitted:
        raise InputError(f'{model.name}: the model has no coefficients yet; fit it first')
    known = {name for name, _ in plant.effects}
    strengths: dict[str, float] = {}
    for name in model.effects:
        if name == 'shaft':
            continue
        if name not in known:
            raise InputError(f'{model.name}: the simulator has no effect {name!r}')
        if name == 'regeneration_limit' and not model.needs.together:
            raise InputError(f'{model.name}: the simulator has no diodes in front of each drive')
        found = [_strength(name, group, plant) for group in model.groups]
        strengths[name] = float(np.clip(np.mean(found), 0.0, _MOST))
    changes: dict[str, bool | float] = {name: False for name in known}
    changes.update({name: value if value > 0 else False for name, value in strengths.items()})
    return plant.with_effects(**changes), strengths


def _strength(name: str, group: DriveGroup, plant: Plant) -> float:
    values = tuple(value.value for value in group.coefficients[name])
    return float(_STRENGTHS[name](values, plant.parameters(group.type.name)))
