"""EK1100 and EL3102 as a master finds them: EEPROM, CoE objects, process data.

Identities, objects and process data follow Beckhoff's documentation of the EL31xx (revisions
from 0x0016 on); the EEPROM follows ETG.2010. The converter is ideal: 16 bit over ±10 V.
"""

import argparse
import socket
import struct
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass

from wattwalk_core.errors import InputError

from sim_bridge.instruments.ethercat.controller import SlaveController, SlaveState

_VENDOR = 0x2
_EK1100, _EL3102 = 0x044C2C52, 0x0C1E3052
_REVISION = 0x00160000
_MAILBOX = (0x1000, 128), (0x1080, 128)
_INPUTS = 0x1180
_COE = 3
_SDO_REQUEST, _SDO_RESPONSE = 2, 3
_ABORT_NO_OBJECT, _ABORT_READ_ONLY, _ABORT_COMMAND = 0x06020000, 0x06010002, 0x05040001

Volts = tuple[float, float]


def _category(kind: int, content: bytes) -> bytes:
    content += b'\0' * (len(content) % 2)
    return struct.pack('<HH', kind, len(content) // 2) + content


def _eeprom(name: str, product: int, revision: int, mailbox: bool) -> bytes:
    """Return the SII: fixed words up to 0x40, then categories."""
    words = bytearray(0x80)
    struct.pack_into('<LLL', words, 0x10, _VENDOR, product, revision)
    categories = _category(10, bytes((1, len(name))) + name.encode('ascii'))
    general = bytearray(32)
    general[3] = 1
    if mailbox:
        (out, out_size), (back, back_size) = _MAILBOX
        struct.pack_into('<HHHHH', words, 0x30, out, out_size, back, back_size, 0x04)
        general[5] = 0x01
    categories += _category(30, bytes(general))
    if mailbox:
        managers = (
            (*_MAILBOX[0], 0x26, 0, 1, 1),
            (*_MAILBOX[1], 0x22, 0, 1, 2),
            (0x1100, 0, 0x24, 0, 0, 3),
            (_INPUTS, 8, 0x20, 0, 1, 4),
        )
        categories += _category(40, bytes((1, 2, 3, 0)))
        categories += _category(41, b''.join(struct.pack('<HHBBBB', *m) for m in managers))
    return bytes(words) + categories + b'\xff\xff\xff\xff'


class EK1100(SlaveController):
    """The coupler: no mailbox, no process data."""

    def __init__(self) -> None:
        super().__init__(_eeprom('EK1100', _EK1100, 0x00120000, mailbox=False))


@dataclass
class TerminalFaults:
    """Faults of a terminal, for tests: no new conversions, status invalid, filter stays on."""

    frozen: bool = False
    invalid: bool = False
    filter_sticks: bool = False


def _pdo(channel: int) -> tuple[int, ...]:
    """Return the entries of 0x1A00 or 0x1A02: index, subindex and bits of status and value."""
    index = 0x6000 + 0x10 * (channel - 1)
    fields = ((1, 1), (2, 1), (3, 2), (5, 2), (7, 1), (None, 6), (14, 1), (15, 1), (16, 1))
    entries = [
        bits if subindex is None else index << 16 | subindex << 8 | bits
        for subindex, bits in fields
    ]
    return (*entries, index << 16 | 17 << 8 | 16)


class EL3102(SlaveController):
    """Terminal with two inputs; a function gives their voltages (V) at each conversion.

    With the filter off, as it must be, a conversion is triggered by each frame that fetches the
    inputs: the frame after it finds the value.
    """

    def __init__(
        self,
        volts: Callable[[], Volts],
        product: int = _EL3102,
        revision: int = _REVISION,
        faults: TerminalFaults | None = None,
    ) -> None:
        self._volts = volts
        self.faults = faults or TerminalFaults()
        self._toggle = 0
        self.objects: dict[tuple[int, int], bytes] = {}
        self._writable: set[tuple[int, int]] = set()
        name = 'EL3102' if product == _EL3102 else f'EL{product >> 16}'
        super().__init__(_eeprom(name, product, revision, mailbox=True), (3, 8))

    def power_on(self) -> None:
        """Reset to the settings as delivered, with the 50 Hz filter on."""
        super().power_on()
        self.objects = {(0x1C00, 0): b'\4', (0x1C12, 0): b'\0', (0x1C13, 0): b'\2'}
        for number in range(4):
            self.objects[0x1C00, number + 1] = bytes((number + 1,))
        self._writable = set()
        for channel in (1, 2):
            assigned = 0x1A00 + 2 * (channel - 1)
            self.objects[0x1C13, channel] = struct.pack('<H', assigned)
            entries = _pdo(channel)
            self.objects[assigned, 0] = bytes((len(entries),))
            for subindex, entry in enumerate(entries, start=1):
                self.objects[assigned, subindex] = struct.pack('<L', entry)
            settings = 0x8000 + 0x10 * (channel - 1)
            for subindex, value in {0x01: 0, 0x02: 0, 0x06: 1, 0x0A: 0, 0x0B: 1}.items():
                self.objects[settings, subindex] = bytes((value,))
                self._writable.add((settings, subindex))

    def enter(self, state: int) -> None:
        """Convert both inputs when SAFE-OP is reached."""
        if state == SlaveState.SAFEOP:
            self.inputs_read()

    def inputs_read(self) -> None:
        """Convert both inputs, after each frame that fetches them."""
        if self.faults.frozen:
            return
        self._toggle ^= 0x8000
        for number, volts in enumerate(self._volts()):
            count = round(volts * 32767 / 10)
            status = self._toggle | (0x4000 if self.faults.invalid else 0)
            status |= 0x41 if count < -32767 else 0x42 if count > 32767 else 0
            clipped = max(-32767, min(32767, count))
            struct.pack_into('<Hh', self.memory, _INPUTS + 4 * number, status, clipped)

    def mailbox(self, request: bytes) -> bytes | None:
        """Return the CoE answer to an SDO upload or download of up to four bytes, else b''."""
        if len(request) < 16 or request[5] & 0x0F != _COE:
            return b''
        count = request[5] >> 4
        (service,) = struct.unpack_from('<H', request, 6)
        command, index, subindex = struct.unpack_from('<BHB', request, 8)
        if service >> 12 != _SDO_REQUEST:
            return b''
        key = index, subindex
        if command & 0xE0 == 0x40:
            command, data = self._upload(key)
        elif command & 0xE3 == 0x23:
            size = 4 - (command >> 2 & 3) if command & 1 else 4
            command, data = self._download(key, request[12 : 12 + size])
        else:
            command, data = 0x80, struct.pack('<L', _ABORT_COMMAND)
        answer = struct.pack('<HBHB', _SDO_RESPONSE << 12, command, index, subindex)
        answer += data.ljust(4, b'\0')
        return struct.pack('<HHBB', len(answer), 0, 0, _COE | count << 4) + answer

    def _upload(self, key: tuple[int, int]) -> tuple[int, bytes]:
        value = self.objects.get(key)
        if value is None:
            return 0x80, struct.pack('<L', _ABORT_NO_OBJECT)
        return 0x43 | (4 - len(value)) << 2, value

    def _download(self, key: tuple[int, int], value: bytes) -> tuple[int, bytes]:
        if key not in self.objects:
            return 0x80, struct.pack('<L', _ABORT_NO_OBJECT)
        if key not in self._writable:
            return 0x80, struct.pack('<L', _ABORT_READ_ONLY)
        if not (self.faults.filter_sticks and key[1] == 0x06):
            self.objects[key] = value
        return 0x60, b''


ETHERTYPE = 0x88A4
_HEADER = 14
_POLL = 0.1


def process(frame: bytes, slaves: Sequence[SlaveController]) -> bytes | None:
    """Return an Ethernet frame after it passed the slaves; None if it is no EtherCAT frame.

    A slave that is not present ends the segment: those behind it see nothing.
    """
    if len(frame) < _HEADER + 2 or frame[12:14] != ETHERTYPE.to_bytes(2, 'big'):
        return None
    out = bytearray(frame)
    out[6] |= 0x02
    at = _HEADER + 2
    more = True
    while more:
        if at + 12 > len(out):
            return None
        command, _, address, offset, length, _ = struct.unpack_from('<BBHHHH', out, at)
        more, length = bool(length & 0x8000), length & 0x07FF
        end = at + 10 + length
        if end + 2 > len(out):
            return None
        data = out[at + 10 : end]
        (counter,) = struct.unpack_from('<H', out, end)
        for slave in slaves:
            if not slave.present:
                break
            address, added = slave.serve(command, address, offset, data)
            counter += added
        out[at + 10 : end] = data
        struct.pack_into('<H', out, at + 2, address)
        struct.pack_into('<H', out, end, counter & 0xFFFF)
        at = end + 2
    return bytes(out)


class EmulatedSegment:
    """Emulated slaves on a network interface, served by a thread; requires raw sockets.

    plugged: whether the cable to the first slave is in.
    """

    def __init__(self, interface: str, slaves: Sequence[SlaveController]) -> None:
        self.slaves = tuple(slaves)
        self.plugged = True
        self.frames = 0
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
        self._socket.bind((interface, ETHERTYPE))
        self._socket.settimeout(_POLL)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='segment', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the socket."""
        self._stop.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            with suppress(TimeoutError, OSError):
                frame = self._socket.recv(2048)
                if self.plugged and (answer := process(frame, self.slaves)) is not None:
                    self.frames += 1
                    self._socket.send(answer)


def _constant(volts: Volts) -> Callable[[], Volts]:
    return lambda: volts


def run(options: argparse.Namespace) -> None:
    """Serve a coupler and terminals until Ctrl-C; InputError for an unusable interface."""
    if len(options.volts) % 2:
        raise InputError(f'--volts has {len(options.volts)} numbers; give two for each terminal')
    pairs: list[Volts] = list(zip(options.volts[::2], options.volts[1::2], strict=True))
    terminals = [EL3102(_constant(pair)) for pair in pairs]
    try:
        segment = EmulatedSegment(options.interface, [EK1100(), *terminals])
    except OSError as error:
        raise InputError(
            f'cannot use {options.interface}: {error.strerror}; it must exist, and raw sockets '
            'need root'
        ) from error
    print(f'EK1100 and {len(pairs)} EL3102 on {options.interface}; Ctrl-C ends it', flush=True)
    with closing(segment), suppress(KeyboardInterrupt):
        while True:
            time.sleep(1.0)
