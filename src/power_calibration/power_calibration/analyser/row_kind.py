"""Point samples or means over their period: what the rows of a slow reference are, by the data."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from power_calibration.analyser.curve import Curve
from power_calibration.analyser.jackknife import blocks_of
from power_calibration.analyser.reference_fit import Clock

Floats = NDArray[np.float64]
RowKind = Literal['samples', 'means']
_BAND = 0.8  # of the slower rate
_LEVEL = 0.995  # quantile of the test
_LOWEST_BANDWIDTH = 0.2  # of our sampling rate, of a meter that is not itself an average


def row_kind(ours: Curve, reference: Curve, clock: Clock, period: float) -> RowKind | None:
    """
    Compare two hypotheses on the rows of a reference by their residuals; None if neither wins.

    Both curves hold the same K channels as sampled; period: s between rows. Under either
    hypothesis ours = slope·reference + level + bend·reference'', with one side averaged over the
    period for means, in a band of up to 0.4 of the slower rate. bend lies between 0 and that of a
    first-order meter whose −3 dB point is a fifth of its sampling rate: the means of a fast
    signal and a slow meter would otherwise be the same.

    Averaging removes noise as well as signal. The test of samples therefore averages ours alone,
    which favours means, and the test of means averages ours under both hypotheses and the
    reference under samples, which favours samples. Each compares the squared residuals block by
    block, after Vuong's test of models that are not nested (1989).
    """
    rate = _BAND * min(1.0 / period, 1.0 / ours.period)
    ours_low, ours_mean = ours.low_passed(rate), ours.low_passed(rate, mean=period)
    low = reference.low_passed(rate)
    mean = reference.low_passed(rate, mean=period)
    first = max(ours_mean.span[0], float(clock.ours(np.array(mean.span[:1]))[0]))
    last = min(ours_mean.span[1], float(clock.ours(np.array(mean.span[1:]))[0]))
    time = first + np.arange(max(0, int((last - first) * rate))) / rate
    at = clock.reference(time)
    low_values, mean_values = _with_curvature(low, at), _with_curvature(mean, at)
    y, y_mean = ours_low.at(time), ours_mean.at(time)
    good = np.isfinite(np.hstack([*low_values, *mean_values, y, y_mean])).all(axis=1)
    if good.sum() < 3.0 * rate:
        return None
    largest = 1.0 / (2.0 * (2.0 * np.pi * _LOWEST_BANDWIDTH / ours.period) ** 2)

    def residual(values: Floats, regressors: tuple[Floats, Floats]) -> Floats:
        x, curvature = regressors
        columns = range(values.shape[1])
        return np.stack(
            [_residual(values[good, k], x[good, k], curvature[good, k], largest) for k in columns]
        )

    owner = blocks_of(time[good])
    as_means = residual(y_mean, low_values)
    samples = _wins(residual(y, low_values), as_means, owner)
    means = _wins(as_means, residual(y_mean, mean_values), owner)
    if samples == means:
        return None
    return 'samples' if samples else 'means'


def _with_curvature(curve: Curve, times: Floats) -> tuple[Floats, Floats]:
    return curve.at(times), curve.derivative().derivative().at(times)


def _residual(y: Floats, x: Floats, curvature: Floats, largest: float) -> Floats:
    """Fit y = slope·x + level + bend·curvature, 0 ≤ bend/slope ≤ largest, and return the rest."""
    solution = np.linalg.lstsq(_columns(x, curvature), y, rcond=None)[0]
    bend = float(np.clip(solution[2] / solution[0], 0.0, largest))
    columns = _columns(x + bend * curvature)
    return np.asarray(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0])


def _columns(x: Floats, *others: Floats) -> Floats:
    return np.column_stack([x, np.ones_like(x), *others])


def _wins(first: Floats, second: Floats, owner: NDArray[np.intp]) -> bool:
    """Return whether residuals [K, T] are smaller than others beyond their scatter by block."""
    scale = np.maximum((first**2).mean(axis=1) + (second**2).mean(axis=1), 1e-18)
    difference = ((second**2 - first**2) / scale[:, None]).sum(axis=0)
    blocks = np.bincount(owner, difference)
    error = float(blocks.std(ddof=1)) / np.sqrt(len(blocks))
    return float(blocks.mean()) > student.ppf(_LEVEL, len(blocks) - 1) * error
