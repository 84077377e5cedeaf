"""Gain and offset of each measured channel, and the file that a calibration writes."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError
from wattwalk_core.files import advice, write_whole
from wattwalk_core.schema import Quantity, parse, schema
from wattwalk_core.yaml_file import dump_yaml, read_yaml

NONE = 'none'  # entry `calibration` of the card of a recording to which none was applied
_QUANTITIES = ('voltage', 'current')


@schema
class ChannelCorrection:
    """True value = gain · measured + offset (V or A), with confidence intervals where known."""

    gain: Annotated[float, Quantity(0.1, 10.0)] = 1.0
    offset: Annotated[float, Quantity(-100.0, 100.0)] = 0.0
    gain_interval: tuple[float, float] | None = None
    offset_interval: tuple[float, float] | None = None


@dataclass(frozen=True)
class Calibration:
    """Corrections of voltage (V) and current (A): true value = gain · measured + offset, [2, D].

    In the file: `channels: {LF_HAA.current: {gain: 1.01, offset: -0.02}, …}`; channels that it
    does not name are not changed.
    """

    gain: Floats
    offset: Floats

    @classmethod
    def load(cls, path: Path, drives: Sequence[str]) -> 'Calibration':
        """Read a file for drives [D]; InputError if unreadable, or for a channel of others."""
        gain, offset = np.ones((2, len(drives))), np.zeros((2, len(drives)))
        places = {
            f'{drive}.{quantity}': (row, column)
            for column, drive in enumerate(drives)
            for row, quantity in enumerate(_QUANTITIES)
        }
        for name, channel in read_channels(path)[1].items():
            if name not in places:
                raise InputError(
                    f'calibration {path}: unknown channel {name!r}; there are {", ".join(places)}'
                )
            gain[places[name]], offset[places[name]] = channel.gain, channel.offset
        return cls(gain, offset)


def label(path: Path) -> str:
    """Return a calibration file's entry in a card, name and hash; InputError if unreadable."""
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f'cannot read calibration {path}: {advice(error)}') from error
    return f'{path.name} (sha256 {digest[:12]})'


def onto(path: Path, channels: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Combine new corrections with those of the file that was applied while they were measured.

    true = new gain · (old gain · raw + old offset) + new offset. channels: as in the file, by
    `drive.quantity`; intervals are the new ones, rescaled. InputError as of `Calibration.load`.
    """
    old = read_channels(path)[1]
    joined: dict[str, dict[str, Any]] = {}
    for name, new in channels.items():
        before = old.get(name, ChannelCorrection())
        shift = new['gain'] * before.offset
        joined[name] = {
            **new,
            'gain': new['gain'] * before.gain,
            'gain_interval': [before.gain * edge for edge in new['gain_interval']],
            'offset': new['offset'] + shift,
            'offset_interval': [edge + shift for edge in new['offset_interval']],
        }
    return joined


def save(path: Path, channels: Mapping[str, object], about: Mapping[str, object]) -> None:
    """Write a file that `Calibration.load` reads; `about`: further entries, on its origin."""
    text = dump_yaml({'channels': dict(channels), **about}, short_lists=True)
    write_whole(path, '# true value = gain · measured + offset\n' + text)


def read_channels(path: Path) -> tuple[dict[str, object], dict[str, ChannelCorrection]]:
    """Return a file's entries by channel, unparsed and parsed; InputError as of `load`."""
    content = read_yaml(path, 'calibration')
    channels = content.get('channels') if isinstance(content, dict) else None
    if not isinstance(channels, dict):
        raise InputError(f"calibration {path}: 'channels' with gains and offsets is missing")
    return channels, parse(dict[str, ChannelCorrection], channels, f'calibration {path}: channels')
