"""By how much a drive's electrical samples are late against its joint samples."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from power_daq.cli import InputError
from power_daq.recording.reader import Recording
from power_daq.recording.stream import Stream
from power_daq.reference.curve import Curve
from power_daq.reference.fit import Value
from power_daq.reference.jackknife import blocks_of, half_width, left_out
from power_daq.reference.measured import Measured

Floats = NDArray[np.float64]
SHIFTS = np.arange(-20.0, 20.5, 0.5) * 1e-3
"""Artificial shifts at which errors are taken, s."""
_RATE = 100.0  # Hz, both sides are low-passed for it: flat to 25 Hz
_STEPS = 8
_LEAST = 3.0  # s
_LEAST_R2 = 0.3


@dataclass(frozen=True)
class Delay:
    """
    Alignment of one drive; errors in W [S], one for each of SHIFTS added to the best delay.

    delay: s by which electrical stamps are late, None where power follows nothing that the joint
    sensors say (r2 under 0.3). refitted: RMS error of power against the proxy fitted anew at each
    shift. moved: RMS change of power that the shift alone makes.
    """

    drive: str
    delay: Value | None
    r2: float
    power: float  # W, standard deviation of the low-passed power
    refitted: Floats
    moved: Floats
    seconds: float

    def error_at(self, shift: float) -> tuple[float, float]:
        """
        What a shift (s) adds, mean of both signs: W, and % of the spread of power.

        It is the power's own change, which no model that is right escapes.
        """
        watts = float(np.interp(shift, SHIFTS, self.moved) + np.interp(-shift, SHIFTS, self.moved))
        return 0.5 * watts, 50.0 * watts / self.power


def delay_of(recording: Recording, drive: str) -> Delay:
    """
    Fit one drive's electrical power by what its joint sensors say, at the delay that fits best.

    The proxy is c₀ + c₁·τω + c₂·τ² + c₃·|ω| + c₄·ω² + c₅·ω·dω/dt + c₆·τ·dτ/dt. The last two are
    the rotor's inertia and a spring in the drive: they look like a delay and would else be taken
    for one. ω is the slope of position, as reported speed lags behind its filter. Products are
    formed at the sensors' rate, then both sides pass the same low-pass (flat to 25 Hz).
    Gauss-Newton over coefficients and delay; interval of 95 % by a jackknife over blocks.

    InputError for a drive that was not measured or is no joint, or under 3 s without gaps.
    """
    measured = Measured.of(recording, drive)
    power = measured.power.low_passed(_RATE)
    features = _features(recording, drive, measured.start_ns).low_passed(_RATE)
    rises = features.derivative()
    span = max(power.span[0], features.span[0]), min(power.span[1], features.span[1])
    margin = float(SHIFTS[-1]) + 0.03
    count = int((span[1] - span[0] - 2 * margin) * _RATE)
    if not power.runs or not features.runs or count < _LEAST * _RATE:
        raise InputError(
            f'{recording.path}: {drive} has under {_LEAST:g} s of electrical and joint samples '
            'without gaps in common'
        )
    time = span[0] + margin + np.arange(count) / _RATE
    watts = power.at(time)[:, 0]
    delay = _coarse(time, watts, features)
    coefficients = np.zeros(features.runs[0][1].shape[1])
    good = np.zeros(0, np.bool_)
    jacobian = residual = np.zeros(0)
    for _ in range(_STEPS):
        x, rise = features.at(time - delay), rises.at(time - delay)
        good = np.isfinite(x).all(axis=1) & np.isfinite(rise).all(axis=1) & np.isfinite(watts)
        x, rise = x[good], rise[good]
        if good.sum() < _LEAST * _RATE:
            raise InputError(f'{recording.path}: {drive} has under {_LEAST:g} s without gaps')
        coefficients = _solved(x, watts[good])
        residual = watts[good] - x @ coefficients
        jacobian = np.column_stack([-(rise @ coefficients), x])
        step = float(_solved(jacobian, residual)[0])
        delay = float(np.clip(delay + np.clip(step, -5e-3, 5e-3), -0.05, 0.05))
        if abs(step) < 1e-7:
            break
    spread = float(watts[good].std())
    r2 = 1.0 - float(residual.var()) / max(spread**2, 1e-12)
    changes = left_out(jacobian, residual, blocks_of(time[good]))
    half = float(half_width(changes[:, :1])[0])
    known = r2 >= _LEAST_R2
    return Delay(
        drive=drive,
        delay=Value(delay, delay - half, delay + half) if known else None,
        r2=r2,
        power=spread,
        refitted=_refitted(time, watts, features, delay),
        moved=_moved(time, watts, power),
        seconds=float(good.sum()) / _RATE,
    )


def _features(recording: Recording, drive: str, start_ns: int) -> Curve:
    joints = recording.joint_states()
    if drive not in joints.names:
        raise InputError(
            f'{recording.path}: drive {drive} is no joint; there are {", ".join(joints.names)}'
        )
    column = joints.names.index(drive)
    time = (joints.stamp_ns - start_ns) / 1e9
    angle = joints.position[:, column].astype(np.float64)
    torque = joints.effort[:, column].astype(np.float64)
    bad = ~(np.isfinite(angle) & np.isfinite(torque))
    stream = Stream.of(time, np.zeros((len(time), 0), np.float32), bad)
    runs = []
    for start, stop in zip(stream.starts.tolist(), stream.stops.tolist(), strict=True):
        if stop - start < 8:
            continue
        t, q, tau = time[start:stop], angle[start:stop], torque[start:stop]
        w, turn = np.gradient(q, t), np.gradient(tau, t)
        table = (np.ones(len(t)), tau * w, tau**2, np.abs(w), w**2)
        runs.append((t, np.column_stack([*table, w * np.gradient(w, t), tau * turn])))
    return Curve(tuple(runs), stream.period)


def _solved(x: Floats, y: Floats) -> Floats:
    size = np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-12)
    solution: Floats = np.linalg.lstsq(x / size, y, rcond=None)[0] / size
    return solution


def _error(x: Floats, y: Floats) -> float:
    good = np.isfinite(x).all(axis=1) & np.isfinite(y)
    if good.sum() < _RATE:
        return np.nan
    return float(np.sqrt(np.mean((y[good] - x[good] @ _solved(x[good], y[good])) ** 2)))


def _coarse(time: Floats, watts: Floats, features: Curve) -> float:
    """The shift on a grid of 2 ms within ±40 ms at which the proxy fits best."""
    shifts = np.arange(-0.04, 0.041, 0.002)
    errors = [_error(features.at(time - shift), watts) for shift in shifts]
    return float(shifts[int(np.nanargmin(errors))]) if np.isfinite(errors).any() else 0.0


def _refitted(time: Floats, watts: Floats, features: Curve, delay: float) -> Floats:
    return np.array([_error(features.at(time - delay + shift), watts) for shift in SHIFTS])


def _moved(time: Floats, watts: Floats, power: Curve) -> Floats:
    changes = [power.at(time + shift)[:, 0] - watts for shift in SHIFTS]
    return np.array([float(np.sqrt(np.nanmean(change**2))) for change in changes])
