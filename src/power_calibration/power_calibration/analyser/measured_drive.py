"""Electrical samples of one drive as curves over time."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from power_recordings.alignment.stream import Stream
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_calibration.analyser.curve import Curve

_MOST_BAD = 0.05


@dataclass(frozen=True)
class MeasuredDrive:
    """Voltage V and current A of a drive, at times in s after start_ns."""

    path: Path
    drive: str
    start_ns: int
    curve: Curve  # voltage, current
    calibration: str  # that the recording was made with, as its card names it
    notes: tuple[str, ...]

    @property
    def power(self) -> Curve:
        """Power as recorded, W."""
        return self.corrected(np.ones(2), np.zeros(2))

    def corrected(self, gain: Floats, offset: Floats) -> Curve:
        """Return power with gains and offsets of voltage and current [2], W."""
        runs = ((time, values * gain + offset) for time, values in self.curve.runs)
        return Curve(tuple((t, v[:, :1] * v[:, 1:]) for t, v in runs), self.curve.period)

    @classmethod
    def of(cls, recording: Recording, drive: str | None) -> 'MeasuredDrive':
        """Take one drive of a recording, its only one if None.

        InputError for a drive that was not measured, whose current is constant, or whose samples
        are out of range or NaN in over 5 %.
        """
        path, supply = recording.path, recording.drive_supply()
        measured = ', '.join(supply.names)
        if drive is None and len(supply.names) != 1:
            raise InputError(
                f'{path} measures {measured}: name the drive that the analyser measured, as '
                '--drive NAME'
            )
        name = supply.names[0] if drive is None else drive
        if name not in supply.names:
            raise InputError(f'--drive {name!r}: {path} measures {measured}')
        column = supply.names.index(name)
        volts, amps = supply.voltage[:, column], supply.current[:, column]
        flagged, bad = supply.status[:, column] != 0, ~supply.good[:, column]
        if bad.mean() > _MOST_BAD:
            what = 'were out of range' if flagged.mean() > _MOST_BAD else 'are NaN'
            raise InputError(
                f'{path}: {bad.mean():.0%} of the samples of {name} {what}; record again with '
                'less load'
            )
        if len(supply) < 100:
            raise InputError(f'{path} has only {len(supply)} samples of {name}')
        if float(np.ptp(amps[~bad])) < 1e-6:
            raise InputError(
                f'{path}: the current of {name} is constant ({amps[~bad][0]:g} A); record it in '
                'motion'
            )
        notes = []
        if bad.any():
            notes.append(f'{int(bad.sum())} of our samples are flagged or NaN and left out')
        if supply.lost:
            notes.append(f'{supply.lost} of our samples were lost')
        start = int(supply.stamp_ns[0])
        time = (supply.stamp_ns - start) / 1e9
        stream = Stream.of(time, np.zeros((len(time), 0), np.float32), bad, supply.after_gap)
        values = np.column_stack([volts, amps]).astype(np.float64)
        curve = Curve.of(time, values, stream.starts, stream.stops, stream.period)
        return cls(path, name, start, curve, recording.card.calibration, tuple(notes))
