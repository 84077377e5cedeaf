"""Scores of one model on recordings."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from wattwalk_core.arrays import Bools, Floats

from power_estimator.scores import Score


@dataclass(frozen=True)
class SupplyScore:
    """Score of a robot's power at its supply, with measured and estimated traces."""

    score: Score
    measured: Floats  # W [N], brought forward by lag
    estimated: Floats  # W [N], drives and electronics
    electronics: float  # W, what the robot draws beside its drives
    drives: int  # in the sum
    lag: float  # s by which the supply's readings come late


@dataclass(frozen=True)
class HeldOut:
    """Residual of a model where it was not fitted, of N rows at 50 Hz and M meters.

    Power and estimate have passed the same zero-phase low-pass at 12.5 Hz; each recording's best
    delay between meter and joint signals is taken out.
    """

    measured: Floats  # W [N, M]
    residual: Floats  # measured − estimated, W [N, M]; NaN where the model is not known or judged
    delays: tuple[float, ...]  # s, of each recording
    how: tuple[str, ...]  # by which each recording's samples were held out

    @property
    def estimated(self) -> Floats:
        """Estimated power, W [N, M]."""
        return self.measured - self.residual


def over_meters(errors: Iterable[float | None]) -> float:
    """Return the root mean square, W, of the errors that are not None; NaN where none is left."""
    known = [error for error in errors if error is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else float('nan')


@dataclass(frozen=True)
class JudgedModel(HeldOut):
    """Scores of a model on the rows on which all models of a comparison are judged."""

    name: str = ''
    effects: tuple[str, ...] = ()
    at_bound: tuple[str, ...] = ()  # coefficients that stand at a bound
    drives: Mapping[str, Score] = field(default_factory=dict)
    types: Mapping[str, Score] = field(default_factory=dict)  # samples of all drives of a type
    total: Score | None = None  # sum over the drives
    supply: SupplyScore | None = None  # sum and electronics against the supply, where asked for

    @property
    def rows(self) -> Bools:
        """Mask of the rows that count [N, M]."""
        return np.isfinite(self.residual)

    @property
    def delay(self) -> float:
        """Delay of the power against the joint signals over all recordings, s."""
        return float(np.median(self.delays))

    @property
    def held_out(self) -> str:
        """Ways in which samples were held out, in words."""
        return ', '.join(dict.fromkeys(self.how))

    @property
    def rms_w(self) -> float:
        """Root of the mean squared error over the meters, W."""
        return over_meters(self.rmse.values())

    @property
    def rmse(self) -> dict[str, float]:
        """Held-out RMS error in W by meter, to 8 significant digits; only meters that have one."""
        known = {meter: score.json()['rmse_w'] for meter, score in self.drives.items()}
        return {meter: value for meter, value in known.items() if value is not None}
