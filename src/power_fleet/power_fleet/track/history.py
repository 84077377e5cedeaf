"""Estimates of one drive over its recordings, with what the recordings had in common or not."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from wattwalk_core.arrays import Floats

from power_fleet.track.recording_fit import RecordingFit

TEMPERATURE_CURVE = 'temperature, squared'
_COMMON = 0.98  # correlation above which one covariate says what another says
_LEAST_VARIATION = 1e-3  # of a covariate's mean
_PER_COVARIATE = 5  # recordings
_LEAST_OF_KIND = 3  # recordings of a motion


@dataclass(frozen=True)
class DriveHistory:
    """m estimates of one drive in M recordings, in the order of time.

    Covariates have mean 0 and standard deviation 1.
    """

    drive: str  # its name, behind the robot's where there are several robots
    joint: str  # name of the drive alone
    recordings: tuple[str, ...]
    time: Floats  # s [M]
    labels: tuple[tuple[str, int], ...]  # (effect, term) of each estimate
    values: Floats  # [M, m]
    covariance: Floats  # [M, m, m]
    responses: Mapping[str, Floats]  # [m] each, of the estimates to a unit of each hypothesis
    watts: Floats  # [m], mean W per unit
    rms: Floats  # [m], rms W per unit
    power: float  # W rms, of the drive
    mean_power: float  # W
    errors: Floats  # W rms that the fit leaves [M]
    covariates: Floats  # [M, K]
    names: tuple[str, ...]  # of the covariates

    def with_covariates(self, names: Sequence[str]) -> 'DriveHistory':
        """Return the history with the named covariates only; ValueError for an unknown one."""
        columns = [self.names.index(name) for name in names]
        return replace(self, covariates=self.covariates[:, columns], names=tuple(names))


def histories(fits: Sequence[RecordingFit]) -> list[DriveHistory]:
    """Histories by robot and drive.

    A drive goes by its name, behind the robot's where there are several robots.
    """
    ordered = sorted(fits, key=lambda fit: fit.occasion.time)
    robots = list(dict.fromkeys(fit.occasion.robot for fit in ordered))
    out = []
    for robot in robots:
        own = [fit for fit in ordered if fit.occasion.robot == robot]
        for drive in dict.fromkeys(name for fit in own for name in fit.drives):
            label = f'{robot} {drive}' if len(robots) > 1 else drive
            out.append(_history(label, drive, [fit for fit in own if drive in fit.drives]))
    return out


def _history(label: str, drive: str, fits: Sequence[RecordingFit]) -> DriveHistory:
    labels = fits[0].labels
    fits = [fit for fit in fits if fit.labels == labels]
    pairs = [(fit, fit.drives.index(drive)) for fit in fits]
    covariates = _covariates(pairs)
    names = _chosen(covariates, len(fits))
    columns = [covariates[name][:, None] for name in names]
    matrix = np.concatenate([np.empty((len(fits), 0)), *columns], axis=1)
    return DriveHistory(
        drive=label,
        joint=drive,
        recordings=tuple(fit.occasion.name for fit in fits),
        time=np.array([fit.occasion.time for fit in fits]),
        labels=labels,
        values=np.stack([fit.values[d] for fit, d in pairs]),
        covariance=np.stack([fit.covariance[d] for fit, d in pairs]),
        responses={
            name: np.median([fit.responses[name][d] for fit, d in pairs], axis=0)
            for name in fits[0].responses
        },
        watts=np.median([fit.watts[d] for fit, d in pairs], axis=0),
        rms=np.median([fit.rms[d] for fit, d in pairs], axis=0),
        power=float(np.median([fit.power[d, 1] for fit, d in pairs])),
        mean_power=float(np.median([fit.power[d, 0] for fit, d in pairs])),
        errors=np.array([fit.error[d] for fit, d in pairs]),
        covariates=matrix,
        names=names,
    )


def _covariates(pairs: Sequence[tuple[RecordingFit, int]]) -> dict[str, Floats]:
    """Numbers that signals and cards tell, and one column for each motion but the commonest."""
    out: dict[str, Floats] = {}
    facts = [fit.occasion.facts or {} for fit, _ in pairs]
    for name in dict.fromkeys(key for own in facts for key in own):
        out[name] = np.array([own.get(name, np.nan) for own in facts])
    for name in ('temperature', 'load', 'speed', 'supply voltage'):
        values = [
            fit.conditions[name][d] if name in fit.conditions else np.nan for fit, d in pairs
        ]
        out[f'winding {name}' if name in out else name] = np.array(values)
    motions = [fit.occasion.motions or {} for fit, _ in pairs]
    for kind in dict.fromkeys(key for own in motions for key in own):
        words = [own.get(kind, '') for own in motions]
        for word, number in Counter(words).most_common()[1:]:
            if number >= _LEAST_OF_KIND:
                out[f'{kind} {word or "unknown"}'] = np.array([float(w == word) for w in words])
    known = {name: _standard(values) for name, values in out.items() if _varies(values)}
    if 'temperature' in known:
        # Grease thins exponentially: over a season a straight slope leaves its curvature.
        curve = np.square(known['temperature'])
        if _varies(curve):
            known[TEMPERATURE_CURVE] = _standard(curve)
    return known


def _varies(values: Floats) -> bool:
    known = values[np.isfinite(values)]
    if len(known) < len(values) / 2 or not len(known):
        return False
    return bool(known.std() > _LEAST_VARIATION * max(abs(float(known.mean())), 1e-9))


def _standard(values: Floats) -> Floats:
    """Mean 0 and standard deviation 1; unknown values become the mean."""
    mean, spread = np.nanmean(values), np.nanstd(values)
    return np.asarray(np.nan_to_num((values - mean) / spread, nan=0.0))


def _chosen(covariates: Mapping[str, Floats], count: int) -> tuple[str, ...]:
    """Covariates that say something of their own, no more than the recordings can bear."""
    chosen: list[str] = []
    for name, values in covariates.items():
        if len(chosen) >= count // _PER_COVARIATE:
            break
        alike = [abs(float(np.mean(values * covariates[other]))) for other in chosen]
        if not alike or max(alike) < _COMMON:
            chosen.append(name)
    return tuple(chosen)
