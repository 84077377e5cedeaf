"""Draws of a model's coefficients, as uncertain as its recordings leave them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from power_estimator.drive_types import owners
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import Normal
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter, measurement_terms, robust_weights
from power_estimator.effects.fit.whole_robot import column_of, share_of
from power_estimator.effects.model_file.model import EffectModel, FittedValue
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.effects.training import Material
from power_estimator.judge.judge import Judge
from wattwalk_core.arrays import Floats

_SECONDS: Final = 120.0  # that coefficients are drawn from: longer recordings in pieces
_HIDDEN: Final = 0.1  # of the power's spread, that an effect outside the model may have
_STEADY: Final = 0.1  # of its size, that the mean of an effect has at least
_OFTEN: Final = 0.25  # chance of each effect outside the model to be there
_ROOM: Final = 2.0  # deviations of a departure from a formula, at most
_TO_DEVIATION: Final = 1.0 / 1.96  # of a 95 % interval's half


@dataclass(frozen=True)
class Draws:
    """Coefficients of a model by drive, and errors of the measurement by meter.

    structure and point [M, p] are the model's as the meters show it; terms are of the measurement,
    none where the model was not fitted on these recordings.
    """

    coefficients: Floats  # [R, D, m]
    structure: Structure
    point: Floats  # [M, p]
    terms: tuple[Active, ...]
    measured: Floats  # estimates of the terms [M, k]
    measurement: Floats  # [R, M, k]


def coefficient_draws(judge: Judge, model: EffectModel, count: int, seed: int = 0) -> Draws:
    """Draw coefficients of a fitted model on recordings.

    Of recordings that it was fitted on: fits to blocks drawn anew, each with a guess of its own at
    what the formulas leave out. A departure from each formula, and every other effect of the
    catalogue, may hide in the model, of a size that is drawn beforehand; the data are trusted as
    far as the model follows them. Of other recordings: the intervals that it was stored with.
    """
    prepared, random = judge.prepared, np.random.default_rng(seed)
    names = prepared.signals.names
    members = [group for group in owners(names, model.groups) if group is not None]
    material = Material(prepared, tuple(group.type for group in model.groups))
    structure = material.structure(model.structure.actives)
    place = _Places(model, prepared, structure)
    point = np.zeros((len(prepared.names), len(structure.labels)))
    for drive, group in enumerate(members):
        stored = [v.value for a in model.structure.free for v in group.coefficients[a.name]]
        used = place.shares[drive] > 0.0
        meter = 0 if prepared.whole else drive
        point[meter, place.columns[drive][used]] = (stored / place.shares[drive])[used]
    if not judge.refits(model) or model.base is not None:
        values = [
            [value for active in model.structure.free for value in group.coefficients[active.name]]
            for group in members
        ]
        drawn = np.stack([_from_intervals(own, count, random) for own in values], axis=1)
        none = np.empty((len(point), 0))
        return Draws(drawn, structure, point, (), none, np.empty((count, *none.shape)))
    known = members[0].measurement
    terms = tuple(
        term
        for term in measurement_terms(judge.catalogue, shaft='shaft' in model.effects)
        if term.name in known
    )
    by_meter = members[:1] if prepared.whole else members
    measured = np.array([[g.measurement[term.name].value for term in terms] for g in by_meter])
    whole = np.concatenate([point, measured], axis=1)
    made = _Refits(judge.catalogue, material.at_most(_SECONDS), structure.plus(*terms), whole)
    fits = made.drawn(members[0].delay, count, random)
    coefficients = np.stack(
        [
            fits[:, 0 if prepared.whole else drive][:, columns] * shares
            for drive, (columns, shares) in enumerate(
                zip(place.columns, place.shares, strict=True)
            )
        ],
        axis=1,
    )
    return Draws(coefficients, structure, point, terms, measured, fits[..., point.shape[1] :])


class _Places:
    """Columns of each drive's coefficients in the structure that the meters show, [D, m] each."""

    def __init__(self, model: EffectModel, prepared: Prepared, structure: Structure) -> None:
        names = prepared.signals.names
        free = model.structure.free
        self.columns = np.array(
            [
                [
                    column_of(structure, active.name, name, term)
                    for active in free
                    for term in range(len(active.effect.terms))
                ]
                for name in names
            ]
        )
        self.shares = np.array(
            [
                np.concatenate([share_of(active.effect, prepared, drive) for active in free])
                for drive in range(len(names))
            ]
        )


def _from_intervals(
    values: Sequence[FittedValue], count: int, random: np.random.Generator
) -> Floats:
    middle = np.array([value.value for value in values])
    low, high = np.array([value.interval for value in values]).T
    normal = random.standard_normal((count, len(values))) * _TO_DEVIATION
    return middle + np.where(normal < 0.0, (middle - low) * normal, (high - middle) * normal)


class _Refits:
    """Fits of a structure about a point [M, m], with what may hide in it beside."""

    def __init__(
        self, catalogue: Catalogue, material: Material, own: Structure, point: Floats
    ) -> None:
        self._fitter, self._own = material.fitter(), len(own.labels)
        beside = () if material.prepared.whole else _outside(own, catalogue, self._fitter)
        whole = own.with_discrepancies().plus(*beside)
        extra = np.zeros((len(point), len(whole.labels) - self._own))
        self._point = np.concatenate([point, extra], axis=1)
        design = self._fitter.builder.build(whole, self._point)
        wide = [a.effect.kind == 'discrepancy' for a in whole.free for _ in a.effect.terms]
        room = np.where(wide, _ROOM, 1.0)
        self._design = replace(design, lower=room * design.lower, upper=room * design.upper)

    def drawn(self, delay: float, count: int, random: np.random.Generator) -> Floats:
        """Coefficients [R, M, m] of fits to blocks drawn anew."""
        fitter, design, begin = self._fitter, self._design, self._point
        power = fitter.prepared.power_at(delay)
        normal = Normal.of(design.columns, power - design.constant, fitter.blocks)
        error = normal.errors(begin) / normal.counts
        weights = robust_weights(error, normal.valid) * normal.valid
        misfit = (error * weights).sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-9)
        trusted = np.maximum(misfit, fitter.weight) * REDUCED_RATE
        prior = self._priors(normal, power)
        outside = np.array(
            [
                column >= self._own and active.effect.kind == 'physics'
                for active in design.structure.free
                for column in design.structure.columns_of(active.name)
            ]
        )
        often = fitter.drawn(count, int(random.integers(2**31)))
        # Drives of one design depart from the formulas alike: means over drives keep the error.
        guesses = random.standard_normal((count, len(outside)))
        there = ~outside | (random.random((count, len(outside))) < _OFTEN)
        out = np.zeros((count, *begin.shape))
        for own in fitter.groups:
            gram = sum(_weighted(normal.gram[:, d], weights[:, d], often) for d in own)
            moment = sum(_weighted(normal.moment[:, d], weights[:, d], often) for d in own)
            spread = np.maximum(prior[own].mean(axis=0), 1e-12)
            ridge = trusted[own].mean() / np.square(spread)
            guess = np.where(np.isfinite(spread), spread, 0.0) * guesses
            ends = design.lower[own].mean(axis=0), design.upper[own].mean(axis=0)
            low, high = (np.where(there, end, 0.0) for end in ends)
            near = np.tile(begin[own[0]], (count, 1))
            solved = bounded_solve(
                np.asarray(gram),
                moment + ridge * guess,
                low,
                high,
                np.tile(ridge, (count, 1)),
                near,
            )
            out[:, own] = solved[:, None]
        return self._with_departures(out)

    def _with_departures(self, drawn: Floats) -> Floats:
        """Coefficients of the structure [R, M, m] from those of all columns.

        A departure from a formula is power of the same effect: its mean goes to the effect's first
        coefficient.
        """
        structure = self._design.structure
        means = np.abs(self._design.columns).mean(axis=0), self._design.columns.mean(axis=0)
        out = drawn[..., : self._own].copy()
        for active in structure.free:
            if active.effect.kind == 'discrepancy':
                (column,) = structure.columns_of(active.name)
                first = structure.columns_of(active.effect.departs_from)[0]
                steady = np.abs(means[1][:, first]) > _STEADY * means[0][:, first]
                ratio = np.where(steady, means[1][:, column] / means[1][:, first], 0.0)
                out[..., first] += ratio * drawn[..., column]
        return out

    def _priors(self, normal: Normal, power: Floats) -> Floats:
        """Spread of each column beforehand [M, m]; of what may hide, by the power it makes."""
        fitter, structure = self._fitter, self._design.structure
        prior = structure.priors(fitter.scale)
        watts = _HIDDEN * np.nanstd(np.where(fitter.prepared.measured, power, np.nan), axis=0)
        squares = np.einsum('bdii->di', normal.gram) / normal.counts.sum(axis=0)[:, None]
        of_size = watts[:, None] / np.sqrt(np.maximum(squares, 1e-24))
        for active in structure.free:
            columns = structure.columns_of(active.name)
            if columns[0] < self._own:
                continue
            departs = active.effect.kind == 'discrepancy'
            prior[:, columns] = (self._design.upper / _ROOM if departs else of_size)[:, columns]
        return prior


def _weighted(values: Floats, weights: Floats, often: Floats) -> Floats:
    """Sums [R, …] over blocks of values [B, …]."""
    return np.tensordot(often * weights, values, axes=1)


def _outside(own: Structure, catalogue: Catalogue, fitter: Fitter) -> list[Active]:
    """Effects of the catalogue outside a model, in their first shapes."""
    found = []
    for effect in catalogue.physics():
        shape = effect.shapes_of(fitter.scale)[0]
        known = not effect.per_drive or effect.name in own.names or effect.fixed is not None
        if not known and effect.usable(fitter.prepared.signals, **shape):
            found.append(Active.of(effect, shape))
    return found
