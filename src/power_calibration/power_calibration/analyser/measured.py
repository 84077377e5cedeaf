"""Our own measurement of one drive, as curves over time."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.stream import Stream
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

from power_calibration.analyser.curve import Curve

Floats = NDArray[np.float64]
_MOST_BAD = 0.05


@dataclass(frozen=True)
class Measured:
    """Voltage V and current A of a drive, s after start_ns."""

    path: Path
    drive: str
    start_ns: int
    curve: Curve  # voltage, current
    calibration: str  # what the card says of corrections that were applied
    notes: tuple[str, ...]

    @property
    def power(self) -> Curve:
        """W."""
        return Curve(
            tuple((t, (v[:, 0] * v[:, 1])[:, None]) for t, v in self.curve.runs),
            self.curve.period,
        )

    def corrected(self, gain: Floats, offset: Floats) -> Curve:
        """Power with gains and offsets of voltage and current, W."""
        runs = []
        for time, values in self.curve.runs:
            true = values * gain + offset
            runs.append((time, (true[:, 0] * true[:, 1])[:, None]))
        return Curve(tuple(runs), self.curve.period)

    @classmethod
    def of(cls, recording: Recording, drive: str | None) -> 'Measured':
        """
        One drive of a recording, its only one if None.

        InputError for a drive that was not measured, or that stood still, was out of range or
        NaN in over 5 % of the samples.
        """
        supply = recording.drive_supply()
        if drive is None and len(supply.names) != 1:
            raise InputError(
                f'{recording.path} measures {", ".join(supply.names)}: say which of them the '
                'analyser saw, as --drive NAME'
            )
        name = supply.names[0] if drive is None else drive
        if name not in supply.names:
            raise InputError(
                f'--drive {name!r}: {recording.path} measures {", ".join(supply.names)}'
            )
        column = supply.names.index(name)
        volts, amps = supply.voltage[:, column], supply.current[:, column]
        values = np.column_stack([volts, amps]).astype(np.float64)
        flagged, bad = supply.status[:, column] != 0, ~supply.good[:, column]
        if bad.mean() > _MOST_BAD:
            what = 'were out of range' if flagged.mean() > _MOST_BAD else 'are NaN'
            raise InputError(
                f'{recording.path}: {bad.mean():.0%} of the samples of {name} {what}; record '
                'again with less load'
            )
        if len(supply) < 100:
            raise InputError(f'{recording.path} has only {len(supply)} samples of {name}')
        good = values[~bad]
        if float(good[:, 1].max() - good[:, 1].min()) < 1e-6:
            raise InputError(
                f'{recording.path}: the current of {name} is constant ({good[0, 1]:g} A); move it'
            )
        notes = (
            [f'{int(bad.sum())} of our samples are flagged or NaN; left out'] if bad.any() else []
        )
        start = int(supply.stamp_ns[0])
        time = (supply.stamp_ns - start) / 1e9
        stream = Stream.of(time, np.zeros((len(time), 0), np.float32), bad, supply.after_gap)
        if supply.lost:
            notes.append(f'{supply.lost} of our samples were lost')
        curve = Curve.of(time, values, stream.starts, stream.stops, stream.period)
        return cls(recording.path, name, start, curve, recording.card.calibration, tuple(notes))
