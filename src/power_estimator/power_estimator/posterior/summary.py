"""Draws of a set of effects on one meter: coefficients, errors of sensors, and what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from wattwalk_core.arrays import Floats

from power_estimator.effects.fit.design import Active
from power_estimator.posterior.effect_columns import explained, less
from power_estimator.posterior.fitted_set import cells, signs, values_of
from power_estimator.posterior.gaussian import draws
from power_estimator.posterior.meter import FRICTIONS, MeterProblem, Point
from power_estimator.posterior.priors import MISFIT, SPIKE
from power_estimator.posterior.sensors import LOOPS, SCALES, SENSORS, spreads

_MOST_MISFIT = 20.0  # times; an effect that others take over has no size of its own
_MISFITS = 4  # draws of what no formula explains for each of the rest, for ends that stand still
_TAILS = 2.0  # degrees of freedom: where a formula misses, it seldom misses by a little
_MOST = 1e12  # of a coefficient, in SI, that nothing in the signals shows: a model file's most
_LEAST = 0.01  # of the posterior, at a size that is drawn from
_OFF = 2.0  # nats that a point may lack of its problem's solution until draws are about itself
FORMULA = 0.03
"""Part of a coefficient by which the textbook's formula is not that of the drive."""


@dataclass(frozen=True)
class MeterSummary:
    """Draws [s] from the posterior of one meter, and the size of the discrepancy beside them."""

    coefficients: Mapping[str, Floats]  # SI [s, n] by effect
    friction_at_1: Floats | None  # N·m [s]
    explains: Mapping[str, Floats]  # W rms that known effects cannot take over [s] by effect
    sensors: Mapping[str, Floats]  # in their units [s]
    costs: Mapping[str, float]  # W rms of each error of a sensor that no effect can take over
    misses_w: float  # rms that neither known effects nor the meter's noise take over
    discrepancy_w: float  # rms of that to be expected: what the recording leaves open is in it
    left: Mapping[str, float]  # W rms of the discrepancy by cause, largest first
    noise_w: float  # rms of what is left over the rows, without the discrepancy


def summarised(
    meter: MeterProblem,
    actives: Sequence[Active],
    known: Sequence[str],
    point: Point,
    seed: int = 0,
) -> MeterSummary:
    """Draw from the posterior of a set of effects at its point."""
    random = np.random.default_rng(seed)
    columns = meter.columns(actives, point)
    found, place = cells(meter, columns, known)
    signed = signs(actives)
    here = values_of(point, actives) / columns.watts
    logs = np.array([cell.at(here) for cell in found])
    weights = np.exp(logs - logsumexp(logs))
    found = [
        cell.about(here, signed) if cell.solution.evidence - log > _OFF else cell
        for cell, log in zip(found, logs, strict=True)
    ]
    taken = [
        draws(cell.normal, place, cell.sizes, cell.solution.mean, signed, random, weight)
        for cell, weight in zip(found, weights, strict=True)
        if weight >= _LEAST
    ]
    drawn = np.repeat(np.concatenate(taken), _MISFITS, axis=0)
    best = found[int(np.argmax(weights))]
    count = len(signed)
    formula = 1.0 + FORMULA * random.normal(size=(len(drawn), count))
    values = drawn[:, :count] * columns.watts * formula
    terms = [term for active in actives for term in active.effect.terms]
    of_start = np.array([term.of_recording for term in terms], dtype=bool)
    unseen = of_start & ~columns.effects[meter.used].any(axis=0)
    values = np.where(unseen, 0.0, np.clip(values, -_MOST, _MOST))
    explains = {
        one.name: explained(columns, meter.used, one, drawn[:, columns.places(one)], known)
        for one in actives
    }
    units = spreads(meter.signals)
    nuisance = drawn[:, count:]
    departing, typical, covariance = meter.departing(
        columns, best.normal, best.sizes, best.solution.mean, place
    )
    parts = (departing * typical)[meter.used]

    def beside(free: Floats) -> Floats:
        """Columns that free ones cannot take over."""
        return less(departing, free, meter.used)[meter.used]

    # Effects and the meter's gain are free: what they take, the discrepancy gives back.
    size = rms(beside(columns.beside_gain()) @ typical)
    apart = beside(columns.beside_gain(columns.places_of(known)))
    misses2 = rms(apart @ typical) ** 2
    unsure = float(np.einsum('ij,ji->', apart.T @ apart, covariance)) / len(apart)
    noise = float(np.sqrt(meter.noise.variance)) if meter.noise else 0.0
    of_meter = float(meter.prepared.noise[0])
    if meter.noise and of_meter < noise:
        # What is not smooth but lasts, such as a fan that is switched.
        misses2 += min(max(meter.noise.lasting, 0.0), noise**2 - of_meter**2)
    # What explains less than the least counts as absent.
    expected2 = misses2 + max(unsure, 0.0) + (SPIKE * meter.rms) ** 2
    apart_of = less(columns.nuisance[:, : len(SENSORS)], columns.effects, meter.used)[meter.used]
    unit_w = dict(zip(SENSORS, np.sqrt(np.mean(apart_of**2, axis=0)).tolist(), strict=True))
    costs = {
        name: unit_w[name] * abs(float(nuisance[:, i].mean())) for i, name in enumerate(SENSORS)
    }
    loops = [i for i, name in enumerate(SENSORS) if name in LOOPS]
    costs[LOOPS[0]] = rms(apart_of[:, loops] @ nuisance[:, loops].mean(axis=0))
    # What no formula explains may look like an error of a scale.
    scales = slice(len(SCALES))
    nuisance[:, scales] = less_sure(
        nuisance[:, scales],
        apart_of[:, scales].T @ apart_of[:, scales] / len(apart_of),
        (MISFIT * size) ** 2,
    )
    sensors = {name: nuisance[:, i] * units[name] for i, name in enumerate(SENSORS)}
    # Linear in the load, it frees the idle draw, but its own watts come out far too small.
    del sensors['unmetered_load']
    sensors[LOOPS[0]] = sum((sensors.pop(name) for name in LOOPS[1:]), sensors[LOOPS[0]])
    # A sensor that reads low makes the power high for its torque.
    sensors['torque_scale'] = 1.0 / np.maximum(1.0 + sensors['torque_scale'], 0.1) - 1.0
    sensors['time_offset'] = sensors['time_offset'] + float(meter.prepared.shifts[place])

    def misfit(own_w: float) -> Floats:
        """Factors [s, 1] by which what no formula explains may move a coefficient."""
        ratio = min(size / max(own_w, 1e-12), _MOST_MISFIT)
        return 1.0 + MISFIT * ratio * random.standard_t(_TAILS, size=(len(drawn), 1))

    coefficients = {}
    for active in actives:
        own = values[:, columns.places(active)]
        own = own * misfit(float(np.median(explains[active.name])))
        lower = np.array([term.lower for term in active.effect.terms])
        coefficients[active.name] = np.where(lower >= 0, np.maximum(own, 0.0), own)
    friction = None
    if columns.friction[:count].any():
        together = [float(np.median(v)) for name, v in explains.items() if name in FRICTIONS]
        friction = np.clip(drawn @ columns.friction, -_MOST, _MOST)
        friction = friction * misfit(float(np.hypot.reduce(together)))[:, 0]
    return MeterSummary(
        coefficients,
        friction,
        explains,
        sensors,
        costs,
        float(np.sqrt(misses2)),
        float(np.sqrt(expected2)),
        by_cause(parts, columns.causes),
        noise,
    )


def less_sure(drawn: Floats, gram: Floats, misfit: float) -> Floats:
    """Draws [s, k] of what has prior spreads of 1, had the power been off by a misfit besides.

    Along each axis of the draws, what the recording says counts less and the prior more. gram:
    mean products of what is drawn, W² [k, k]; misfit: W².
    """
    mean = drawn.mean(axis=0)
    values, axes = np.linalg.eigh(np.cov(drawn.T))
    before = np.clip(values, 1e-12, 1.0 - 1e-6)
    size = np.maximum(np.einsum('ji,jk,ki->i', axes, gram, axes), 1e-24)
    after = 1.0 / (1.0 + 1.0 / (before / (1.0 - before) + misfit / size))
    around = (drawn - mean) @ axes * np.sqrt(after / np.maximum(values, 1e-12))
    return np.asarray((around + mean @ axes * (1.0 - after) / (1.0 - before)) @ axes.T)


def by_cause(parts: Floats, causes: Sequence[str]) -> Mapping[str, float]:
    """W rms of parts [N, k] summed by cause, largest first."""
    sizes = {
        cause: rms(parts[:, [i for i, own in enumerate(causes) if own == cause]].sum(axis=1))
        for cause in dict.fromkeys(causes)
    }
    return dict(sorted(sizes.items(), key=lambda item: -item[1]))


def rms(values: Floats) -> float:
    """Root of the mean square, 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
