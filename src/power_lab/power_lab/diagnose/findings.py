"""Findings of a diagnosis: candidates, what is left, and the verdict that follows."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.design import Active
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.judge.evidence import Evidence
from power_estimator.posterior.judged import JudgedEffects
from power_estimator.posterior.priors import NAMED
from wattwalk_core.arrays import Floats

Verdict = Literal['named', 'ambiguous', 'none_of_the_above', 'no_evidence']
UNLIKELY = 0.05
"""Probability below which an effect is no candidate of a set that may be missing."""
_MUCH = 0.1  # of the held-out error
_LIKELY = 0.5  # of all effects of such a set together
_OF_NOISE = 5.0  # rms of a residual that a circuit without missing effects stays below
LEAST_FALL = 0.01  # of the held-out error, below which an effect is not borne out
_OF_BEST = 0.1  # of the largest fall of the error


def short(value: float) -> float:
    """Round to five significant digits, for JSON."""
    return float(f'{value:.5g}')


def rounded_down(probability: float, digits: int) -> float:
    """Round a probability down to so many digits, so that rounding lifts it over no threshold."""
    return math.floor(probability * 10**digits + 1e-9) / 10**digits


def certainty(probability: float) -> str:
    """Format a probability with two digits, rounded down; `< 0.01` below that."""
    down = rounded_down(probability, 2)
    return f'{down:.2f}' if down else '< 0.01'


@dataclass(frozen=True)
class Candidate:
    """An effect that the model may lack."""

    active: Active
    probability: float  # that it is missing
    explains: tuple[float, float, float]  # W rms that no known effect can, at 2.5, 50, 97.5 %
    share: float  # of what the model misses, by the square, that goes when it is added alone
    family: str  # effects that explain the same here, joined by slashes
    delta_r2: float  # gain on held-out data when it is added alone
    delta_rmse_w: float
    symbol: str
    unit: str
    coefficient: float
    interval: tuple[float, float]
    drive: str  # the one that coefficient and interval are of
    coefficients: dict[str, list[float]]  # by drive
    explained: NDArray[np.float32]  # W [N, M], by which it changes the residual when added
    owners_terms: str = ''  # the coefficient as a data sheet has it, '' where there is no such

    @property
    def name(self) -> str:
        """Name in the catalogue."""
        return self.active.name

    @property
    def in_words(self) -> str:
        """Coefficient with its interval as text, in terms of a data sheet where there are such."""
        unit = '' if self.unit == '1' else f' {self.unit}'
        low, high = self.interval
        own = f'{self.symbol} = {self.coefficient:.3g}{unit} ({low:.3g} … {high:.3g})'
        return (self.owners_terms or own) + (', at its bound' if low == high else '')

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `diagnose --json` writes them."""
        low, middle, high = self.explains
        return {
            'name': self.name,
            'family': self.family,
            'probability': rounded_down(self.probability, 4),
            'explains_w': short(middle),
            'explains_interval': [short(low), short(high)],
            'share': short(self.share),
            'delta_r2': short(self.delta_r2),
            'delta_rmse_w': short(self.delta_rmse_w),
            'coefficient': short(self.coefficient),
            'interval': [short(bound) for bound in self.interval],
            'unit': self.unit,
            'symbol': self.symbol,
            'drive': self.drive,
            'owners_terms': self.owners_terms,
            'shape': self.active.parameters,
            'coefficients': self.coefficients,
        }


@dataclass(frozen=True)
class Residual:
    """Error of M meters that stays with the named effects, beyond noise and sampling, W² [M]."""

    left: Floats
    missed: Floats  # the same without what is named
    by_chance: Floats  # of the meter's noise, and of what passes between two samples
    power: Floats
    noise: Floats  # of the meter, W [M]; NaN where it is not known
    over: tuple[str, ...]  # causes that it follows, the largest first
    names: tuple[str, ...]  # of the meters
    counts: bool  # whether it is so much of the power that an effect may be in it

    def within(self, before: Mapping[str, float], after: Mapping[str, float]) -> 'Residual':
        """Residual, limited to the judged errors, W by meter, without and with the effects."""

        def less(own: Floats, errors: Mapping[str, float]) -> Floats:
            judged = np.square([errors.get(name, np.inf) for name in self.names])
            return np.minimum(own, np.maximum(judged - self.by_chance, 0.0))

        return replace(self, left=less(self.left, after), missed=less(self.missed, before))

    @property
    def rms_w(self) -> float:
        """Rms over the meters, W."""
        return float(np.sqrt(self.left.mean()))

    @property
    def of_power(self) -> float:
        """Ratio of the rms residual to the rms power."""
        return float(np.sqrt(self.left.sum() / max(self.power.sum(), 1e-12)))

    @property
    def noise_w(self) -> float:
        """Rms noise of the meters whose noise is known, W; NaN without any."""
        known = self.noise[np.isfinite(self.noise)]
        return float(np.sqrt(np.mean(np.square(known)))) if known.size else float('nan')

    @property
    def stands_out(self) -> bool:
        """Return whether it is much of the power (`counts`), or above five times the noise."""
        return self.counts or self.rms_w > _OF_NOISE * self.noise_w

    @property
    def most(self) -> bool:
        """Return whether the named effects leave over half, by rms, of what the model misses."""
        return bool(self.left.sum() > 0.25 * self.missed.sum())

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `diagnose --json` writes them."""
        return {
            'rms_w': short(self.rms_w),
            'share': short(min(1.0, self.left.sum() / max(self.missed.sum(), 1e-12))),
            'over': list(self.over),
            'noise_w': short(self.noise_w) if np.isfinite(self.noise_w) else None,
            'drives': {
                name: short(watts)
                for name, watts in zip(self.names, np.sqrt(self.left).tolist(), strict=True)
            },
        }


@dataclass(frozen=True)
class Diagnosis:
    """Findings of the posterior, and held-out errors without and with what it names."""

    found: JudgedEffects
    prepared: Prepared
    apart: Mapping[str, Floats]  # errors of the meter in each recording less the mean [M, R]
    base: Evidence
    best: Evidence
    candidates: tuple[Candidate, ...]  # the most probable first
    left: Residual  # what stays with the names

    @property
    def residual(self) -> Residual | None:
        """Residual; None where it is too small to be an effect."""
        return self.left if self.left.counts else None

    @property
    def verdict(self) -> Verdict:
        """Verdict; `named` as soon as one effect is certain, though more may be missing."""
        if self.found.named:
            return 'named'
        if self.effects:
            return 'ambiguous'
        return 'none_of_the_above' if self.residual else 'no_evidence'

    @cached_property
    def actives(self) -> tuple[Active, ...]:
        """Effects that are certainly missing, those that explain most first."""
        watts = {one.name: one.explains[1] for one in self.candidates}
        return tuple(sorted(self.found.named, key=lambda active: -watts[active.name]))

    @cached_property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that are certain, or of a set of which one is certainly missing.

        In such a set are the undecided effects that clearly lower the held-out error; all
        undecided ones where none does and no residual stays.
        """
        if self.found.named:
            return tuple(active.name for active in self.actives)
        most = max((one.delta_rmse_w for one in self.open), default=0.0)
        least = max(_OF_BEST * most, LEAST_FALL * float(np.sqrt(self.base.mean_mse.mean())))
        shown = [one for one in self.open if one.delta_rmse_w >= least]
        if not shown and self.residual is None:
            shown = list(self.open)
        likely = sum(one.probability for one in shown)
        sure = self.found.any_missing >= NAMED and likely >= _LIKELY
        return tuple(one.name for one in shown) if sure else ()

    @property
    def uncertain(self) -> Candidate | None:
        """Effect that lowers the held-out error most, by 10 % or more, where none is named.

        None unless the verdict is `none_of_the_above`.
        """
        if self.verdict != 'none_of_the_above':
            return None
        error = float(np.sqrt(self.base.mean_mse.mean()))
        best = max(self.candidates, key=lambda one: one.delta_rmse_w, default=None)
        return best if best is not None and best.delta_rmse_w >= _MUCH * error else None

    @cached_property
    def open(self) -> tuple[Candidate, ...]:
        """Candidates that these recordings cannot decide on, the most probable first."""
        return tuple(one for one in self.candidates if UNLIKELY <= one.probability < NAMED)
