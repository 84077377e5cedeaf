"""
Operating points of a recording whose card says `steady`.

Representation: the points stand one after another at the nominal rate that was asked for, each a
segment, as they were recorded: nothing is filtered, interpolated or cut at gaps. Their order and
their times mean nothing; `AlignedDataset.steady` says so to whatever needs time (inertia, springs,
delays, heat).
"""

from typing import Any

import numpy as np
from wattwalk_core.errors import InputError

from power_recordings.alignment.dataset import DRIVE_SIGNALS, AlignedDataset
from power_recordings.alignment.signals import RecordedSignals
from power_recordings.alignment.stream import Stream

_FEWEST = 4


def operating_points(source: RecordedSignals, rate: float) -> AlignedDataset:
    """Return the points at which torque, speed and (where it was measured) power are known."""
    time = source.joints.time
    found = source.sample(time, Stream.recorded)
    known = np.isfinite(found['velocity']).all(axis=1) & np.isfinite(found['torque']).all(axis=1)
    if source.measured:
        columns = [source.names.index(name) for name in source.measured]
        known &= np.isfinite(found['power'][:, columns]).all(axis=1)
    rows = np.flatnonzero(known)
    if len(rows) < _FEWEST:
        raise InputError(
            f'{source.path}: {len(rows)} of {len(time)} operating points have torque, speed and '
            'power'
        )
    left_out = len(time) - len(rows)
    notes = (f'{source.path}: {left_out} operating points with NaN left out',) if left_out else ()
    kept: dict[str, Any] = {name: values[rows] for name, values in found.items()}
    return AlignedDataset(
        rate=rate,
        names=source.names,
        time=source.start_ns / 1e9 + np.arange(len(rows)) / rate,
        segment=np.arange(len(rows), dtype=np.int32),
        supply=kept.pop('supply')[:, 0],
        recordings=(str(source.path),),
        recording=np.zeros(len(rows), np.int32),
        notes=(*(f'{source.path}: {note}' for note in source.notes), *notes),
        steady=True,
        **source.facts,
        **{name: kept[name] for name in (*DRIVE_SIGNALS, 'motor_current') if name in kept},
    )
