"""Hierarchical shrinkage of estimates: robot, drive, recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from statsmodels.stats.meta_analysis import combine_effects
from wattwalk_core.arrays import Floats

from power_fleet.track.change_test import ChangeModel

_LEAST_DRIVES = 3


@dataclass(frozen=True)
class Points:
    """Estimates of M recordings, shrunk to the drive's level and that to the robot's [M, m]."""

    values: Floats
    errors: Floats  # standard errors
    level: Floats  # [m], of the drive before its changes
    level_errors: Floats  # [m]


@dataclass(frozen=True)
class Common:
    """Mean level of a coefficient over the drives of a robot."""

    value: float
    error: float
    spread: float  # standard deviation of the drives about it


def common_levels(models: Sequence[ChangeModel]) -> dict[tuple[str, int], Common]:
    """Mean levels by (effect, term) over drives, by a random-effects meta-analysis.

    A large spread leaves each drive its own level. {} for fewer than three drives.
    """
    if len(models) < _LEAST_DRIVES:
        return {}
    levels = [np.stack(model.levels) for model in models]
    out = {}
    for label in models[0].history.labels:
        if any(label not in model.history.labels for model in models):
            continue
        places = [model.history.labels.index(label) for model in models]
        own = [level[:, i] for level, i in zip(levels, places, strict=True)]
        values, errors = np.transpose(own)
        with np.errstate(all='ignore'):
            found = combine_effects(values, np.maximum(errors, 1e-12) ** 2, method_re='dl')
        # The estimate of its square may be negative, or none where all values are the same.
        spread = float(np.sqrt(max(np.nan_to_num(found.tau2), 0.0)))
        error = float(np.sqrt(1.0 / np.sum(1.0 / (errors**2 + spread**2 + 1e-24))))
        mean = float(found.mean_effect_re)
        if not np.isfinite(mean):  # the drives agree to the last digit, as a common delay does
            mean, spread = float(values.mean()), 0.0
        out[label] = Common(mean, error, spread)
    return out


def shrunk(model: ChangeModel, common: Mapping[tuple[str, int], Common]) -> Points:
    """Posterior estimates of a drive's recordings; common: as of `common_levels`.

    A recording that does not excite a coefficient takes it from the drive's other recordings, and
    a drive that never does from the other drives.
    """
    scale, history = model.scale, model.history
    own_level, own_error = model.levels
    level, error = own_level.copy(), own_error.copy()
    for column, label in enumerate(history.labels):
        if label in common:
            own, other = error[column] ** 2, common[label].spread ** 2 + common[label].error ** 2
            weight = other / max(own + other, 1e-300)
            level[column] = weight * level[column] + (1 - weight) * common[label].value
            error[column] = np.sqrt(weight) * error[column]
    mean = model.values - model.residual
    mean = mean + (level - own_level) / scale
    own = history.covariance / (scale[:, None] * scale)
    values, vectors = np.linalg.eigh(model.scatter - np.median(own, axis=0))
    between = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    gain = between @ np.linalg.inv(own + between)
    posterior = mean + np.einsum('tmn,tn->tm', gain, model.values - mean)
    covariance = between - gain @ between
    errors = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    return Points(posterior * scale, errors * scale, level, error)
