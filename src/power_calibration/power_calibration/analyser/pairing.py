"""Ours and the reference's side by side: the same signals, low-passed alike."""

import numpy as np
from numpy.typing import NDArray

from power_calibration.analyser.curve import Curve
from power_calibration.analyser.fit import Clock, Fit, fit
from power_calibration.analyser.log import Log
from power_calibration.analyser.measured import Measured
from power_calibration.analyser.search import Match

Floats = NDArray[np.float64]


class Pair:
    """Both sides of the fit, low-passed alike."""

    def __init__(self, ours: Curve, reference: Curve, rate: float) -> None:
        self.raw = reference
        self._ours, self._reference = ours.low_passed(rate), reference.low_passed(rate)
        self._rate = rate

    def fit(self, match: Match) -> Fit | None:
        """Refine a match."""
        return fit(self._ours, self._reference, match, self._rate)

    def folds(self, clock: Clock, period: float) -> Floats:
        """
        What sampling at a period in s folds into the band of the fit, RMS of each channel [K].

        Of the reference as it is, damped as by a filter of first order at a third of our rate. 0
        where the reference is not 2.5 times as fast as we sample, for then nobody knows.
        """
        if self.raw.period > 0.4 * period:
            return np.zeros(self.raw.runs[0][1].shape[1])
        sampled = []
        for time, _ in self.raw.runs:
            first, last = clock.ours(time[[2, -3]])
            stamps = first + period * np.arange(max(0, int((last - first) / period)))
            if len(stamps) > 4:
                sampled.append((stamps, self.raw.at(clock.reference(stamps))))
        folded = Curve(tuple(sampled), period).low_passed(self._rate)
        rest = [values - self._reference.at(clock.reference(time)) for time, values in folded.runs]
        both = np.concatenate(rest)
        both = both[np.isfinite(both).all(axis=1)]
        damping = 1.0 / np.sqrt(1.0 + 3.0**2)
        folds: Floats = damping * both.std(axis=0)
        return folds


def paired(measured: Measured, log: Log) -> tuple[list[str], Curve, Curve]:
    """Channels to fit, and both curves with their columns and power last where it is known."""
    volts, amps, watts = log.voltage, log.current, log.watts
    if amps is None and volts is not None and log.power is not None:
        amps = log.power / np.where(np.abs(volts) > 1e-3, volts, np.nan)
    steady = volts is not None and float(np.ptp(volts)) <= 1e-6 * max(1.0, abs(float(volts[0])))
    names, columns = [], []
    if volts is not None and not steady:
        names.append('voltage')
        columns.append(volts)
    if amps is not None:
        names.append('current')
        columns.append(amps)
    power_alone = not names
    if power_alone:
        names.append('power')
    if watts is not None:
        columns.append(watts)
    picked = [{'voltage': 0, 'current': 1}[name] for name in names if name != 'power']
    runs = []
    for time, values in measured.curve.runs:
        power = (values[:, 0] * values[:, 1])[:, None]
        parts = [values[:, picked]] if picked else []
        runs.append((time, np.column_stack([*parts, power] if watts is not None else parts)))
    ours = Curve(tuple(runs), measured.curve.period)
    reference = Curve.of(log.time, np.column_stack(columns), log.starts, log.stops, log.period)
    return names, ours, reference


def one(curve: Curve, place: int) -> Curve:
    """One signal of a curve."""
    return Curve(tuple((t, v[:, place][:, None]) for t, v in curve.runs), curve.period)


def some(curve: Curve, count: int) -> Curve:
    """The first signals of a curve."""
    return Curve(tuple((t, v[:, :count]) for t, v in curve.runs), curve.period)
