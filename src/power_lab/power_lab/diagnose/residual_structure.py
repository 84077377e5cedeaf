"""Structure of a residual that no candidate explains: over state, other drives and time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.blocks import Blocks, for_each
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.signals.prepared import Prepared
from scipy.signal import lombscargle, periodogram
from sklearn.ensemble import HistGradientBoostingRegressor
from statsmodels.stats.diagnostic import acorr_ljungbox
from threadpoolctl import threadpool_limits

Floats = NDArray[np.float64]

STATE = ('torque', 'velocity', 'acceleration', 'position', 'torque_rate', 'voltage')
_ROWS = 6000  # a drive, for the trees
_TREES = 30
_LAGS = (1, 2, 3)
_TEST_LAGS = 10


@dataclass(frozen=True)
class ResidualStructure:
    """Held-out explained squared error of each drive, W² [D], by what explains it."""

    state: Floats  # boosted trees over the drive's own state
    cross: Floats  # other drives' power, once the state is taken out
    slow: Floats  # what lives in time alone: autocovariance of 1 s means
    total: Floats  # W² [D], mean squared residual
    period: Floats  # s [D], of the strongest line in time, NaN if none stands out
    ljung_box: Floats  # p [D], that 1 s means are independent

    @property
    def explained(self) -> Floats:
        """W² [D]."""
        return self.state + self.cross + self.slow

    @property
    def r2(self) -> float:
        """Share of the residual's square that has structure."""
        return float(self.explained.sum() / max(self.total.sum(), 1e-12))


def examine_structure(
    residual: Floats, prepared: Prepared, blocks: Blocks, folds: Folds, seed: int = 0
) -> ResidualStructure:
    """Look for structure in a held-out residual, W [N, D]."""
    state = prepared.state()
    power = prepared.power_at(0.0)
    drives = residual.shape[1]
    found = {key: np.zeros(drives) for key in ('state', 'cross', 'slow', 'total')}
    period, test = np.full(drives, np.nan), np.full(drives, np.nan)

    def fill(drive: int) -> None:
        use = np.flatnonzero(blocks.valid[:, drive])
        if len(use) < 2 * folds.count:
            return
        rows = blocks.rows[use]
        target = residual[rows, drive]
        own = range(len(prepared.signals.names)) if prepared.whole else (drive,)
        signals = [state[name][rows, d] for d in own for name in STATE]
        known = [values for values in signals if np.isfinite(values).any()]
        features = np.stack(known, axis=-1)
        trees = _trees(features, target, folds, use, seed)
        left = target - trees
        others = [d for d in range(drives) if d != drive]
        if others:
            beside = np.nan_to_num(power[rows][..., others])
            crossed = _linear(beside, left, folds, use)
            found['cross'][drive] = max(0.0, _gain(left, crossed))
            if found['cross'][drive] > 0:
                left = left - crossed
        found['state'][drive] = max(0.0, _gain(target, trees))
        means = np.nanmean(left, axis=1)
        gaps = np.diff(blocks.starts[use]) != blocks.length
        found['slow'][drive] = _slow(means, gaps)
        found['total'][drive] = float(np.nanmean(np.square(target)))
        longest = np.bincount(blocks.recording[use]).argmax()
        alone = blocks.recording[use] == longest
        period[drive] = _period(means[alone], blocks.time[use][alone])
        if len(means) > 2 * _TEST_LAGS:
            table = acorr_ljungbox(means, lags=[_TEST_LAGS])
            test[drive] = float(table['lb_pvalue'].iloc[0])

    for_each(fill, range(drives))
    return ResidualStructure(
        found['state'], found['cross'], found['slow'], found['total'], period, test
    )


def _gain(target: Floats, predicted: Floats) -> float:
    return float(np.nanmean(np.square(target)) - np.nanmean(np.square(target - predicted)))


def _trees(
    features: Floats, target: Floats, folds: Folds, use: NDArray[np.intp], seed: int
) -> Floats:
    """Held-out prediction of boosted trees, [B, L] from features [B, L, n]."""
    out = np.zeros_like(target)
    step = max(1, round(target.size / _ROWS))
    for fold in range(folds.count):
        tested = folds.test[use] == fold
        trained = folds.training[fold, use] > 0
        if not tested.any() or not trained.any():
            continue
        known = np.isfinite(target[trained])
        x, y = features[trained][known][::step], target[trained][known][::step]
        model = HistGradientBoostingRegressor(
            max_iter=_TREES,
            learning_rate=0.24,
            max_leaf_nodes=15,
            min_samples_leaf=30,
            l2_regularization=1.0,
            early_stopping=False,
            random_state=seed,
        )
        held = features[tested]
        with threadpool_limits(limits=1, user_api='openmp'):  # of this thread alone
            model.fit(x, y)
            predicted = model.predict(held.reshape(-1, held.shape[-1]))
        out[tested] = predicted.reshape(held.shape[:2])
    return out


def _linear(features: Floats, target: Floats, folds: Folds, use: NDArray[np.intp]) -> Floats:
    out = np.zeros_like(target)
    ones = np.ones((*target.shape, 1))
    columns = np.concatenate([features, ones], axis=-1)
    for fold in range(folds.count):
        tested = folds.test[use] == fold
        trained = folds.training[fold, use] > 0
        known = np.isfinite(target[trained])
        weights, *_ = np.linalg.lstsq(columns[trained][known], target[trained][known], rcond=None)
        out[tested] = columns[tested] @ weights
    return out


def _slow(means: Floats, gaps: NDArray[np.bool_]) -> float:
    """Variance of what lasts longer than a second, W²."""
    covariances = []
    for lag in _LAGS:
        together = np.array(
            [not gaps[i : i + lag].any() for i in range(len(means) - lag)], dtype=bool
        )
        if together.any():
            covariances.append(np.mean((means[:-lag] * means[lag:])[together]))
    return max(0.0, float(np.mean(covariances))) if covariances else 0.0


def _period(means: Floats, time: Floats) -> float:
    """Period of a line that stands out of the spectrum of a recording's blocks at times, s."""
    if len(means) < 40:
        return float('nan')
    step = float(np.median(np.diff(time)))
    count = round((time[-1] - time[0]) / step) // 2
    frequency = np.arange(1, count + 1) / (2 * count * step)
    if np.allclose(np.diff(time), step, rtol=0.01):
        frequency, density = periodogram(means, fs=1.0 / step, window='hann', detrend='linear')
    else:
        level = np.polynomial.Polynomial.fit(time, means, 1)(time)
        density = lombscargle(time - time[0], means - level, 2 * np.pi * frequency)
    strongest = int(np.argmax(density[2:])) + 2
    if density[strongest] < _line(len(density)) * np.median(density[2:]):
        return float('nan')
    return float(1.0 / frequency[strongest])


def _line(count: int) -> float:
    """Density of a line over the median: as rare in noise among count as 12 among 300."""
    return 12.0 + max(0.0, float(np.log2(count / 300)))
