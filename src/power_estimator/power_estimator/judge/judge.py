"""The scorer of power models."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from statistics import pstdev

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from power_estimator.drive_types import DriveType, assign, infer_types
from power_estimator.effects import Catalogue, builtin_catalogue
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.effects.training import Material
from power_estimator.judge.estimator import HeldOutEstimator
from power_estimator.judge.held_out import base_power, fitted_base, knows
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import HeldOut, JudgedModel
from power_estimator.judge.settings import JudgeSettings
from power_estimator.judge.supply import SupplyJudge
from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.scores import Score, coverage, score

Floats = NDArray[np.float64]


class Judge:
    """
    Scores power models on recordings, all in the same way.

    Measured and estimated power are compared at 50 Hz after the same zero-phase low-pass at
    12.5 Hz and decimation. Effect models form their products at 400 Hz from signals as they were
    measured; networks and proxies get the smoothed 200 Hz signals that they are made for, and
    their power is brought to the same grid.

    Rows count that were measured, in whole seconds and past the first 0.2 s of a stretch, and
    that the model knows; of several models, those that all know.

    All is held out. A recording that a model was not fitted on, by its fingerprint, is predicted
    as it is, less the best delay of the meter against the joint signals; errors of measurement
    that were fitted elsewhere (gain, offset, drift, bias, lag) stay there. On recordings that a
    model of effects was fitted on it is refitted fold by fold: pieces of 10 s, a second apart,
    with errors of measurement of each recording's own. Proxies are scaled on the other folds, also
    below effects that are refitted; a network counts on its test part. Operating points of steady
    recordings are independent rows: as they are, without delay, and dealt out to the folds.
    """

    def __init__(
        self,
        recordings: Loaded,
        catalogue: Catalogue | None = None,
        settings: JudgeSettings | None = None,
    ) -> None:
        self.recordings = recordings
        self.catalogue = catalogue or builtin_catalogue()
        self.settings = settings or JudgeSettings()
        self._estimator = HeldOutEstimator(recordings, self.catalogue, self.settings)

    @property
    def prepared(self) -> Prepared:
        """Signals and reduced power, whose N rows and M meters all scores are of."""
        return self._estimator.prepared

    def base(self, spec: str | None) -> PowerModel | None:
        """Return the base of effects that are fitted here, a proxy with its factors."""
        return None if spec is None else fitted_base(self.recordings, spec)

    def material(self, base: PowerModel | None = None, per: str = 'type') -> Material:
        """Signals for a fit of effects, on the power of a base model."""
        power = None if base is None else base_power(self.recordings, base, base.name).power
        return self._estimator.material(power, per)

    def refits(self, model: PowerModel) -> bool:
        """Return whether a model is refitted on all of the recordings to be judged."""
        return isinstance(model, EffectModel) and bool(knows(model, self.recordings).all())

    def score(self, model: PowerModel) -> JudgedModel:
        """Score one model; InputError where it knows no row."""
        return self.compare([model])[0]

    def compare(
        self,
        models: Sequence[PowerModel],
        names: Sequence[str] = (),
        types: Sequence[DriveType] = (),
        *,
        supply: bool = False,
    ) -> tuple[JudgedModel, ...]:
        """
        Score models on the rows that all of them know.

        names: as they are shown; types: of drives that are scored together; supply: against the
        power of the whole robot, too. InputError where no row is left.
        """
        shown = list(names) or [model.name for model in models]
        found = [
            self._estimator.estimate(model, name)
            for model, name in zip(models, shown, strict=True)
        ]
        common = self._rows.copy()
        for one in found:
            common &= np.isfinite(one.residual)
        if not common.any():
            raise InputError(
                f'{", ".join(self.prepared.recordings)}: no sample is left that '
                f'{" and ".join(shown)} may be judged on'
            )
        kinds = tuple(types) or infer_types(self.prepared.names)
        return tuple(
            self._judged(model, name, one, common, kinds, supply)
            for model, name, one in zip(models, shown, found, strict=True)
        )

    @cached_property
    def _rows(self) -> NDArray[np.bool_]:
        """Mark the rows that may count [N, M]."""
        counts = np.zeros(self.prepared.measured.shape, bool)
        whole = self._estimator.blocks.rows.ravel()
        counts[whole] = self.prepared.measured[whole]
        for part in () if self.prepared.steady else self.prepared.reducer.stretches():
            counts[part][: round(self.settings.settling * REDUCED_RATE)] = False
        return counts

    @cached_property
    def _supply(self) -> SupplyJudge:
        blocks = self._estimator.blocks
        folds, longest = self._estimator.folds(blocks), self.settings.longest_lag
        return SupplyJudge(self.recordings, self.prepared, blocks, folds, longest)

    def _judged(
        self,
        model: PowerModel,
        name: str,
        found: HeldOut,
        common: NDArray[np.bool_],
        types: Sequence[DriveType],
        supply: bool,
    ) -> JudgedModel:
        measured = found.measured
        residual = np.where(common, found.residual, np.nan)
        estimated, names = measured - residual, self.prepared.names
        limits = None
        if isinstance(model, PowerPredictionNetwork) and not self.prepared.whole:
            limits = model.interval(estimated.astype(np.float32), names)

        def scored(columns: Sequence[int]) -> Score:
            found = self._spread(measured[:, columns], estimated[:, columns])
            if limits is None:
                return found
            return coverage(found, measured[:, columns], *(end[:, columns] for end in limits))

        there = [column for column in range(len(names)) if common[:, column].any()]
        kinds = {
            kind: [c for c in own if c in there] for kind, own in assign(names, types).items()
        }
        of_model = model if isinstance(model, EffectModel) else None
        return JudgedModel(
            measured,
            residual,
            found.delays,
            found.how,
            name=name,
            effects=of_model.effects if of_model else (),
            at_bound=of_model.at_bound if of_model else (),
            drives={names[column]: scored([column]) for column in range(len(names))},
            types={kind: scored(own) for kind, own in kinds.items() if own},
            total=self._spread(*(v[:, there].sum(axis=1) for v in (measured, estimated))),
            supply=self._supply.score(model, residual) if supply else None,
        )

    def _spread(self, measured: Floats, estimated: Floats) -> Score:
        """Score power and estimate [N, …], with the spread of R² over stretches."""
        found = score(measured, estimated, REDUCED_RATE)
        if self.prepared.steady:
            return replace(found, energy_error=np.nan, error_j=np.nan, energy_j=np.nan)
        rows = np.isfinite(estimated).reshape(len(estimated), -1).any(axis=1)
        used = np.flatnonzero(rows)
        if len(used) < self.settings.spread * self.settings.shortest * REDUCED_RATE:
            return found
        r2s = [
            score(measured[own], estimated[own], REDUCED_RATE).r2
            for own in np.array_split(used, self.settings.spread)
        ]
        return replace(found, r2_std=pstdev(r2s)) if np.isfinite(r2s).all() else found
