"""Draws of a set of effects on one meter: coefficients, errors of sensors, and what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from power_estimator.effects.fit.design import Active
from power_estimator.posterior.gaussian import draws
from power_estimator.posterior.meter import FRICTIONS, EffectColumns, MeterProblem, Point, apart
from power_estimator.posterior.priors import MISFIT
from power_estimator.posterior.search import cells, signs
from power_estimator.posterior.sensors import SENSORS, spreads

Floats = NDArray[np.float64]
_MOST_MISFIT = 20.0  # times; an effect that others take over has no size of its own
_TAILS = 4.0  # degrees of freedom: a misfit is seldom normal
_LEAST = 0.01  # of the posterior, at a size that is drawn from
FORMULA = 0.03
"""Part of a coefficient by which the textbook's formula is not that of the drive."""


@dataclass(frozen=True)
class MeterSummary:
    """Draws [s] from the posterior of one meter, and the size of the discrepancy beside them."""

    coefficients: Mapping[str, Floats]  # SI [s, n] by effect
    friction_at_1: Floats | None  # N·m [s]
    explains: Mapping[str, Floats]  # W rms that known effects cannot take over [s] by effect
    sensors: Mapping[str, Floats]  # in their units [s]
    costs: Mapping[str, float]  # W rms of each error of a sensor
    discrepancy_w: float  # rms


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
    logs = np.array([cell.solution.evidence for cell in found])
    weights = np.exp(logs - logsumexp(logs))
    signed = signs(actives)
    taken = []
    for cell, weight in zip(found, weights, strict=True):
        if weight >= _LEAST:
            begun = cell.solution.mean
            own = draws(cell.normal, place, cell.sizes, begun, signed, random)
            taken.append(own[: max(1, round(weight * len(own)))])
    drawn = np.concatenate(taken)
    best = found[int(np.argmax(weights))]
    count = len(signed)
    formula = 1.0 + FORMULA * random.normal(size=(len(drawn), count))
    values = drawn[:, :count] * columns.watts * formula
    explains = _explains(columns, meter, drawn[:, :count], known)
    units = spreads(meter.signals)
    nuisance = drawn[:, count:]
    mean = best.solution.mean
    there = columns.smooth.shape[1] - columns.absent
    smooth = meter.weighed(columns).smooth(best.normal, mean, place)
    discrepancy = columns.smooth[:, :there] @ smooth[:there]
    departures = slice(len(SENSORS), None)
    discrepancy += columns.nuisance[:, departures] @ mean[count:][departures]
    size = rms(discrepancy[meter.used])
    sensors = {name: nuisance[:, i] * units[name] for i, name in enumerate(SENSORS)}
    # A sensor that reads low makes the power high for its torque.
    sensors['torque_scale'] = 1.0 / np.maximum(1.0 + sensors['torque_scale'], 0.1) - 1.0
    sensors['time_offset'] = sensors['time_offset'] + float(meter.prepared.shifts[place])
    costs = {
        name: rms(columns.nuisance[meter.used, i]) * abs(float(nuisance[:, i].mean()))
        for i, name in enumerate(SENSORS)
    }

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
        friction = (drawn @ columns.friction) * misfit(float(np.hypot.reduce(together)))[:, 0]
    return MeterSummary(
        coefficients,
        friction,
        explains,
        sensors,
        costs,
        rms(discrepancy),
    )


def _explains(
    columns: EffectColumns, meter: MeterProblem, drawn: Floats, known: Sequence[str]
) -> Mapping[str, Floats]:
    """W rms [s] of each effect that known effects and a meter's scale cannot take over."""
    out = {}
    for active in columns.actives:
        places = columns.places(active)
        own = apart(columns, meter.used, places, known)[meter.used]
        gram = own.T @ own / len(own)
        weights = drawn[:, places]
        out[active.name] = np.sqrt(np.maximum(np.einsum('si,ij,sj->s', weights, gram, weights), 0))
    return out


def rms(values: Floats) -> float:
    """Root of the mean square, 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
