"""Delay of a drive's electrical samples against its joint samples."""

from dataclasses import dataclass, field

import numpy as np
from power_recordings.reading.reader import Recording
from scipy.signal import lfilter, savgol_filter
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError

from power_calibration.analyser.curve import Curve, MeasuredDrive
from power_calibration.analyser.reference_fit import (
    IntervalEstimate,
    blocks_of,
    half_width,
    left_out,
)

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
        """Return the spring with changes added, clipped to 0..1/60 rad/(N·m) and 0..30 ms."""
        return ShaftSpring(
            float(np.clip(self.compliance + compliance, 0.0, _SOFTEST)),
            float(np.clip(self.relaxation + relaxation, 0.0, _SLOWEST)),
        )


@dataclass(frozen=True)
class Joint:
    """Torque (N·m) and position (rad) of a joint over time."""

    name: str
    curve: Curve  # torque, position

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
        signals = (joints.effort[:, column], joints.position[:, column])
        values = np.column_stack(signals).astype(np.float64)
        bad = np.asarray(~np.isfinite(values).all(axis=1))
        curve = Curve.of_samples(time, values, bad)
        return cls(drive, curve).between(-np.inf, np.inf)

    def between(self, first: float, last: float) -> 'Joint':
        """Return the part between two times, s, without runs too short to differentiate."""
        kept = []
        for time, values in self.curve.runs:
            low, high = np.searchsorted(time, [first, last]).tolist()
            if high - low >= 4 * _WINDOW:
                kept.append((time[low:high], values[low:high]))
        return Joint(self.name, Curve(tuple(kept), self.curve.period))

    def features(self, spring: ShaftSpring) -> Curve:
        """Return eleven signals whose weighted sum is power, with w = dq/dt + compliance·dτ'/dt.

        1, τw, τ², |w|, w², w·dw/dt, τ·dw/dt, (dw/dt)², τ·tanh(w/0.1), |τw|, |τ|: idle power,
        shaft, copper loss of load and rotor acceleration, friction and its copper loss, rotor
        inertia, load friction and loss of regenerated power, inverter. The rotor's speed w is the
        derivative of position, since reported speed lags behind its filter.
        """
        return self.curve.mapped(lambda _, values: self._table(values, spring))

    def _table(self, values: Floats, spring: ShaftSpring) -> Floats:
        torque, angle = values.T
        delta = self.curve.period
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


SHIFTS = np.arange(-20.0, 21.0) * 1e-3  # shifts at which errors are computed, s
_RATE = 100.0  # Hz, both sides are low-passed for it: flat to 25 Hz
_SPAN = 30.0  # s, fitted where power varies most
_STEPS = 8
_LEAST = 3.0  # s
_LEAST_R2 = 0.3
_LARGEST_DELAY = 0.05  # s
_SPRINGS = (
    ShaftSpring(0.0, 0.0),
    *(ShaftSpring(c, t) for c in (1 / 900, 1 / 450, 1 / 250) for t in (0.0, 0.006)),
)


@dataclass(frozen=True)
class Delay:
    """Alignment of one drive; errors in W [S], one for each of SHIFTS added to the best delay.

    delay: of electrical stamps, s, None where power does not depend on the joint signals (r2 under
    0.3). refitted: RMS error of power against the proxy, fitted at each shift. moved: RMS change
    of power by the shift alone.
    """

    drive: str
    delay: IntervalEstimate | None
    r2: float
    power: float  # W, standard deviation of the low-passed power
    refitted: Floats
    moved: Floats
    seconds: float

    def error_at(self, shift: float) -> tuple[float, float]:
        """Return the error by a shift in s: W RMS, and % of power's standard deviation.

        It is the change of the power itself, so that even an exact model has this error. Mean of
        both signs of the shift.
        """
        watts = float(np.interp(shift, SHIFTS, self.moved) + np.interp(-shift, SHIFTS, self.moved))
        return 0.5 * watts, 50.0 * watts / self.power


def delay_of(recording: Recording, drive: str) -> Delay:
    """Estimate a drive's delay by regression of its electrical power on its joint signals.

    The proxy is that of `Joint.features`, linear in functions of torque and the rotor's speed.
    A spring (compliance and relaxation) between rotor and joint is fitted with it, since its
    effect resembles a delay. Both sides pass the same low-pass (flat to 25 Hz). Gauss-Newton over
    coefficients, spring and delay, from the best of seven springs, on the 30 s in which power
    varies most; 95 % interval by a jackknife over blocks.

    InputError for a drive that was not measured or is no joint, or under 3 s without gaps.
    """
    measured = MeasuredDrive.of(recording, drive)
    power = measured.power.low_passed(_RATE)
    joint = Joint.of(recording, drive, measured.start_ns)
    time = _busiest(recording, drive, power, joint)
    joint = joint.between(time[0] - 0.5, time[-1] + 0.5)
    problem = _Problem(time, power.at(time)[:, 0], joint)
    delay, spring = problem.refined(*problem.started())
    jacobian, residual, at = problem.linear(delay, spring)
    watts = problem.watts[np.isin(problem.time, at)]
    spread = float(watts.std())
    r2 = 1.0 - float(residual.var()) / max(spread**2, 1e-12)
    changes = left_out(jacobian, residual, blocks_of(at))
    half = float(half_width(changes[:, :1])[0])
    known = r2 >= _LEAST_R2 and abs(delay) < _LARGEST_DELAY
    return Delay(
        drive=drive,
        delay=IntervalEstimate.of(delay, half) if known else None,
        r2=r2,
        power=spread,
        refitted=problem.refitted(delay, spring),
        moved=_moved(time, power),
        seconds=len(at) / _RATE,
    )


def _busiest(recording: Recording, drive: str, power: Curve, joint: Joint) -> Floats:
    """Return the times at which both sides are fitted, s."""
    margin = float(SHIFTS[-1]) + _LARGEST_DELAY + 0.1
    first = max(power.span[0], joint.curve.span[0]) + margin
    last = min(power.span[1], joint.curve.span[1]) - margin
    time = first + np.arange(max(0, int((last - first) * _RATE))) / _RATE
    watts = power.at(time)[:, 0]
    if np.isfinite(watts).sum() < _LEAST * _RATE:
        raise InputError(
            f'{recording.path}: {drive} has under {_LEAST:g} s of electrical and joint samples '
            'without gaps in common'
        )
    width = round(_SPAN * _RATE)
    if len(time) <= width:
        return time
    change = np.nan_to_num(np.diff(watts, append=watts[-1:])) ** 2
    summed = np.concatenate([[0.0], np.cumsum(change)])
    start = int(np.argmax(summed[width:] - summed[:-width]))
    return time[start : start + width]


@dataclass(frozen=True)
class _Problem:
    """Regression of power at T times on the joint signals."""

    time: Floats
    watts: Floats
    joint: Joint
    known: dict[ShaftSpring, Curve] = field(default_factory=dict)

    def _features(self, spring: ShaftSpring) -> Curve:
        if spring not in self.known:
            if len(self.known) > 3:
                self.known.clear()
            self.known[spring] = self.joint.features(spring).low_passed(_RATE, interpolate=False)
        return self.known[spring]

    def _rows(self, curve: Curve, delay: float) -> tuple[Floats, Bools]:
        x = curve.at(self.time - delay)
        return x, np.isfinite(x).all(axis=1) & np.isfinite(self.watts)

    def _error(self, curve: Curve, delay: float) -> float:
        x, good = self._rows(curve, delay)
        if good.sum() < _LEAST * _RATE:
            return np.inf
        rest = self.watts[good] - x[good] @ _solved(x[good], self.watts[good])
        return float(np.sqrt(np.mean(rest**2)))

    def started(self) -> tuple[float, ShaftSpring]:
        """Return the best delay on a grid of 4 ms and the best of seven springs."""
        grid = np.arange(-0.04, 0.041, 0.004)
        found = []
        for spring in _SPRINGS:
            curve = self._features(spring)
            found += [(self._error(curve, delay), delay, spring) for delay in grid.tolist()]
        error, delay, spring = min(found, key=lambda item: item[0])
        if not np.isfinite(error):
            raise InputError(f'{self.joint.name} has under {_LEAST:g} s without gaps')
        return delay, spring

    def refined(self, delay: float, spring: ShaftSpring) -> tuple[float, ShaftSpring]:
        """Refine both by Gauss-Newton, each step halved until the error falls."""
        error = self._error(self._features(spring), delay)
        for _ in range(_STEPS):
            jacobian, residual, _ = self.linear(delay, spring)
            change = _solved(jacobian, residual)[:3]
            for _ in range(4):
                tried = spring.moved(float(change[1]), float(change[2]))
                later = float(np.clip(delay + change[0], -_LARGEST_DELAY, _LARGEST_DELAY))
                reached = self._error(self._features(tried), later)
                if reached < error:
                    break
                change = 0.5 * change
            else:
                break
            gained = error - reached
            delay, spring, error = later, tried, reached
            if gained < 1e-3 * error:
                break
        return delay, spring

    def linear(self, delay: float, spring: ShaftSpring) -> tuple[Floats, Floats, Floats]:
        """Linearise the modelled power at a delay, s, and a spring.

        Return its Jacobian [R, 3 + P], the residual (measured − model, W [R]) and the times, s.
        The Jacobian's columns: delay, compliance and relaxation of the spring, P coefficients.
        R counts those of the T times at which power and all features are known.
        """
        curve = self._features(spring)
        x, good = self._rows(curve, delay)
        rise, _ = self._rows(curve.derivative(), delay)
        softer, _ = self._rows(self._features(spring.moved(1e-5, 0.0)), delay)
        slower, _ = self._rows(self._features(spring.moved(0.0, 2e-4)), delay)
        for part in (rise, softer, slower):
            good &= np.isfinite(part).all(axis=1)
        b = _solved(x[good], self.watts[good])
        columns = [-(rise[good] @ b), (softer - x)[good] @ b / 1e-5, (slower - x)[good] @ b / 2e-4]
        if spring.compliance < 1e-4:
            columns[2] = np.zeros(int(good.sum()))
        residual = self.watts[good] - x[good] @ b
        return np.column_stack([*columns, x[good]]), residual, self.time[good]

    def refitted(self, delay: float, spring: ShaftSpring) -> Floats:
        """Return the RMS error with coefficients fitted at each shift, W."""
        curve = self._features(spring)
        return np.array([self._error(curve, delay - shift) for shift in SHIFTS])


def _solved(x: Floats, y: Floats) -> Floats:
    size = np.sqrt((x**2).sum(axis=0))
    size = np.where(size > 0, size, 1.0)
    scaled = x / size
    return np.linalg.lstsq(scaled.T @ scaled, scaled.T @ y, rcond=None)[0] / size


def _moved(time: Floats, power: Curve) -> Floats:
    watts = power.at(time)[:, 0]
    changes = [power.at(time + shift)[:, 0] - watts for shift in SHIFTS]
    return np.array([float(np.sqrt(np.nanmean(change**2))) for change in changes])
