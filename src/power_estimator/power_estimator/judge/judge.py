"""The scorer of power models."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from statistics import pstdev

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_estimator.drive_types import DriveType, assign, infer_types
from power_estimator.effects import Catalogue, builtin_catalogue
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.effects.training import LEAST_TO_FIT, Material
from power_estimator.judge.estimator import HeldOutEstimator, JudgeSettings
from power_estimator.judge.held_out import base_power, knows, power_on, power_under
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import HeldOut, JudgedModel, SupplyScore
from power_estimator.loader import load_base
from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy
from power_estimator.scores import Score, coverage, score


def supply_score(
    estimator: HeldOutEstimator, model: PowerModel, residual: Floats
) -> SupplyScore | None:
    """Score the sum over all drives of a robot plus its electronics against its supply.

    None where the supply or the power of a drive is not known. residual: W [N, D] of the metered
    drives; other drives are estimated as they are. The power of the electronics is the mean of
    what is left on the other folds: beside the measured drives where all were, else beside the
    estimated ones. The lag of the supply's readings, which may be means of the time before their
    stamps, is that with which this varies least.
    """
    loaded, prepared, blocks = estimator.recordings, estimator.prepared, estimator.blocks
    data, folds = loaded.data, estimator.folds(blocks)
    known = np.isfinite(data.supply).any() and len(data.time) == len(prepared.signals.time)
    others = _others(model, loaded, prepared) if known and not prepared.whole else None
    if others is None:
        return None
    measured = prepared.power_at(0.0)
    estimated = (measured - residual).sum(axis=1) + others[0]
    drawn = estimated if others[1] else measured.sum(axis=1)
    lags = range(round(estimator.settings.longest_lag * data.rate) + 1)
    supplies = [prepared.reducer.reduce(shifted(data, lag)) for lag in lags]
    lag = int(np.argmin([_spread(supply - drawn) for supply in supplies]))
    electronics = np.full(len(drawn), np.nan)
    for fold, training in enumerate(folds.training):
        left = (supplies[lag] - drawn)[blocks.rows[training > 0].ravel()]
        if np.isfinite(left).any():
            electronics[blocks.rows[folds.test == fold].ravel()] = np.nanmean(left)
    estimated = estimated + electronics
    if not np.isfinite(supplies[lag] - estimated).any():
        return None
    return SupplyScore(
        score(supplies[lag], estimated, REDUCED_RATE),
        supplies[lag],
        estimated,
        float(np.nanmean(electronics)),
        len(data.names) + others[1],
        lag / data.rate,
    )


def _others(
    model: PowerModel, loaded: Loaded, prepared: Prepared
) -> tuple[Floats | float, int] | None:
    """Power of the drives without a meter, W [N], and their number."""
    others = loaded.unmetered
    if others is None:
        return 0.0, 0
    if isinstance(model, EffectModel) and not model.fitted:
        return None
    if isinstance(model, Proxy):
        model = model.fit(loaded.smooth)
    if len(others.data.time) != len(loaded.data.time):
        return None
    try:
        power = np.asarray(power_on(others, model), np.float64)
    except InputError:  # a model of other drives
        return None
    return prepared.reduced(power).sum(axis=1), len(others.data.names)


def shifted(data: AlignedDataset, samples: int) -> Singles:
    """Return the supply W [T] read so many samples later in each segment; NaN at its end."""
    result = np.full_like(data.supply, np.nan)
    for run in data.segments():
        if run.stop - run.start > samples:
            result[run.start : run.stop - samples] = data.supply[run.start + samples : run.stop]
    return result


def _spread(rest: Floats) -> float:
    return float(np.nanvar(rest)) if np.isfinite(rest).any() else np.inf


class Judge:
    """Scores power models on recordings, all in the same way.

    Measured and estimated power are compared at 50 Hz after the same zero-phase low-pass at
    12.5 Hz and decimation, on rows that were measured and that all models of a comparison know.
    All is held out: docs/explanation/judging.md says how for each kind of model, and which errors
    of measurement stay with a recording. Operating points of steady recordings are independent
    rows: as they are, without delay, and dealt out to the folds.
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
        """Signals and reduced power, with the N rows and M meters of all scores."""
        return self._estimator.prepared

    def base(self, spec: str | None) -> PowerModel | None:
        """Return the base model of a spec, a proxy with its factors fitted here; None for None."""
        base = None if spec is None else load_base(spec)
        return base.fit(self.recordings.smooth) if isinstance(base, Proxy) else base

    def material(self, base: PowerModel | None = None, per: str = 'type') -> Material:
        """Return signals for a fit on a base's power; per: coefficients by `type` or `drive`."""
        under = None if base is None else base_power(self.recordings, base, base.name)
        return self._estimator.material(under, per)

    def material_under(
        self, model: EffectModel, least: float = LEAST_TO_FIT, per: str = 'type'
    ) -> Material:
        """Return signals for a fit or search beside a model, on its base's power.

        least: s of recordings; per: `type` or `drive`. InputError for recordings too short or too
        still.
        """
        return self._estimator.material(power_under(self.recordings, model), per, least)

    def refits(self, model: PowerModel) -> bool:
        """Return whether a model is refitted on all of the recordings to be judged."""
        return isinstance(model, EffectModel) and bool(knows(model, self.recordings).all())

    def score(self, model: PowerModel) -> JudgedModel:
        """Return the scores of one model; InputError where it knows no row."""
        return self.compare([model])[0]

    def compare(
        self,
        models: Sequence[PowerModel],
        names: Sequence[str] = (),
        types: Sequence[DriveType] = (),
        *,
        supply: bool = False,
    ) -> tuple[JudgedModel, ...]:
        """Return scores of models, in order, on the rows that all of them know.

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
        found = [replace(one, residual=np.where(common, one.residual, np.nan)) for one in found]
        return tuple(
            self._judged(model, name, one, kinds, supply)
            for model, name, one in zip(models, shown, found, strict=True)
        )

    @cached_property
    def _rows(self) -> Bools:
        """Mark the rows that may count [N, M]."""
        counts = np.zeros(self.prepared.measured.shape, bool)
        whole = self._estimator.blocks.rows.ravel()
        counts[whole] = self.prepared.measured[whole]
        for part in () if self.prepared.steady else self.prepared.reducer.stretches():
            counts[part][: round(self.settings.settling * REDUCED_RATE)] = False
        return counts

    def _judged(
        self,
        model: PowerModel,
        name: str,
        found: HeldOut,
        types: Sequence[DriveType],
        supply: bool,
    ) -> JudgedModel:
        measured, estimated, names = found.measured, found.estimated, self.prepared.names
        limits = None
        if isinstance(model, PowerPredictionNetwork) and not self.prepared.whole:
            limits = model.interval(estimated.astype(np.float32), names)

        def scored(columns: Sequence[int]) -> Score:
            found = self._spread(measured[:, columns], estimated[:, columns])
            if limits is None:
                return found
            return coverage(found, measured[:, columns], *(end[:, columns] for end in limits))

        there = np.flatnonzero(np.isfinite(found.residual).any(axis=0)).tolist()
        kinds = {
            kind: [c for c in own if c in there] for kind, own in assign(names, types).items()
        }
        of_model = model if isinstance(model, EffectModel) else None
        return JudgedModel(
            measured=measured,
            residual=found.residual,
            delays=found.delays,
            how=found.how,
            name=name,
            effects=of_model.effects if of_model else (),
            at_bound=of_model.at_bound if of_model else (),
            drives={names[column]: scored([column]) for column in range(len(names))},
            types={kind: scored(own) for kind, own in kinds.items() if own},
            total=self._spread(*(v[:, there].sum(axis=1) for v in (measured, estimated))),
            supply=supply_score(self._estimator, model, found.residual) if supply else None,
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
