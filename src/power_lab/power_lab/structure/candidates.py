"""Candidates: the catalogue's effects that a model lacks, in all their shapes."""

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Catalogue, Effect, Signals, Term
from power_estimator.effects.fit.candidate_screener import CandidateScreener, Screened, Trial
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.effects.fit.whole_robot import shared_by_size
from power_estimator.effects.library.measurement import TorqueBias

Floats = NDArray[np.float64]


class Freed(Effect):
    """An effect whose coefficient physics fixes, free enough to compete for a place."""

    def __init__(self, of: Effect) -> None:
        self._of = of
        self.name = of.name  # type: ignore[misc]
        self.physics, self.formula = of.physics, of.formula  # type: ignore[misc]
        self.acts_on, self.follows = of.acts_on, of.follows  # type: ignore[misc]
        self.per_drive = of.per_drive  # type: ignore[misc]
        self.excitation = of.excitation  # type: ignore[misc]
        self.terms = (Term(of.terms[0].symbol, of.terms[0].unit, 0.0, 1.5),)  # type: ignore[misc]

    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """As the effect's own."""
        return self._of.regressors(signals, **shape)


class ConstantTorque(TorqueBias):
    """
    A torque on the motor that never changes its sign, of any size.

    A zero error of the torque sensor larger than usual, or friction in one direction only (half of
    that is a constant torque): no recording of power tells them apart. It competes with the
    effects so that none is named for what it can imitate, and takes the place of the bias that
    every model has.
    """

    terms = (Term('b', 'N·m', -80.0, 80.0),)


CONSTANT_TORQUE = ConstantTorque.name
"""In the effects that a diagnosis asks for, it is the constant torque and no name."""


def candidates(fitter: Fitter, base: Structure, catalogue: Catalogue) -> list[Active]:
    """Physical effects that the base has not, in every usable shape, and a constant torque."""
    signals, whole = fitter.prepared.signals, fitter.prepared.whole
    known = {name.partition('@')[0] for name in base.names}
    effects = [
        effect if effect.fixed is None else Freed(effect)
        for effect in catalogue.physics()
        if effect.name not in known and (effect.fixed is None or fitter.builder.base is None)
    ]
    constant = [Active.of(ConstantTorque())] if CONSTANT_TORQUE in known else []
    return [
        Active.of(shared_by_size(effect, signals) if whole else effect, shape)
        for effect in effects
        for shape in effect.shapes_of(signals.scale)
        if effect.usable(signals, **shape)
    ] + constant


def best_shapes(screener: CandidateScreener) -> dict[str, Screened]:
    """For each effect the screening of its best shape."""
    best: dict[str, Trial] = {}
    for trial in screener.fitted([[active] for active in screener.candidates]):
        name = trial.actives[0].name
        if name not in best or trial.error < best[name].error:
            best[name] = trial
    return dict(zip(best, screener.tested(list(best.values())), strict=True))
