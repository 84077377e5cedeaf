"""Floors below which nothing is named, and effects that no name fits."""

import numpy as np
from power_estimator.effects.fit.fitter import Fit, Fitter
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.judge.evidence import Evidence
from wattwalk_core.arrays import Floats

_OF_NOISE = 0.5  # of the meter's noise: nothing smaller is told
_ALONE = 2.0
"""
Times the floor, on one drive alone.

Decides for robots of five drives and more: with n drives one alone reaches the pooled floor at √n.
"""


def floors(fitter: Fitter, least: float, share: float) -> Floats:
    """Least rms power to judge, W [D]: `least`, half the meter noise, or `share` of the power."""
    prepared = fitter.prepared
    power = prepared.power_at(0.0)
    rms = np.sqrt(np.nanmean(np.square(power), axis=0))
    half = _OF_NOISE * np.nan_to_num(prepared.noise)
    least_ = least * np.minimum(fitter.scale.power, 1.0)
    return np.maximum(np.maximum(least_, half), share * rms)


def unseen(prepared: Prepared, fit: Fit) -> Floats:
    """Error that sampling of the joint signals may cause, W rms [D]."""
    columns = fit.structure.columns_of('copper_loss')
    drives = len(prepared.signals.names)
    copper = fit.coefficients[:, columns[0]] if columns else np.zeros(drives)
    return prepared.unseen(copper)


def above_floor(gain: Floats, floor: Floats) -> bool:
    """Return whether gains, W² [D], reach floors, W [D], pooled, or twice that on one drive."""
    ratio = np.maximum(gain, 0.0) / np.square(floor)
    return bool(ratio.mean() >= 1.0 or ratio.max() >= _ALONE**2)


def beyond_physics(evidence: Evidence) -> list[str]:
    """Names of added effects with a coefficient at a bound that no real drive reaches."""
    fit = evidence.fit

    def beyond(drive: int, column: int) -> bool:
        far = 'lower' if fit.coefficients[drive, column] < 0 else 'upper'
        return fit.at_bound(drive, column) == far

    return [
        active.name
        for active in evidence.actives
        for term, column in zip(
            active.effect.terms, fit.structure.columns_of(active.name), strict=True
        )
        if not term.attained and any(beyond(d, column) for d in range(len(fit.coefficients)))
    ]
