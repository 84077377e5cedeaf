"""An EtherCAT slave controller: memory, addressing, sync managers, FMMUs, EEPROM, state machine.

Register addresses and rules are those of ETG.1000 part 4 (data link layer) and part 6 (state
machine), as far as a master needs them to bring a slave with inputs to OP. Not there:
distributed clocks, outputs, watchdogs, interrupts, hot-connect groups.
"""

from enum import IntEnum
from typing import Final

MEMORY: Final = 0x2000
_STATION: Final = 0x0010
_DL_STATUS: Final = 0x0110
_AL_CONTROL, _AL_STATUS, _AL_CODE = 0x0120, 0x0130, 0x0134
_EEPROM: Final = 0x0502
_EEPROM_DATA: Final = 0x0508
_FMMU: Final = 0x0600
_SM: Final = 0x0800
_FULL: Final = 0x08
_READS_8_BYTES: Final = 0x40


class DatagramCommand(IntEnum):
    """Commands of EtherCAT datagrams."""

    NOP = 0
    APRD = 1
    APWR = 2
    APRW = 3
    FPRD = 4
    FPWR = 5
    FPRW = 6
    BRD = 7
    BWR = 8
    BRW = 9
    LRD = 10
    LWR = 11
    LRW = 12


_POSITION = (DatagramCommand.APRD, DatagramCommand.APWR, DatagramCommand.APRW)
_BROADCAST = (DatagramCommand.BRD, DatagramCommand.BWR, DatagramCommand.BRW)
_READS = (DatagramCommand.APRD, DatagramCommand.FPRD, DatagramCommand.BRD)
_WRITES = (DatagramCommand.APWR, DatagramCommand.FPWR, DatagramCommand.BWR)


class SlaveState(IntEnum):
    """States of the application layer."""

    INIT = 1
    PREOP = 2
    BOOT = 3
    SAFEOP = 4
    OP = 8


_ERROR, _ACKNOWLEDGE = 0x10, 0x10
_INVALID_CHANGE, _UNKNOWN_STATE = 0x0011, 0x0012
_INVALID_MAILBOX, _INVALID_INPUTS = 0x0016, 0x001E


class SlaveController:
    """EtherCAT slave controller as seen by a frame.

    sii: the EEPROM's bytes. inputs: number of the inputs' sync manager and size of the inputs in
    bytes; None for a slave without. Subclasses override `mailbox`, `inputs_read` and `enter`.
    """

    def __init__(self, sii: bytes, inputs: tuple[int, int] | None = None) -> None:
        self._sii = sii + b'\xff' * 16
        self._inputs = inputs
        self.present = True
        self.memory = bytearray(MEMORY)
        self.power_on()

    def power_on(self) -> None:
        """Reset memory and state, as after a loss of supply."""
        self.memory[:] = bytes(MEMORY)
        self.memory[0x0000:0x0010] = bytes((0x11, 0, 0, 0, 8, 8, 8, 0x0F, *([0] * 8)))
        self._set(_DL_STATUS, 0x5A00 | 0x0030)
        self._set(_EEPROM, _READS_8_BYTES)
        self._set(_AL_STATUS, SlaveState.INIT)
        self._set(_AL_CODE, 0)

    @property
    def state(self) -> int:
        """AL state; 0x10 is added where the last change was refused."""
        return self.memory[_AL_STATUS]

    def mailbox(self, request: bytes) -> bytes | None:
        """Return the answer to a mailbox message, b'' for none; None without a mailbox."""
        return None

    def inputs_read(self) -> None:
        """Called after a frame has fetched the inputs; does nothing here."""

    def enter(self, state: int) -> None:
        """Called with the new `SlaveState` after a state change; does nothing here."""

    def serve(self, command: int, address: int, offset: int, data: bytearray) -> tuple[int, int]:
        """Process a datagram with a `DatagramCommand`; data is changed in place.

        address, offset: the two 16-bit halves of the datagram's address. Returns the address for
        the next slave and the increment of the working counter.
        """
        if command in (DatagramCommand.LRD, DatagramCommand.LWR, DatagramCommand.LRW):
            return address, self._logical(command, address | offset << 16, data)
        if command in _POSITION or command in _BROADCAST:
            after = (address + 1) & 0xFFFF
            mine = command in _BROADCAST or address == 0
        else:
            after = address
            mine = address == self._get(_STATION)
        if not mine:
            return after, 0
        if command in _READS:
            return after, int(self._read(offset, data, command in _BROADCAST))
        if command in _WRITES:
            return after, int(self._write(offset, bytes(data)))
        return after, 0

    def _get(self, address: int, size: int = 2) -> int:
        return int.from_bytes(self.memory[address : address + size], 'little')

    def _set(self, address: int, value: int) -> None:
        self.memory[address : address + 2] = int(value).to_bytes(2, 'little')

    def _manager(self, number: int) -> tuple[int, int, bool]:
        """Return start, length and activation of a sync manager."""
        at = _SM + 8 * number
        return self._get(at), self._get(at + 2), bool(self.memory[at + 6] & 1)

    def _read(self, offset: int, data: bytearray, merge: bool) -> bool:
        end = offset + len(data)
        if end > MEMORY:
            return False
        start, length, active = self._manager(1)
        mailbox = active and start <= offset < start + length
        if mailbox and not self.memory[_SM + 8 + 5] & _FULL:
            return False
        found = self.memory[offset:end]
        data[:] = bytes(a | b for a, b in zip(data, found, strict=True)) if merge else found
        if mailbox and end >= start + length:
            self.memory[_SM + 8 + 5] &= ~_FULL
        return True

    def _write(self, offset: int, data: bytes) -> bool:
        end = offset + len(data)
        if end > MEMORY:
            return False
        status = {_SM + 8 * n + 5: self.memory[_SM + 8 * n + 5] for n in range(8)}
        kept = {**status, **{at: self.memory[at] for at in range(_AL_STATUS, _AL_CODE + 2)}}
        self.memory[offset:end] = data
        for at, value in kept.items():
            self.memory[at] = value
        if offset <= _AL_CONTROL < end:
            self._change_state(self.memory[_AL_CONTROL])
        if offset <= _EEPROM < end:
            self._read_eeprom()
        start, length, active = self._manager(0)
        if active and length and offset <= start + length - 1 < end:
            self._take_mailbox(bytes(self.memory[start : start + length]))
        return True

    def _take_mailbox(self, request: bytes) -> None:
        answer = self.mailbox(request)
        start, length, active = self._manager(1)
        if not answer or not active:
            return
        self.memory[start : start + length] = answer.ljust(length, b'\0')[:length]
        self.memory[_SM + 8 + 5] |= _FULL

    def _read_eeprom(self) -> None:
        command = self._get(_EEPROM)
        at = 2 * self._get(_EEPROM + 2)
        if command & 0x0700 == 0x0100:
            found = self._sii[at : at + 8].ljust(8, b'\xff')
            self.memory[_EEPROM_DATA : _EEPROM_DATA + 8] = found
        self._set(_EEPROM, _READS_8_BYTES)

    def _change_state(self, control: int) -> None:
        wanted, before = control & 0x0F, self.state & 0x0F
        if self.state & _ERROR and not control & _ACKNOWLEDGE:
            return
        code = self._objection(before, wanted)
        self._set(_AL_STATUS, before | _ERROR if code else wanted)
        self._set(_AL_CODE, code)
        if not code:
            self.enter(wanted)

    def _objection(self, before: int, wanted: int) -> int:
        """Return the AL status code that refuses a change of state; 0 if it is allowed."""
        order: list[int] = [SlaveState.INIT, SlaveState.PREOP, SlaveState.SAFEOP, SlaveState.OP]
        if wanted not in order:
            return _UNKNOWN_STATE
        if order.index(wanted) > order.index(before) + 1:
            return _INVALID_CHANGE
        has_mailbox = self.mailbox(b'') is not None
        if wanted == SlaveState.PREOP and before == SlaveState.INIT and has_mailbox:
            (_, out, sends), (_, back, receives) = self._manager(0), self._manager(1)
            if not (sends and receives and out and back):
                return _INVALID_MAILBOX
        if wanted == SlaveState.SAFEOP and before == SlaveState.PREOP and self._inputs is not None:
            number, size = self._inputs
            _, length, active = self._manager(number)
            if not active or length != size:
                return _INVALID_INPUTS
        return 0

    def _logical(self, command: int, address: int, data: bytearray) -> int:
        """Return the working counter: 1 for a read of inputs, since there are no outputs."""
        exchanges = self.state & 0x0F in (SlaveState.SAFEOP, SlaveState.OP)
        if command == DatagramCommand.LWR or not exchanges:
            return 0
        hit = False
        for number in range(8):
            at = _FMMU + 16 * number
            entry = self.memory[at : at + 16]
            if not (entry[12] & 1 and entry[11] & 1):
                continue
            start, size = self._get(at, 4), self._get(at + 4)
            physical = self._get(at + 8)
            low, high = max(start, address), min(start + size, address + len(data))
            if low < high:
                found = self.memory[physical + low - start : physical + high - start]
                data[low - address : high - address] = found
                hit = True
        if hit:
            self.inputs_read()
        return int(hit)
