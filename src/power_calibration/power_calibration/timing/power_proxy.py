"""Proxy of a drive's electrical power from its joint sensors, with a spring at the rotor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.stream import Stream
from power_recordings.reading.reader import Recording
from scipy.signal import lfilter, savgol_filter
from wattwalk_core.errors import InputError

from power_calibration.analyser.curve import Curve

Floats = NDArray[np.float64]
_WINDOW = 9  # samples of the Savitzky-Golay filter: about 60 Hz at 400 Hz
_ORDER = 4
_SLIDING = 0.1  # rad/s, at which Coulomb friction saturates
_SOFTEST = 1 / 60.0  # rad/(N·m)
_SLOWEST = 0.03  # s


@dataclass(frozen=True)
class ShaftSpring:
    """Spring between rotor and joint: compliance, rad/(N·m), and relaxation of its damper, s."""

    compliance: float
    relaxation: float

    def moved(self, compliance: float, relaxation: float) -> 'ShaftSpring':
        """Return it with changes added, within 60 N·m/rad to rigid and 0 to 30 ms."""
        return ShaftSpring(
            float(np.clip(self.compliance + compliance, 0.0, _SOFTEST)),
            float(np.clip(self.relaxation + relaxation, 0.0, _SLOWEST)),
        )


@dataclass(frozen=True)
class Joint:
    """Torque (N·m) and position (rad) of a joint in runs without gaps, times in s."""

    name: str
    runs: tuple[tuple[Floats, Floats, Floats], ...]  # time, torque, position
    period: float

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, s."""
        if not self.runs:
            return 0.0, 0.0
        return float(self.runs[0][0][0]), float(self.runs[-1][0][-1])

    @classmethod
    def of(cls, recording: Recording, drive: str, start_ns: int) -> 'Joint':
        """Take a joint of a recording, times after start_ns; InputError for an unknown one."""
        joints = recording.joint_states()
        if drive not in joints.names:
            raise InputError(
                f'{recording.path}: drive {drive} is no joint; there are {", ".join(joints.names)}'
            )
        column = joints.names.index(drive)
        time = (joints.stamp_ns - start_ns) / 1e9
        torque = joints.effort[:, column].astype(np.float64)
        angle = joints.position[:, column].astype(np.float64)
        bad = ~(np.isfinite(angle) & np.isfinite(torque))
        stream = Stream.of(time, np.zeros((len(time), 0), np.float32), bad)
        pairs = zip(stream.starts.tolist(), stream.stops.tolist(), strict=True)
        runs = tuple(
            (time[a:b], torque[a:b], angle[a:b]) for a, b in pairs if b - a >= 4 * _WINDOW
        )
        return cls(drive, runs, stream.period)

    def between(self, first: float, last: float) -> 'Joint':
        """Return the part between two times, s."""
        kept = []
        for time, torque, angle in self.runs:
            low, high = np.searchsorted(time, [first, last]).tolist()
            if high - low >= 4 * _WINDOW:
                kept.append((time[low:high], torque[low:high], angle[low:high]))
        return Joint(self.name, tuple(kept), self.period)

    def features(self, spring: ShaftSpring) -> Curve:
        """
        Return eleven signals whose weighted sum is power, with w = dq/dt + compliance·dτ'/dt.

        1, τw, τ², |w|, w², w·dw/dt, τ·dw/dt, (dw/dt)², τ·tanh(w/0.1), |τw|, |τ|: idle power,
        shaft, copper loss of load and rotor acceleration, friction and its copper loss, rotor
        inertia, load friction and loss of regenerated power, inverter. The rotor's speed w is the
        derivative of position, since reported speed lags behind its filter.
        """
        return Curve(
            tuple((t, self._table(tau, q, spring)) for t, tau, q in self.runs), self.period
        )

    def _table(self, torque: Floats, angle: Floats, spring: ShaftSpring) -> Floats:
        delta = self.period
        torsion = torque
        if spring.relaxation > 0.0:
            keep = float(np.exp(-delta / spring.relaxation))
            half = 0.5 * (1.0 - keep)
            torsion = lfilter([half, half], [1.0, -keep], torque - torque[0]) + torque[0]

        def smooth(values: Floats, order: int) -> Floats:
            return np.asarray(savgol_filter(values, _WINDOW, _ORDER, deriv=order, delta=delta))

        w = smooth(angle, 1) + spring.compliance * smooth(torsion, 1)
        turn = smooth(angle, 2) + spring.compliance * smooth(torsion, 2)
        tau = smooth(torque, 0)
        losses = (tau * np.tanh(w / _SLIDING), np.abs(tau * w), np.abs(tau))
        moving = (np.abs(w), w * w, w * turn, tau * turn, turn * turn)
        return np.column_stack([np.ones_like(tau), tau * w, tau * tau, *moving, *losses])
