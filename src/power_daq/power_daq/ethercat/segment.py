"""The interface of an EtherCAT segment that the acquisition uses, and checks of it."""

from collections.abc import Callable, Sequence
from typing import Protocol

from power_daq.ethercat.terminals import SlaveIdentity, TerminalType, describe


class SegmentError(Exception):
    """A segment that is absent or not as the mapping demands; the message is one line."""


class EthercatSegment(Protocol):
    """An EtherCAT segment; slaves are counted from 0, which is next to the master."""

    def find(self) -> Sequence[SlaveIdentity]:
        """Open the interface and return the slaves' identities; SegmentError if none."""

    def read(self, slave: int, index: int, subindex: int) -> bytes:
        """Return the value of an object (SDO upload); SegmentError if it is refused."""

    def write(self, slave: int, index: int, subindex: int, value: bytes) -> None:
        """Set an object (SDO download); SegmentError if it is refused."""

    def operate(self) -> int:
        """Bring all slaves to OP; return the working counter of a complete exchange."""

    def exchange(self) -> int:
        """Open the interface and return the slaves' identities, else raise SegmentError."""

    def inputs(self, slave: int) -> bytes:
        """Return the input bytes of a slave in the last frame."""

    def close(self) -> None:
        """Bring the slaves that can be reached back to INIT and close the interface."""


def check_order(wanted: Sequence[TerminalType], found: Sequence[SlaveIdentity]) -> None:
    """Raise SegmentError for the first position with a wrong, missing or additional slave."""
    for place, kind in enumerate(wanted):
        if place >= len(found):
            raise SegmentError(
                f'{kind} should be at position {place}, but the segment ends after '
                f'{len(found)} of {len(wanted)} slaves: check cables and power behind it'
            )
        if not kind.is_it(found[place]):
            raise SegmentError(
                f'{kind} should be at position {place}, there is {describe(found[place])}'
            )
    if len(found) > len(wanted):
        raise SegmentError(
            f'{describe(found[len(wanted)])} at position {len(wanted)} is not in the mapping, '
            f'which ends after {len(wanted)}'
        )


def assert_settings(
    segment: EthercatSegment,
    wanted: Sequence[TerminalType],
    stopped: Callable[[], bool] = lambda: False,
) -> list[str]:
    """
    Write the terminals' settings where they differ, read them back, and list what was changed.

    Ends before the next setting once stopped() is true. SegmentError for a setting that cannot be
    changed: a filter would remove what is to be measured.
    """
    changed: list[str] = []
    for place, kind in enumerate(wanted):
        for index, subindex, value, meaning in kind.settings:
            if stopped():
                return changed
            if _read(segment, place, index, subindex) == value:
                continue
            segment.write(place, index, subindex, bytes([value]))
            found = _read(segment, place, index, subindex)
            if found != value:
                raise SegmentError(
                    f'{meaning} of {kind.name} at position {place} cannot be switched off: '
                    f'{index:#06x}:{subindex:02x} was set to {value} and is {found}'
                )
            changed.append(f'{meaning} of {kind.name} at {place} ({index:#06x}) switched off')
    return changed


def check_inputs(segment: EthercatSegment, wanted: Sequence[TerminalType]) -> None:
    """Raise SegmentError for a terminal whose process data have another size."""
    for place, kind in enumerate(wanted):
        size = len(segment.inputs(place))
        if size != kind.input_bytes:
            raise SegmentError(
                f'{kind.name} at position {place} has {size} bytes of inputs, not '
                f'{kind.input_bytes}: give it the standard process data with status '
                '(0x1C13 = 0x1A00, 0x1A02); revisions up to 0x0016 have none such'
            )


def _read(segment: EthercatSegment, slave: int, index: int, subindex: int) -> int:
    return int.from_bytes(segment.read(slave, index, subindex)[:1], 'little')
