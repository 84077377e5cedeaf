"""HEBI logs, read with hebi-py."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from power_recordings.importing.sources.heads import ArrayLog
from power_recordings.importing.sources.isolated import load_isolated
from power_recordings.importing.sources.source import LogSource, reading

_FIELDS: Final = (
    *('position', 'position_command', 'velocity', 'velocity_command', 'effort', 'effort_command'),
    *('voltage', 'motor_current', 'motor_winding_current', 'motor_winding_temperature'),
    *('motor_housing_temperature', 'deflection', 'hardware_receive_time', 'transmit_time'),
    *('receive_time', 'time'),
)


def open_file(path: Path) -> LogSource:
    """Open a HEBI log; InputError where it is damaged."""
    return ArrayLog(path, load_isolated('hebi', path, 'log'))


def load(path: Path) -> dict[str, NDArray[Any]]:
    """Return feedback arrays [N] by `field.module`; InputError for a damaged file."""
    from hebi.util import load_log  # in a process of its own

    with reading(path, 'log'):
        log: Any = load_log(str(path))
        rows = [
            [np.array(getattr(feedback, field), np.float64) for field in _FIELDS]
            for feedback in log.feedback_iterate
        ]
        if not rows:
            raise ValueError('no feedback in it')
        table = np.array(rows).reshape(len(rows), len(_FIELDS), -1)
    return {
        f'{field}.{module}': table[:, i, module]
        for i, field in enumerate(_FIELDS)
        for module in range(table.shape[2])
        if np.isfinite(table[:, i, module]).any()
    }
