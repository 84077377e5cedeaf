"""The supported EtherCAT terminals and the meaning of their process data.

EL3102: two differential inputs of ±10 V, 16 bit. Each channel has a status word and a value;
bits as in Beckhoff's documentation of the EL31xx, object 0x60n0 (AI inputs).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from drive_power_msgs.msg import DriveSupply

FULL_SCALE = 10.0 / 0x7FFF  # V per count

_UNDERRANGE, _OVERRANGE, _ERROR = 1 << 0, 1 << 1, 1 << 6
_INVALID, _TOGGLE = 1 << 14, 1 << 15
_FLAGS = (
    (_UNDERRANGE, DriveSupply.UNDERRANGE),
    (_OVERRANGE, DriveSupply.OVERRANGE),
    (_ERROR | _INVALID, DriveSupply.DEVICE_ERROR),
)


_SWITCHED_OFF = {
    0x01: 'user scaling',
    0x02: 'presentation other than signed',
    0x06: 'filter',
    0x0A: 'user calibration',
}
"""Settings of a channel, by subindex, with which it would measure something else."""


class SlaveIdentity(NamedTuple):
    """Identity of a slave by its EEPROM."""

    vendor: int
    product: int
    revision: int = 0
    name: str = ''


class ChannelReading(NamedTuple):
    """One channel in one cycle: V, flags of DriveSupply, the bit that toggles with each value."""

    volts: float
    flags: int
    toggle: bool
    valid: bool


@dataclass(frozen=True)
class TerminalType:
    """A type of slave: identity, and channels of four bytes of inputs each."""

    name: str
    vendor: int
    product: int
    channels: int = 0

    def __str__(self) -> str:
        return describe(SlaveIdentity(self.vendor, self.product))

    def settings(self) -> Iterator[tuple[int, int, str]]:
        """Yield index, subindex and meaning of the objects of one byte that have to be 0."""
        for channel in range(self.channels):
            for subindex, meaning in _SWITCHED_OFF.items():
                yield 0x8000 + 0x10 * channel, subindex, meaning

    def is_it(self, found: SlaveIdentity) -> bool:
        """Return whether a slave is of this type."""
        return (found.vendor, found.product) == (self.vendor, self.product)

    def channel(self, inputs: bytes, number: int) -> ChannelReading:
        """Return a channel, counted from 1, of the input bytes of one cycle."""
        start = 4 * (number - 1)
        status = int.from_bytes(inputs[start : start + 2], 'little')
        count = int.from_bytes(inputs[start + 2 : start + 4], 'little', signed=True)
        flags = sum(flag for mask, flag in _FLAGS if status & mask)
        return ChannelReading(
            count * FULL_SCALE, flags, bool(status & _TOGGLE), not status & _INVALID
        )


_KINDS = TerminalType('EK1100', 0x2, 0x044C2C52), TerminalType('EL3102', 0x2, 0x0C1E3052, 2)
TYPES: Mapping[str, TerminalType] = {kind.name: kind for kind in _KINDS}


def describe(found: SlaveIdentity) -> str:
    """Return name, vendor and product of a slave."""
    known = next((kind.name for kind in TYPES.values() if kind.is_it(found)), None)
    name = known or found.name or 'a slave'
    return f'{name} (vendor {found.vendor:#x}, product {found.product:#010x})'


class SegmentError(Exception):
    """A segment that is absent or not as the mapping demands; the message is one line."""
