"""Signals and reduced products of aligned recordings, which effects are fitted to."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.alignment.positions import stands_still
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_estimator.effects import Signals
from power_estimator.effects.signals.reducer import (
    EARLIEST,
    HALF_WIDTH,
    LATEST,
    REDUCED_RATE,
    SHIFT_STEP,
    Reducer,
)
from power_estimator.effects.signals.scale import VOLTAGE, DriveScale
from power_estimator.effects.signals.sizing import (
    drive_scale,
    torque_constants,
    with_torque,
    with_voltage,
)

WHOLE = 'robot'  # name of the meter of a whole robot
_LAG_LIMIT = 0.02  # s
_UNRESOLVED, _MOST_UNRESOLVED = 4.0, 1 / 7
_MOVING = 0.05  # rad/s
_MOST_TRAVEL = 4 * np.pi  # rad, of a joint
_STATE = (
    *('torque', 'velocity', 'acceleration', 'position', 'torque_rate'),
    *('voltage', 'temperature'),
)
_RELATED = 0.8  # correlation of velocity and the rate of position, where one is the other's


@dataclass(frozen=True)
class SignalPart:
    """Places of the samples and rows that are used, of whole recordings."""

    samples: NDArray[np.intp]  # [T] at the input rate
    rows: NDArray[np.intp]  # [N] reduced
    count: int  # rows of all

    def everywhere(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return values [N, …] at their rows of the whole recordings, NaN at all others."""
        out = np.full((self.count, *values.shape[1:]), np.nan, dtype=values.dtype)
        out[self.rows] = values
        return out


@dataclass(frozen=True)
class Prepared:
    """Signals of D drives with the power of M meters reduced at every delay.

    Each drive has a meter, or there is one for the whole robot. Reduced arrays have N rows at
    50 Hz.
    """

    signals: Signals  # at the input rate
    reducer: Reducer
    power: Singles  # W [S, N, M], at S delays
    shifts: Floats  # s [S]
    time: Floats  # s [N]
    recording: NDArray[np.int32]  # [N]
    recordings: tuple[str, ...]
    lag: Floats  # s [D], of the velocity's filter, corrected
    torque_constant: Floats  # N·m/A [D], NaN where the torque is none that is computed here
    noise: Floats  # W [M], of the reduced power
    whole: bool = False  # one meter for the robot
    part: SignalPart | None = None  # where samples were left out

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the M meters: the drives, or the robot."""
        return (WHOLE,) if self.whole else self.signals.names

    def drive(self, index: int) -> 'Prepared':
        """Return signals and power of one drive, D = M = 1; not for whole robots."""
        return replace(
            self,
            signals=self.signals.drive(index),
            power=self.power[..., index : index + 1],
            lag=self.lag[[index]],
            torque_constant=self.torque_constant[[index]],
            noise=self.noise[[index]],
        )

    @property
    def scale(self) -> DriveScale:
        """Scale of the metered drives, or of the robot."""
        return self.signals.scale.whole() if self.whole else self.signals.scale

    @property
    def steady(self) -> bool:
        """True if rows are operating points: independent, in no order and without time."""
        return self.reducer.steady

    @property
    def seconds(self) -> float:
        """Length of the reduced signals in s; 0 for operating points."""
        return 0.0 if self.steady else self._seconds_of(len(self.time))

    @property
    def extent(self) -> str:
        """Length in words, such as `120 s` or `40 operating points`."""
        return self.extent_of(len(self.time))

    def extent_of(self, rows: int) -> str:
        """Return the length of a number of rows in words."""
        return f'{rows} operating points' if self.steady else f'{self._seconds_of(rows):.0f} s'

    def _seconds_of(self, rows: int) -> float:
        return rows * self.reducer.every / REDUCED_RATE

    @cached_property
    def measured(self) -> Bools:
        """Mask of the rows whose power was measured [N, M]."""
        return np.asarray(np.isfinite(self.power).all(axis=0))

    @cached_property
    def resolved(self) -> Bools:
        """Mask of rows whose joint signals are sampled finely enough to multiply [N, M].

        What torque·w does between two samples is of the size of torque·(second difference of w)
        and w·(second difference of torque). Where that is many times its usual size in motion (a
        foot that lands), their product says little. At most a seventh of those rows are left out.
        """
        s = self.signals
        unseen = np.square(s.torque * self._bend(s.velocity))
        unseen += np.square(s.velocity * self._bend(s.torque))
        size = np.maximum(self.reduced(unseen), 0.0)
        moves = np.sqrt(np.maximum(self.reduced(np.square(s.velocity)), 0.0)) > _MOVING
        in_motion = np.where(moves | ~moves.any(axis=0), size, np.nan)
        limit = np.square(_UNRESOLVED) * np.nanmedian(in_motion, axis=0)
        limit = np.maximum(limit, np.nanquantile(in_motion, 1.0 - _MOST_UNRESOLVED, axis=0))
        fine = np.asarray(size <= limit)
        return np.ones((len(fine), 1), dtype=bool) if self.whole else fine

    def unseen(self, copper: Floats) -> Floats:
        """Return the power that joint signals miss between their samples, W RMS [M].

        It is what torque·w and copper·torque² (copper in W/(N·m)² [D]) have near half the sampling
        rate, folded down. As much again, or less, folds down from the sampling rate itself,
        unseen.
        """
        s = self.signals
        sign = np.where(np.arange(len(s.torque)) % 2 == 0, 1.0, -1.0)[:, None]
        parts = [s.torque * s.velocity, copper * np.square(s.torque)]
        folded = [np.square(self.reduced(part * sign)) for part in parts]
        used = np.where(self.resolved, folded[0] + folded[1], np.nan)
        mean: Floats = np.nanmean(used, axis=0)
        return np.sqrt(mean.sum(keepdims=True) if self.whole else mean)

    def _bend(self, values: Floats) -> Floats:
        out = np.zeros_like(values)
        for part in self.signals.stretches():
            out[part][1:-1] = np.diff(values[part], n=2, axis=0)
        return out

    def power_at(self, delay: float) -> Floats:
        """Return the reduced power with its delay (s) to the joint signals taken out, W [N, M]."""
        place = np.clip((delay - self.shifts[0]) / SHIFT_STEP, 0.0, len(self.shifts) - 1.001)
        left = int(place)
        weight = place - left
        return np.asarray(
            (1.0 - weight) * self.power[left] + weight * self.power[left + 1], dtype=np.float64
        )

    def reduced(self, values: Floats) -> Floats:
        """Return a signal at the input rate [T, …], low-passed and decimated to [N, …]."""
        return self.reducer.reduce(values)

    def state(self) -> dict[str, Floats]:
        """Return reduced joint signals by name, SI units [N, D], to show where a model fails.

        The position of a drive that turns on is that within its turn.
        """
        position = self.signals.position
        turns = np.nan_to_num(np.ptp(position, axis=0)) > _MOST_TRAVEL
        within_turn = np.where(turns, np.mod(position, 2 * np.pi), position)
        shown = replace(self.signals, position=within_turn)
        return {name: self.reduced(getattr(shown, name)) for name in _STATE}

    def at_rows(
        self, rows: NDArray[np.intp], reducer: Reducer, signals: Signals, part: SignalPart | None
    ) -> 'Prepared':
        """Return some of the rows, which a reducer makes of signals; part: of whole recordings."""
        return replace(
            self,
            signals=signals,
            reducer=reducer,
            power=self.power[:, rows],
            time=self.time[rows],
            recording=self.recording[rows],
            part=part,
        )


def _columns(values: Singles) -> Floats:
    """Values [T, D] with the samples of a drive side by side, so that one drive is no copy."""
    return np.asfortranarray(values, dtype=np.float64)


def signals_of(
    data: AlignedDataset, lag: Floats | None = None, scale: DriveScale | None = None
) -> Signals:
    """Return the dataset's drives as Signals, with the velocity's lag (s [D]) removed.

    scale: that of the reference drive by default.
    """
    velocity, torque, position = map(_columns, (data.velocity, data.torque, data.position))
    stretches = [*data.segments()]
    if lag is not None:
        velocity = velocity + lag * rate_of(velocity, stretches, data.rate)
    acceleration = rate_of(velocity, stretches, data.rate)
    nothing = np.broadcast_to(0.0, torque.shape)
    return Signals(
        rate=data.rate,
        names=data.names,
        time=np.asarray(data.time, dtype=np.float64),
        segment=data.segment,
        recording=data.recording,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        torque=torque,
        torque_rate=rate_of(torque, stretches, data.rate),
        voltage=_columns(data.voltage),
        temperature=_columns(data.temperature),
        motor_velocity=velocity,
        motor_acceleration=acceleration,
        motor_torque=torque,
        torque_cost=nothing,
        electronics=nothing,
        drawn=torque * velocity,
        scale=DriveScale.reference(len(data.names)) if scale is None else scale,
        at_motor=np.array([name in data.motor_torque for name in data.names], dtype=bool),
        motor_current=None if data.motor_current is None else _columns(data.motor_current),
        steady=data.steady,
    )


def prepare(data: AlignedDataset, window: float = 0.0) -> Prepared:
    """Correct, check and reduce the drives whose power was measured, or the robot's supply.

    window: s over which energy is compared, for slow meters; 0 for all others. InputError for data
    without electrical measurements, with signals missing, or with units that contradict each
    other.
    """
    drives = data.measured_drives()
    whole = not drives and bool(np.isfinite(data.supply).any())
    if whole:
        drives = data.names
    if not drives:
        raise InputError(
            'no drive has electrical data (drive_supply): power was not measured in '
            f'{", ".join(data.recordings) or "these recordings"}'
        )
    data = data.drives(drives)
    for name in ('velocity', 'torque'):
        missing = ~np.isfinite(getattr(data, name)).any(axis=0)
        if missing.any():
            raise InputError(f'{drives[int(np.argmax(missing))]} has no {name} in joint_states')
    seen = np.isfinite(data.position).any(axis=0)
    good = np.isfinite(data.velocity + data.torque).all(axis=1)
    good &= np.isfinite(data.position[:, seen]).all(axis=1)
    data = _fill_voltage(_cut(data, good))
    constants = torque_constants(data)
    data = with_torque(data, constants)
    lag = velocity_lag(data)
    signals = replace(signals_of(data, lag, drive_scale(data)), one_meter=whole)
    if data.steady:
        reducer = Reducer(data.rate, (slice(0, len(data.time)),), steady=True)
    else:
        reducer = Reducer(data.rate, _long_enough(signals.stretches(), data.rate, window), window)
    if not reducer.slices:
        raise InputError(
            f'no stretch of {data.time.size / data.rate:.1f} s of data is longer than 1 s without '
            'a gap'
        )
    shifts = np.linspace(EARLIEST, LATEST, round((LATEST - EARLIEST) / SHIFT_STEP) + 1)
    meters = _columns(data.supply[:, None] if whole else data.power)
    power = np.stack([reducer.reduce(meters, shift) for shift in shifts.tolist()])
    centres = reducer.centres()
    return Prepared(
        signals=signals,
        reducer=reducer,
        power=power.astype(np.float32),
        shifts=shifts,
        time=signals.time[centres],
        recording=data.recording[centres],
        recordings=data.recordings,
        lag=lag,
        torque_constant=np.array([constants.get(name, np.nan) for name in data.names]),
        noise=_meter_noise(data, meters, reducer),
        whole=whole,
    )


def velocity_lag(data: AlignedDataset) -> Floats:
    """Return the lag of each drive's velocity behind its position, s [D], from these two alone.

    Regresses dq/dt − w on dw/dt below 12.5 Hz. InputError where velocity is not the rate of the
    position in the same unit.
    """
    reducer = Reducer(data.rate, _long_enough(data.segments(), data.rate))
    if not reducer.slices:
        return np.zeros(len(data.names))
    stretches, own = [*data.segments()], _columns(data.velocity)
    rate = reducer.reduce(rate_of(_columns(data.position), stretches, data.rate))
    velocity = reducer.reduce(own)
    acceleration = reducer.reduce(rate_of(own, stretches, data.rate))
    lags = np.zeros(len(data.names))
    for drive, name in enumerate(data.names):
        if velocity[:, drive].std() < 0.02 or not np.isfinite(rate[:, drive]).all():
            continue
        columns = np.stack([velocity[:, drive], acceleration[:, drive]], axis=1)
        (slope, lag), *_ = np.linalg.lstsq(columns, rate[:, drive], rcond=None)
        related = abs(np.corrcoef(velocity[:, drive], rate[:, drive])[0, 1]) > _RELATED
        plausible = 0.7 < slope < 1.4
        if not (related and plausible) and stands_still(data.position[:, drive]):
            continue
        if not plausible:
            raise InputError(
                f'{name}: the rate of position is {slope:.3g} times the velocity; '
                'are both in radians?'
            )
        lags[drive] = np.clip(lag, -_LAG_LIMIT, _LAG_LIMIT)
    return lags


def rate_of(values: Floats, stretches: Iterable[slice], rate: float) -> Floats:
    """Return the time derivative [T, D] of values inside each stretch, by central differences.

    rate: Hz. These differences keep energy: the sum of w·dw telescopes however fast w changes.
    """
    out = np.zeros_like(values)
    for part in stretches:
        if part.stop - part.start > 2:
            own, change = values[part], out[part]
            change[1:-1] = (own[2:] - own[:-2]) * (rate / 2.0)
            change[[0, -1]] = (own[[1, -1]] - own[[0, -2]]) * rate
    return out


def _long_enough(
    stretches: Iterable[slice], rate: float, window: float = 0.0
) -> tuple[slice, ...]:
    half = max(HALF_WIDTH, window / 2)
    least = 2 * (round(rate * (half + LATEST)) + 1) + round(rate * 0.5)
    return tuple(part for part in stretches if part.stop - part.start >= least)


def _cut(data: AlignedDataset, good: Bools) -> AlignedDataset:
    if good.all():
        return data
    hole = np.concatenate([[0], np.diff((~good).astype(np.int32)) > 0]).cumsum()
    segment = data.segment.astype(np.int64) * (int(hole.max()) + 1) + hole
    _, numbered = np.unique(segment, return_inverse=True)
    return replace(data, segment=numbered.astype(np.int32)).rows(good)


def _fill_voltage(data: AlignedDataset) -> AlignedDataset:
    voltage = np.asarray(data.voltage, dtype=np.float32)
    known = np.isfinite(voltage)
    if known.all():
        return data
    return with_voltage(data, float(np.nanmedian(voltage)) if known.any() else VOLTAGE)


def _meter_noise(data: AlignedDataset, meters: Floats, reducer: Reducer) -> Floats:
    """White noise of the power [T, M] after reduction, W [M], from its quietest half seconds."""
    length = max(16, round(data.rate / 2))
    share = float(np.sqrt(np.sum(np.square(reducer._taps(0.0)))))
    noise = np.full(meters.shape[1], np.nan)
    for meter in range(meters.shape[1]):
        spreads = []
        for part in data.segments():
            kinks = np.diff(meters[part, meter], n=2) / np.sqrt(6.0)
            whole = kinks[: len(kinks) // length * length].reshape(-1, length)
            spreads.append(whole[np.isfinite(whole).all(axis=1)].std(axis=1))
        joined = np.concatenate(spreads) if spreads else np.empty(0)
        joined = joined[joined > 0]
        if joined.size:
            noise[meter] = share * float(np.quantile(joined, 0.1))
    return noise
