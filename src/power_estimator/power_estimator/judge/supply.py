"""Sum of all drives and the electronics against the robot's supply (Fig. 3, bottom)."""

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.judge.held_out import power_on
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import SupplyScore
from power_estimator.model import PowerModel
from power_estimator.proxies import Proxy
from power_estimator.scores import score

Floats = NDArray[np.float64]


class SupplyJudge:
    """Scores sums over all drives of a robot, and its electronics, against its supply."""

    def __init__(
        self, loaded: Loaded, prepared: Prepared, blocks: Blocks, folds: Folds, longest: float
    ) -> None:
        """longest: s by which the supply may be read late."""
        self._loaded, self._prepared = loaded, prepared
        self._folds = [
            (blocks.rows[folds.test == fold].ravel(), blocks.rows[training > 0].ravel())
            for fold, training in enumerate(folds.training)
        ]
        self._lags = round(longest * loaded.data.rate) + 1

    def score(self, model: PowerModel, residual: Floats) -> SupplyScore | None:
        """
        Score a model; None where the supply or the power of a drive is not known.

        residual: W [N, D] of the metered drives; other drives are estimated as they are. The power
        of the electronics is the mean of what is left on the other folds: beside the measured
        drives where all were, else beside the estimated ones. The lag of the supply's readings,
        which may be means of the time before their stamps, is that with which this varies least.
        """
        prepared, data = self._prepared, self._loaded.data
        known = np.isfinite(data.supply).any() and len(data.time) == len(prepared.signals.time)
        others = self._others(model) if known and not prepared.whole else None
        if others is None:
            return None
        measured = prepared.power_at(0.0)
        estimated = (measured - residual).sum(axis=1) + others[0]
        drawn = estimated if others[1] else measured.sum(axis=1)
        supplies = [prepared.reducer.reduce(shifted(data, lag)) for lag in range(self._lags)]
        spreads = [_spread(supply - drawn) for supply in supplies]
        lag = int(np.argmin(spreads))
        electronics = np.full(len(drawn), np.nan)
        for tested, trained in self._folds:
            left = (supplies[lag] - drawn)[trained]
            if np.isfinite(left).any():
                electronics[tested] = np.nanmean(left)
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

    def _others(self, model: PowerModel) -> tuple[Floats | float, int] | None:
        """Power of the drives without a meter, W [N], and their number."""
        others = self._loaded.unmetered
        if others is None:
            return 0.0, 0
        if isinstance(model, EffectModel) and not model.fitted:
            return None
        if isinstance(model, Proxy):
            model = model.fit(self._loaded.smooth)
        if len(others.data.time) != len(self._loaded.data.time):
            return None
        try:
            power = np.asarray(power_on(others, model), np.float64)
        except InputError:  # a model of other drives
            return None
        return self._prepared.reduced(power).sum(axis=1), len(others.data.names)


def shifted(data: AlignedDataset, samples: int) -> NDArray[np.float32]:
    """Return the supply [T] a number of samples later in each segment; NaN at its end."""
    result = np.full_like(data.supply, np.nan)
    for run in data.segments():
        if run.stop - run.start > samples:
            result[run.start : run.stop - samples] = data.supply[run.start + samples : run.stop]
    return result


def _spread(rest: Floats) -> float:
    return float(np.nanvar(rest)) if np.isfinite(rest).any() else np.inf
