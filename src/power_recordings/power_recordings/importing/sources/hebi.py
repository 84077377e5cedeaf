"""HEBI logs, read with hebi-py."""

from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, Final

import numpy as np
from wattwalk_core.errors import InputError

from power_recordings.importing.sources import arrays
from power_recordings.importing.sources.source import LogBlock, LogColumn, Progress, reading

_FIELDS: Final = (
    *('position', 'position_command', 'velocity', 'velocity_command', 'effort', 'effort_command'),
    *('voltage', 'motor_current', 'motor_winding_current', 'motor_winding_temperature'),
    *('motor_housing_temperature', 'deflection', 'hardware_receive_time', 'transmit_time'),
    *('receive_time', 'time'),
)


def open_file(path: Path, messages: Path | None = None) -> 'HebiLog':
    """Open a HEBI log; InputError where hebi-py is missing or the file is damaged."""
    return HebiLog(path)


class HebiLog:
    """Feedback of N modules: `field.module`."""

    is_bag = False

    def __init__(self, path: Path) -> None:
        with redirect_stdout(None):  # hebi tells of modules that it does not find
            from hebi.util import load_log

        self.path = path
        self.size = path.stat().st_size
        with reading(path, 'log'):
            log: Any = load_log(str(path))
            rows = [
                [np.array(getattr(feedback, field), np.float64) for field in _FIELDS]
                for feedback in log.feedback_iterate
            ]
        if not rows:
            raise InputError(f'{path}: no feedback in it')
        table = np.array(rows).reshape(len(rows), len(_FIELDS), -1)
        self._arrays = {
            f'{field}.{module}': table[:, i, module]
            for i, field in enumerate(_FIELDS)
            for module in range(table.shape[2])
            if np.isfinite(table[:, i, module]).any()
        }
        self._columns = [LogColumn(a, '', '', len(rows)) for a in self._arrays]

    def columns(self) -> Sequence[LogColumn]:
        """Return the columns that hold numbers."""
        return self._columns

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield rows."""
        yield from arrays.blocks(self._columns, addresses, self._arrays, self.size, progress)
