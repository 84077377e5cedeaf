"""HEBI logs, read with hebi-py."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import printable

from power_recordings.importing.sources import arrays
from power_recordings.importing.sources.source import LogBlock, LogColumn, Progress

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
        from hebi.util import load_log

        self.path = path
        self.size = path.stat().st_size
        try:
            log: Any = load_log(str(path))
            rows = [
                [np.array(getattr(feedback, field), np.float64) for field in _FIELDS]
                for feedback in log.feedback_iterate
            ]
        except (OSError, ValueError, RuntimeError, TypeError) as error:
            raise InputError(f'{path}: not a readable log: {printable(str(error))}') from None
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
