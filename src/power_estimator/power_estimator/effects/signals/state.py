"""Signals that effects are computed from."""

import itertools
from collections.abc import Callable, Hashable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats

from power_estimator.effects.signals.scale import DriveScale


class Carried:
    """States of effects with memory at each of the last samples, for data that come in blocks.

    Blocks may overlap: an effect begins with its state at the last sample before the block's.
    """

    def __init__(self) -> None:
        self._kept: dict[Hashable, tuple[Floats, Floats]] = {}
        self._unknown: dict[Hashable, float] = {}

    @property
    def used(self) -> bool:
        """True if an effect has kept a state."""
        return bool(self._kept)

    @property
    def unknown(self) -> float:
        """Largest share of a state that stems from before the first sample, 0 to 1."""
        return max(self._unknown.values(), default=0.0)

    def before(self, effect: Hashable, time: float) -> tuple[float, Floats] | None:
        """Return time (s) and state of an effect's last sample before a time, None without one."""
        times, states = self._kept.get(effect, (np.empty(0), np.empty(0)))
        row = int(np.searchsorted(times, time)) - 1
        return None if row < 0 else (float(times[row]), states[row])

    def keep(self, effect: Hashable, times: Floats, states: Floats, unknown: float) -> None:
        """Keep states [T, …] at times s [T]; unknown: their share from before the first sample."""
        before = self.before(effect, float(times[0]))
        if before is not None:
            times = np.concatenate([[before[0]], times])
            states = np.concatenate([before[1][None], states])
        self._kept[effect] = (times, states)
        self._unknown[effect] = unknown


@dataclass(frozen=True)
class Past:
    """All samples of the recordings that signals are pieces of, for effects with memory."""

    time: Floats  # s [P]
    segment: NDArray[np.int32]  # [P]
    recording: NDArray[np.int32]  # [P]
    torque: Floats  # N·m at the joint [P, D]
    rows: NDArray[np.intp]  # [T], those that the signals have

    def stretches(self) -> list[slice]:
        """Return the gap-free stretches, in order, as slices of samples."""
        return _runs(self.segment)


@dataclass(frozen=True)
class OtherDrives:
    """Power on the bus of a robot beside that of one of its drives, W [T, 1]."""

    _returned: Floats  # by all drives
    _drawn: Floats  # by all drives
    _own: Floats  # drawn by the one

    @classmethod
    def of(cls, drawn: Floats) -> 'OtherDrives':
        """Return the sums over all drives of the power W [T, D], negative where they return it."""
        returned = np.maximum(0.0, -drawn).sum(axis=1, keepdims=True)
        total = drawn.sum(axis=1, keepdims=True)
        return cls(returned, total, np.broadcast_to(0.0, total.shape))

    def beside(self, own: Floats) -> 'OtherDrives':
        """Return the power beside one of the drives, which draws `own`, W [T, 1]."""
        return replace(self, _own=own)

    def rows(self, rows: NDArray[np.intp]) -> 'OtherDrives':
        """Return the power at some rows [T] alone."""
        return OtherDrives(self._returned[rows], self._drawn[rows], self._own[rows])

    @property
    def returned(self) -> Floats:
        """Power that the others return together, W [T, 1]."""
        return self._returned - np.maximum(0.0, -self._own)

    @property
    def drawn(self) -> Floats:
        """Power that the others draw together, less what they return, W [T, 1]."""
        return self._drawn - self._own


@dataclass(frozen=True)
class Signals:
    """Signals of D drives at the rate at which products are formed, [T, D] unless said otherwise.

    motor_*, torque_cost and drawn are the model's own estimates so far: the
    motor's motion behind a spring, its torque including friction and rotor inertia, the slope of
    the losses by that torque, and the power drawn at the drive's input. They let an effect depend
    on what the other effects add.
    """

    rate: float  # Hz
    names: tuple[str, ...]  # D drives
    time: Floats  # s [T]
    segment: NDArray[np.int32]  # [T], stretches without gaps
    recording: NDArray[np.int32]  # [T]
    position: Floats  # rad
    velocity: Floats  # rad/s, lag of the sensor's filter removed
    acceleration: Floats  # rad/s²
    torque: Floats  # N·m at the joint
    torque_rate: Floats  # N·m/s
    voltage: Floats  # V
    temperature: Floats  # °C winding, NaN where not measured
    motor_velocity: Floats  # rad/s, of the motor in turns of the joint
    motor_acceleration: Floats  # rad/s²
    motor_torque: Floats  # N·m
    torque_cost: Floats  # W/(N·m), what more motor torque costs in losses
    electronics: Floats  # W, of the idle draw
    drawn: Floats  # W
    scale: DriveScale  # of the drives
    at_motor: Bools  # [D], torque is the motor's: friction and inertia are in it
    past: Past | None = None  # where these are pieces of longer recordings
    carried: Carried | None = None  # where these are one block after another
    motor_current: Floats | None = None  # A, beside the torque
    others: OtherDrives | None = None  # on the bus beside these, which share what it takes back
    steady: bool = False  # each row is an operating point: nothing changes, and nothing was before
    one_meter: bool = False  # for all drives
    velocity_noise: Floats | None = None  # rad/s, what a filter takes off the velocity

    @property
    def sliding(self) -> Floats:
        """Velocity of the motor without noise of the sensor, rad/s [T, D], as friction sees it."""
        noise = self.velocity_noise
        return self.motor_velocity if noise is None else self.motor_velocity - noise

    def rows(self, rows: NDArray[np.intp], segment: NDArray[np.int32]) -> 'Signals':
        """Return the samples at rows, in pieces numbered by segment [T], all samples as past."""
        past = Past(self.time, self.segment, self.recording, self.torque, rows)
        arrays = self._each_array(lambda values: values[rows])
        others = self.others and self.others.rows(rows)
        return replace(self, **arrays | {'segment': segment, 'past': past, 'others': others})

    def drive(self, index: int) -> 'Signals':
        """Return the signals of one drive, D = 1; `others` is then the power beside it."""
        past = self.past
        if past is not None:
            past = replace(past, torque=np.ascontiguousarray(past.torque[:, index : index + 1]))

        def column(values: NDArray[Any]) -> NDArray[Any]:
            if values.ndim < 2:
                return values
            own = values[:, index : index + 1]
            return own if own.strides[0] in (0, own.itemsize) else np.ascontiguousarray(own)

        return replace(
            self,
            names=(self.names[index],),
            scale=self.scale.take([index]),
            past=past,
            others=self._together.beside(column(self.drawn))
            if len(self.names) > 1
            else self.others,
            **self._each_array(column) | {'at_motor': self.at_motor[[index]]},
        )

    @cached_property
    def _together(self) -> OtherDrives:
        return OtherDrives.of(self.drawn)

    def _each_array(self, function: Callable[[NDArray[Any]], NDArray[Any]]) -> dict[str, Any]:
        """Return the arrays [T, …] changed by a function; fields that are one array stay one."""
        found: dict[str, Any] = {}
        known: dict[int, NDArray[Any]] = {}
        for name in (f.name for f in fields(self) if f.name != 'at_motor'):
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                if id(value) not in known:
                    known[id(value)] = function(value)
                found[name] = known[id(value)]
        return found

    def stretches(self) -> list[slice]:
        """Return the gap-free stretches, in order, as slices of samples."""
        return _runs(self.segment)

    def by_recording(self) -> list[slice]:
        """Return the samples of each recording, in order, as slices."""
        return _runs(self.recording)


def _runs(values: NDArray[np.int32]) -> list[slice]:
    """Runs of equal values."""
    borders = np.flatnonzero(values[1:] != values[:-1]) + 1
    edges = [0, *borders.tolist(), len(values)]
    return [slice(start, stop) for start, stop in itertools.pairwise(edges) if stop > start]
