"""Intervals of a model's coefficients by the posterior of its effects."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.drive_types import assign
from power_estimator.effects import Effect
from power_estimator.effects.fit.blocks import for_each, one_thread_a_product
from power_estimator.effects.fit.design import Active, BasePower
from power_estimator.effects.fit.whole_robot import expanded, share_of
from power_estimator.effects.model_file.model import DriveGroup, EffectModel
from power_estimator.effects.signals.pieces import sparse
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.posterior.fitted_set import settle
from power_estimator.posterior.meter import MeterProblem
from power_estimator.posterior.rates import with_quiet_rates
from power_estimator.posterior.summary import MeterSummary, summarised

_LEVELS = (0.025, 0.975)


@one_thread_a_product()
def posteriors(
    model: EffectModel, prepared: Prepared, base: BasePower | None = None, seed: int = 0
) -> list[MeterSummary]:
    """Draw the coefficients of a model's effects for each meter."""
    prepared = replace(sparse(prepared), signals=with_quiet_rates(prepared.signals))
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
        return summarised(meter, free, known, settle(meter, free, free, known), seed)

    return for_each(summary, range(len(prepared.names)))


def posterior_draws(
    model: EffectModel, prepared: Prepared, count: int, seed: int = 0
) -> tuple[Floats, Floats]:
    """Draw a model's coefficients for each drive [R, D, m], and the torque's error [R, D].

    Drives that share coefficients have all of one of them, another in each draw: drives of one
    design depart from the formulas alike, and their means keep the error.
    """
    random = np.random.default_rng(seed)
    summaries = posteriors(model, prepared, seed=seed)
    drives = prepared.signals.names
    free = [active.effect for active in model.structure.actives if active.effect.fixed is None]
    picks = random.random((len(summaries), count))
    found, scales = [], []
    for d in range(len(drives)):
        meter = 0 if prepared.whole else d
        scale = summaries[meter].sensors['torque_scale']
        parts = [np.empty((len(scale), 0))]
        for effect in free:
            own = drawn_of(summaries[meter], effect, prepared, d)
            low, high = _bounds(effect, prepared.signals.scale)[:, d]
            parts.append(np.clip(own, low, high))
        chosen = (picks[meter] * len(scale)).astype(np.intp)
        found.append(np.concatenate(parts, axis=1)[chosen])
        # A sensor that reads low stands for more torque than it says.
        scales.append(1.0 / (1.0 + scale[chosen]) - 1.0)
    out, errors = np.stack(found, axis=1), np.stack(scales, axis=1)
    for alike in assign(drives, [group.type for group in model.groups]).values():
        if not prepared.whole:
            one = np.asarray(alike)[random.integers(len(alike), size=count)]
            out[:, alike] = out[np.arange(count), one][:, None]
            errors[:, alike] = errors[np.arange(count), one][:, None]
    return out, errors


def drawn_of(summary: MeterSummary, effect: Effect, prepared: Prepared, drive: int) -> Floats:
    """Drawn coefficients [s, n] of an effect of one drive, also where a robot has one meter."""
    found = summary.coefficients
    drawn = found.get(f'{effect.name}@{prepared.signals.names[drive]}', found.get(effect.name))
    assert drawn is not None
    return drawn * share_of(effect, prepared, drive)


def _bounds(effect: Effect, scale: DriveScale) -> Floats:
    """Lower and upper bounds of an effect's coefficients [2, D, n] in drives of a scale."""
    ends = np.array([(term.lower, term.upper) for term in effect.terms])
    return ends.T[:, None] * effect.factors(scale)


def with_intervals(
    model: EffectModel, prepared: Prepared, base: BasePower | None = None
) -> EffectModel:
    """The model with intervals that allow for sensors, delay and what no formula explains.

    Drives that share coefficients have their mean interval; the fitted value lies within, as do
    the ends of coefficients within the effects' bounds.
    """
    summaries = posteriors(model, prepared, base)
    drives = prepared.signals.names
    effects = {active.name: active.effect for active in model.structure.actives}

    def interval(drawn: Sequence[Floats]) -> Floats:
        """Mean interval [2, …] of draws [s, …] of each drive."""
        return np.mean([np.quantile(own, _LEVELS, axis=0) for own in drawn], axis=0)

    def widened(group: DriveGroup) -> DriveGroup:
        own = assign(drives, [group.type])[group.type.name]
        found = {d: summaries[0 if prepared.whole else d] for d in own}
        scale = DriveScale.stack([group.scale])
        coefficients = {}
        for name, values in group.coefficients.items():
            effect = effects[name]
            drawn = [drawn_of(summary, effect, prepared, d) for d, summary in found.items()]
            least, most = _bounds(effect, scale)[:, 0]
            ends = np.clip(interval(drawn), least, most)
            coefficients[name] = tuple(
                value.within(float(low), float(high))
                for value, low, high in zip(values, *ends, strict=True)
            )
        errors = {}
        for name, value in group.measurement.items():
            drawn = [one.sensors[name] for one in found.values() if name in one.sensors]
            errors[name] = value.within(*interval(drawn).tolist()) if drawn else value
        return replace(group, coefficients=coefficients, measurement=errors)

    return replace(model, groups=tuple(widened(group) for group in model.groups))
