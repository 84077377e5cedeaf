"""What the acquisition needs of an EtherCAT segment, whoever drives it."""

from collections.abc import Callable, Sequence
from typing import Protocol

from power_daq.ethercat.terminals import SlaveIdentity, TerminalType, describe


class SegmentError(Exception):
    """The segment is not there or not as it should be; the message is one line."""


class EthercatSegment(Protocol):
    """An EtherCAT segment whose slaves are counted from 0, the first behind the master."""

    def find(self) -> Sequence[SlaveIdentity]:
        """Open the interface and count the slaves; SegmentError where there is none."""

    def read(self, slave: int, index: int, subindex: int) -> bytes:
        """Value of an object (SDO upload); SegmentError where it is refused."""

    def write(self, slave: int, index: int, subindex: int, value: bytes) -> None:
        """Set an object (SDO download); SegmentError where it is refused."""

    def operate(self) -> int:
        """Map process data, bring all to OP; the working counter of a whole exchange."""

    def exchange(self) -> int:
        """One frame of process data; its working counter, negative where none came back."""

    def inputs(self, slave: int) -> bytes:
        """Input bytes of a slave as the last frame left them."""

    def close(self) -> None:
        """Bring the slaves back to INIT, if they still hear, and leave the interface."""


def check_order(wanted: Sequence[TerminalType], found: Sequence[SlaveIdentity]) -> None:
    """SegmentError for the first place at which the wrong slave is, or none, or one too many."""
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
    Make every setting of the terminals hold, and read it back; what was changed, in words.

    Ends before the next setting once stopped says so.
    SegmentError where one cannot be made to hold: a filter would eat what is to be measured.
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
    """SegmentError where a terminal's process data are not those that are understood."""
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
