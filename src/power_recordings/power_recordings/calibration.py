"""Gain and offset of each measured channel, and the file that a calibration writes."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from wattwalk_core.errors import InputError
from wattwalk_core.files import advice, write_whole

NONE = 'none'
"""What a card says of a recording that no calibration was applied to."""
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
        for name, entry in channels_of(path).items():
            if name not in places:
                raise InputError(
                    f'calibration {path}: unknown channel {name!r}; there are {", ".join(places)}'
                )
            if not isinstance(entry, dict):
                raise InputError(f'calibration {path}: {name}: expected gain and offset')
            gain[places[name]] = _number(path, name, entry, 'gain', 1.0)
            offset[places[name]] = _number(path, name, entry, 'offset', 0.0)
        return cls(gain, offset)


def label(path: Path) -> str:
    """What a card says of a calibration: its file's name and the start of its SHA-256."""
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f'cannot read calibration {path}: {advice(error)}') from error
    return f'{path.name} (sha256 {digest[:12]})'


def onto(
    old: Mapping[str, object], new: Mapping[str, Mapping[str, Any]], path: Path
) -> dict[str, dict[str, Any]]:
    """
    Channels for recordings in which the old ones were applied already; path: the old ones' file.

    true = new gain · (old gain · raw + old offset) + new offset; intervals are those of the new.
    """
    joined: dict[str, dict[str, Any]] = {}
    for name, entry in new.items():
        before = old.get(name, {})
        if not isinstance(before, dict):
            raise InputError(f'calibration {path}: {name}: expected gain and offset')
        gain = _number(path, name, before, 'gain', 1.0)
        offset = _number(path, name, before, 'offset', 0.0)
        shift = entry['gain'] * offset
        joined[name] = {
            **entry,
            'gain': entry['gain'] * gain,
            'gain_interval': [gain * edge for edge in entry['gain_interval']],
            'offset': entry['offset'] + shift,
            'offset_interval': [edge + shift for edge in entry['offset_interval']],
        }
    return joined


def save(path: Path, channels: Mapping[str, object], about: Mapping[str, object]) -> None:
    """Write a file that `Calibration.load` reads; `about` says where it comes from."""
    content = {'channels': dict(channels), **about}
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None)
    write_whole(path, '# true value = gain · measured + offset\n' + text)


def channels_of(path: Path) -> Mapping[str, object]:
    """The channels of a file by name; InputError for what is no calibration."""
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
