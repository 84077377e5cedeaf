"""Draws of a model's coefficients, as uncertain as its recordings leave them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from power_estimator.effects import Signals
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.fit.whole_robot import column_of, share_of
from power_estimator.effects.model_file.model import DriveGroup, EffectModel, FittedValue
from power_estimator.effects.split import split
from power_estimator.effects.training import Material
from power_estimator.judge.judge import Judge
from power_estimator.posterior.intervals import posterior_draws
from wattwalk_core.arrays import Floats

_SECONDS: Final = 120.0  # of drives that share coefficients, which they are drawn from
_LEAST_SECONDS: Final = 30.0
_TORQUE_SCALE: Final = 0.03  # error of torque sensors as they are sold; of computed torque ×5
_MORE: Final = 1.1  # times the torque, of a difference quotient
_TO_DEVIATION: Final = 1.0 / 1.96  # of a 95 % interval's half


@dataclass(frozen=True)
class Draws:
    """R random draws of a model's coefficients by drive, and of the measurement's errors by meter.

    structure, point [M, p]: the model's terms and coefficients as the M meters see them; terms: k
    errors of the measurement, none where the model was not fitted on these recordings.
    """

    coefficients: Floats  # [R, D, m]
    torque_scale: Floats  # relative error of the torque [R, D]
    structure: Structure
    point: Floats  # [M, p]
    terms: tuple[Active, ...]
    measured: Floats  # estimates of the terms [M, k]
    measurement: Floats  # [R, M, k]


def coefficient_draws(
    judge: Judge, model: EffectModel, members: Sequence[DriveGroup], count: int, seed: int
) -> Draws:
    """Draw coefficients of a fitted model, as uncertain as its recordings leave them.

    On the recordings that it was fitted on they come from the posterior, and errors of the meter
    from their intervals. On others, and with a base or a prior, all come from the stored
    intervals. members: group of each drive; count: number of draws R; 0 skips the posterior.
    """
    prepared, random = judge.prepared, np.random.default_rng(seed)
    names = prepared.signals.names
    types = tuple(group.type for group in model.groups)
    material = Material(prepared, types, settings=judge.settings.fit)
    structure = material.structure(model.structure.actives)
    free = model.structure.free
    stored = [[v for active in free for v in group.coefficients[active.name]] for group in members]
    point = np.zeros((len(prepared.names), len(structure.labels)))
    for drive, values in enumerate(stored):
        shares = [share_of(active.effect, prepared, drive) for active in free]
        share = np.concatenate([np.empty(0), *shares])
        used = share > 0.0
        columns = [
            column_of(structure, active.name, names[drive], term)
            for active in free
            for term in range(len(active.effect.terms))
        ]
        meter = 0 if prepared.whole else drive
        point[meter, np.array(columns, np.intp)[used]] = ([v.value for v in values] / share)[used]
    if not judge.refits(model) or model.base is not None or model.prior:
        drawn = np.stack([_from_intervals(own, count, random) for own in stored], axis=1)
        none = np.empty((len(point), 0))
        scale = _TORQUE_SCALE * prepared.signals.scale.gain * random.normal(size=drawn.shape[:2])
        return Draws(drawn, scale, structure, point, (), none, np.empty((count, *none.shape)))
    known = members[0].measurement
    terms = tuple(
        term
        for term in measurement_terms(judge.catalogue, shaft='shaft' in model.effects)
        if term.name in known
    )
    by_meter = members[:1] if prepared.whole else members
    errors = [[group.measurement[term.name] for term in terms] for group in by_meter]
    measured = np.array([[error.value for error in own] for own in errors])
    shifts = np.stack([_from_intervals(own, count, random) for own in errors], axis=1)
    if not count:
        drawn = np.empty((0, len(members), len(structure.labels)))
        return Draws(drawn, drawn[..., 0], structure, point, terms, measured, shifts)
    fewest = 1 if prepared.whole else min(Counter(map(id, members)).values())
    seconds = max(_SECONDS / fewest, _LEAST_SECONDS)
    part = material.at_most(seconds).prepared
    drawn, scale = posterior_draws(model, part, count, seed)
    # The posterior's coefficients are those of the true torque, a model's those of the reading.
    powers = _torque_exponents(model, part.signals, model.coefficients(members))
    drawn *= (1.0 + scale)[..., None] ** powers
    return Draws(drawn, scale, structure, point, terms, measured, shifts)


def _torque_exponents(model: EffectModel, signals: Signals, coefficients: Floats) -> Floats:
    """Exponents of the torque in the power of each coefficient [D, m]: 2 for the copper loss.

    At the same speed of the motor, and 0 of effects of the drawn power, which is as metered.
    """
    structure, rigid = model.structure, coefficients.copy()
    for active in structure.free:
        if active.effect.acts_on == 'speed':
            rigid[:, structure.columns_of(active.name)] = 0.0
    loaded = with_torque(signals, _MORE)
    usual, more = (split(structure, rigid, one).slopes for one in (signals, loaded))
    out = np.zeros_like(coefficients)
    for active in structure.free:
        for column in structure.columns_of(active.name):
            key = active.name, column
            if key in usual and 'drawn' not in active.effect.follows:
                before, after = (np.mean(np.square(own[key]), axis=0) for own in (usual, more))
                shown = before > 0.0
                out[shown, column] = 0.5 * np.log(after[shown] / before[shown]) / np.log(_MORE)
    return out


def with_torque(signals: Signals, times: Floats | float) -> Signals:
    """Signals with their torque times a factor, by drive [D] or sample [T, D] or for all."""
    torque, rate = signals.torque * times, signals.torque_rate * times
    return replace(signals, torque=torque, motor_torque=torque, torque_rate=rate)


def _from_intervals(
    values: Sequence[FittedValue], count: int, random: np.random.Generator
) -> Floats:
    middle = np.array([value.value for value in values])
    low, high = np.array([value.interval for value in values]).reshape(-1, 2).T
    normal = random.standard_normal((count, len(values))) * _TO_DEVIATION
    return middle + np.where(normal < 0.0, (middle - low) * normal, (high - middle) * normal)
