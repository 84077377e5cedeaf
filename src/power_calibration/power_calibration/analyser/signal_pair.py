"""Signals of the meter and of the reference that are compared with each other."""

import numpy as np
from numpy.typing import NDArray

from power_calibration.analyser.coarse_alignment import Match
from power_calibration.analyser.curve import Curve
from power_calibration.analyser.log import Log
from power_calibration.analyser.measured_drive import MeasuredDrive
from power_calibration.analyser.reference_fit import Clock, ReferenceFit, fit_reference

Floats = NDArray[np.float64]


class SignalPair:
    """Meter and reference, low-passed alike; `mean`: width of an average of the meter's, s."""

    def __init__(self, ours: Curve, reference: Curve, rate: float, mean: float = 0.0) -> None:
        self.raw = reference
        self._ours = ours.low_passed(rate, mean=mean)
        self._reference = reference.low_passed(rate)
        self._rate = rate

    def fit(self, match: Match) -> ReferenceFit | None:
        """Refine a match; None where under 3 s overlap."""
        return fit_reference(self._ours, self._reference, match, self._rate)

    def aliases(self, clock: Clock, period: float) -> Floats:
        """
        Return what sampling at a period in s aliases into the band of the fit, RMS [K].

        It is that of the reference, damped as by a first-order filter at a third of the meter's
        rate; 0 for a reference under 2.5 times that rate, which does not show it.
        """
        if self.raw.period > 0.4 * period:
            return np.zeros(self.raw.runs[0][1].shape[1])
        sampled = []
        for time, _ in self.raw.runs:
            first, last = clock.ours(time[[2, -3]])
            stamps = first + period * np.arange(max(0, int((last - first) / period)))
            if len(stamps) > 4:
                sampled.append((stamps, self.raw.at(clock.reference(stamps))))
        aliased = Curve(tuple(sampled), period).low_passed(self._rate)
        runs = aliased.runs
        both = np.concatenate([v - self._reference.at(clock.reference(t)) for t, v in runs])
        both = both[np.isfinite(both).all(axis=1)]
        rms: Floats = both.std(axis=0) / np.sqrt(1.0 + 3.0**2)
        return rms


def signal_curves(measured: MeasuredDrive, log: Log) -> tuple[list[str], Curve, Curve]:
    """Return the channels to fit, and both curves: these channels, then power if it is known."""
    volts, amps, watts = log.voltage, log.current, log.watts
    if amps is None and volts is not None and log.power is not None:
        amps = log.power / np.where(np.abs(volts) > 1e-3, volts, np.nan)
    steady = volts is not None and float(np.ptp(volts)) <= 1e-6 * max(1.0, abs(float(volts[0])))
    known = {'voltage': None if steady else volts, 'current': amps}
    names = [name for name, column in known.items() if column is not None]
    picked = [place for place, column in enumerate(known.values()) if column is not None]
    columns = [column for column in (*known.values(), watts) if column is not None]
    runs = []
    for time, values in measured.curve.runs:
        power = [values[:, :1] * values[:, 1:]] if watts is not None else []
        runs.append((time, np.hstack([values[:, picked], *power])))
    ours = Curve(tuple(runs), measured.curve.period)
    return names or ['power'], ours, log.curve(np.column_stack(columns))
