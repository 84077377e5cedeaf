"""Aligned arrays: the form in which measured signals reach models."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from wattwalk_core.arrays import Bools, Floats, Singles

DRIVE_SIGNALS = (
    *('position', 'velocity', 'torque', 'command'),
    *('power', 'voltage', 'current', 'temperature'),
)
"""Names of the signals [T, D] of an AlignedDataset."""


@dataclass(frozen=True)
class AlignedDataset:
    """Signals of D drives on one time grid of T samples.

    A segment is a stretch without gaps; filters, networks and derivatives stop at its borders.
    Signals that were not recorded are NaN.
    """

    rate: float  # Hz
    names: tuple[str, ...]  # D drives
    time: Floats  # s [T], measurement time in ROS time
    segment: NDArray[np.int32]  # [T], counts up over all recordings
    position: Singles  # rad [T, D]
    velocity: Singles  # rad/s [T, D]
    torque: Singles  # N·m [T, D], at the joint; see motor_torque and current_as_torque
    command: Singles  # rad [T, D], position target in force (zero-order hold)
    power: Singles  # W [T, D], mean of voltage × current, positive = drawn by the drive
    voltage: Singles  # V [T, D]
    current: Singles  # A [T, D]
    temperature: Singles  # °C [T, D], winding
    supply: Singles  # W [T], drawn by the whole robot
    recordings: tuple[str, ...]  # where the samples come from
    recording: NDArray[np.int32]  # [T], index into recordings
    extras: Mapping[str, Singles] = field(default_factory=dict)  # other signals by topic [T, ...]
    notes: tuple[str, ...] = ()  # on what was left out of the recordings
    motor_torque: frozenset[str] = frozenset()  # drives whose torque is the motor's
    current_as_torque: frozenset[str] = frozenset()  # of these, drives that have A for N·m
    motor_current: Singles | None = None  # A [T, D] beside the torque; None of no drive
    computed_power: frozenset[str] = frozenset()  # drives whose power a firmware computes
    steady: bool = False  # each row is an operating point: no row follows on the one before

    @classmethod
    def blank(
        cls,
        rate: float,
        names: Sequence[str],
        time: ArrayLike,
        recording: str,
        **signals: ArrayLike,
    ) -> 'AlignedDataset':
        """Return one segment of one recording in which all signals but those given are NaN.

        time: s [T]. signals: of DRIVE_SIGNALS, broadcast to [T, D].
        """
        times = np.asarray(time, np.float64)
        shape = (len(times), len(names))
        nothing = np.full(shape, np.nan, np.float32)
        values: dict[str, Any] = dict.fromkeys(DRIVE_SIGNALS, nothing)
        values |= {name: np.full(shape, given, np.float32) for name, given in signals.items()}
        return cls(
            rate=rate,
            names=tuple(names),
            time=times,
            segment=np.zeros(len(times), np.int32),
            supply=np.full(len(times), np.nan, np.float32),
            recordings=(recording,),
            recording=np.zeros(len(times), np.int32),
            **values,
        )

    @property
    def position_error(self) -> Singles:
        """Target minus position, rad [T, D]."""
        return self.command - self.position

    def rows(self, index: slice | Bools | NDArray[np.intp]) -> 'AlignedDataset':
        """Return the dataset with only the rows at `index`: a slice, a mask [T] or integers."""
        arrays = {
            f.name: getattr(self, f.name)[index]
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        extras = {name: values[index] for name, values in self.extras.items()}
        return replace(self, **arrays, extras=extras)

    def drives(self, names: Sequence[str]) -> 'AlignedDataset':
        """Return the dataset of the named drives, in that order; KeyError for an unknown one."""
        if missing := [name for name in names if name not in self.names]:
            raise KeyError(f'no drive {missing[0]!r}; there are {", ".join(self.names)}')
        if tuple(names) == self.names:
            return self
        columns = [self.names.index(name) for name in names]
        own = (*DRIVE_SIGNALS, *(('motor_current',) if self.motor_current is not None else ()))
        per_drive = {name: getattr(self, name)[:, columns] for name in own}
        return replace(self, names=tuple(names), **per_drive)

    def measured_drives(self) -> tuple[str, ...]:
        """Return the names of drives with a finite power in at least one sample."""
        return tuple(self.names[i] for i in np.flatnonzero(np.isfinite(self.power).any(axis=0)))

    def segments(self) -> Iterator[slice]:
        """Yield each segment, in order, as a slice of the T samples."""
        borders = np.flatnonzero(np.diff(self.segment)) + 1
        for start, stop in pairwise([0, *borders.tolist(), len(self.time)]):
            if stop > start:
                yield slice(start, stop)
