"""Gain and offset of each measured channel, from the file that a calibration writes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from power_daq.cli import InputError

_QUANTITIES = ('voltage', 'current')
_RANGES: Mapping[str, tuple[float, float]] = {'gain': (0.1, 10.0), 'offset': (-100.0, 100.0)}


@dataclass(frozen=True)
class Calibration:
    """
    True value = gain · measured + offset, for voltage (V) and current (A): both [2, D].

    In the file: `channels: {LF_HAA.current: {gain: 1.01, offset: -0.02}, …}`; channels that are
    not there stay as they are.
    """

    gain: NDArray[np.float64]
    offset: NDArray[np.float64]

    @classmethod
    def load(cls, path: Path, drives: Sequence[str]) -> 'Calibration':
        """Read a file; InputError for what is no calibration of these drives."""
        gain, offset = np.ones((2, len(drives))), np.zeros((2, len(drives)))
        places = {
            f'{drive}.{quantity}': (row, column)
            for column, drive in enumerate(drives)
            for row, quantity in enumerate(_QUANTITIES)
        }
        for name, entry in _channels(path).items():
            if name not in places:
                raise InputError(
                    f'calibration {path}: unknown channel {name!r}; there are {", ".join(places)}'
                )
            if not isinstance(entry, dict):
                raise InputError(f'calibration {path}: {name}: expected gain and offset')
            gain[places[name]] = _number(path, name, entry, 'gain', 1.0)
            offset[places[name]] = _number(path, name, entry, 'offset', 0.0)
        return cls(gain, offset)


def _channels(path: Path) -> Mapping[str, object]:
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'cannot read calibration {path}: {error}') from error
    except yaml.YAMLError as error:
        reason = ' '.join(str(error).split())
        raise InputError(f'calibration {path} is no valid YAML: {reason}') from error
    channels = content.get('channels') if isinstance(content, dict) else None
    if not isinstance(channels, dict):
        raise InputError(f"calibration {path}: 'channels' with gains and offsets is missing")
    return channels


def _number(path: Path, name: str, entry: dict[str, object], key: str, default: float) -> float:
    value = entry.get(key, default)
    low, high = _RANGES[key]
    if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high:
        raise InputError(
            f'calibration {path}: {name}: {key} {value!r} is not a number from {low:g} to {high:g}'
        )
    return float(value)
