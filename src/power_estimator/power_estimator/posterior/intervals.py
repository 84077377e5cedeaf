"""Intervals of a model's coefficients by the posterior of its effects."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.drive_types import assign
from power_estimator.effects.fit.blocks import for_each, one_thread_a_product
from power_estimator.effects.fit.design import Active, BasePower
from power_estimator.effects.fit.whole_robot import expanded, share_of
from power_estimator.effects.model_file.model import DriveGroup, EffectModel, FittedValue
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.posterior.fitted_set import settle
from power_estimator.posterior.meter import MeterProblem
from power_estimator.posterior.rates import with_quiet_rates
from power_estimator.posterior.summary import MeterSummary, summarised

_LEVELS = (0.025, 0.975)


@one_thread_a_product()
def posteriors(
    model: EffectModel, prepared: Prepared, base: BasePower | None = None
) -> list[MeterSummary]:
    """Draw the coefficients of a model's effects for each meter."""
    prepared = replace(prepared, signals=with_quiet_rates(prepared.signals))
    actives: Sequence[Active] = model.structure.actives
    if prepared.whole:
        actives = expanded(actives, prepared.signals)
    fixed = [active for active in actives if active.effect.fixed is not None]
    free = [active for active in actives if active.effect.fixed is None]
    known = [active.name for active in free]
    alone = len(prepared.names) == 1

    def summary(d: int) -> MeterSummary:
        own = prepared if alone else prepared.drive(d)
        meter = MeterProblem(own, fixed, base if base is None or alone else base.drive(d))
        return summarised(meter, free, known, settle(meter, free, free, known))

    return for_each(summary, range(len(prepared.names)))


def posterior_draws(
    model: EffectModel, prepared: Prepared, count: int, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Draw a model's coefficients for each drive [R, D, m], and the torque's error [R, D].

    Drives that share coefficients have those of one of them, another in each draw: drives of one
    design depart from the formulas alike, and their means keep the error.
    """
    summaries = posteriors(model, prepared)
    drives = prepared.signals.names
    free = [active.effect for active in model.structure.actives if active.effect.fixed is None]
    picks = random.random((len(summaries), count))
    found, scales = [], []
    for d, drive in enumerate(drives):
        meter = 0 if prepared.whole else d
        own = summaries[meter].coefficients
        parts = [
            own.get(f'{effect.name}@{drive}', own.get(effect.name, np.empty(0)))
            * share_of(effect, prepared, d)
            for effect in free
        ]
        chosen = (picks[meter] * len(parts[0])).astype(np.intp)
        found.append(np.concatenate(parts, axis=1)[chosen])
        # A sensor that reads low stands for more torque than it says.
        scales.append(1.0 / (1.0 + summaries[meter].sensors['torque_scale'][chosen]) - 1.0)
    out = np.stack(found, axis=1)
    for alike in assign(drives, [group.type for group in model.groups]).values():
        if not prepared.whole:
            one = np.asarray(alike)[random.integers(len(alike), size=count)]
            out[:, alike] = out[np.arange(count), one][:, None]
    return out, np.stack(scales, axis=1)


def with_intervals(
    model: EffectModel, prepared: Prepared, base: BasePower | None = None
) -> EffectModel:
    """The model with intervals that allow for sensors, delay and what no formula explains.

    Drives that share coefficients have their mean interval; the fitted value lies within, as do
    the ends within the effects' bounds. Intervals of measurement terms stay as they are.
    """
    summaries = posteriors(model, prepared, base)
    drives = prepared.signals.names
    effects = {active.name: active.effect for active in model.structure.actives}

    def interval(name: str, own: Sequence[int]) -> Floats:
        ends = []
        for d in own:
            found = summaries[0 if prepared.whole else d].coefficients
            drawn = found.get(f'{name}@{drives[d]}', found.get(name))
            assert drawn is not None
            share = share_of(effects[name], prepared, d)
            ends.append(np.quantile(drawn * share, _LEVELS, axis=0))
        return np.mean(ends, axis=0)  # [2, n]

    def widened(group: DriveGroup) -> DriveGroup:
        own = assign(drives, [group.type])[group.type.name]
        scale = DriveScale.stack([group.scale])
        coefficients = {}
        for name, values in group.coefficients.items():
            effect = effects[name]
            most = effect.factors(scale)[0] * [term.upper for term in effect.terms]
            least = effect.factors(scale)[0] * [term.lower for term in effect.terms]
            ends = np.clip(interval(name, own), least, most)
            coefficients[name] = tuple(
                _around(value, float(low), float(high))
                for value, low, high in zip(values, *ends, strict=True)
            )
        return replace(group, coefficients=coefficients)

    return replace(model, groups=tuple(widened(group) for group in model.groups))


def _around(value: FittedValue, low: float, high: float) -> FittedValue:
    return replace(value, interval=(min(low, value.value), max(high, value.value)))
