"""Register queries and replies of moteus servos on CAN FD.

The host asks each servo for registers as float32 and the servo answers in the same frame format.
Nothing is ever written to a register. Protocol: moteus `docs/protocol/can.md`, `registers.md`.
"""

import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from math import nan
from typing import Final

import can

from power_daq.bus.signal_layout import frame_length

REGISTERS: Final[Mapping[str, int]] = {
    'Position': 0x001,
    'Velocity': 0x002,
    'Torque': 0x003,
    'Q_Current': 0x004,
    'D_Current': 0x005,
    'Abs_Position': 0x006,
    'Power': 0x007,
    'Motor_Temperature': 0x00A,
    'Voltage': 0x00D,
    'Temperature': 0x00E,
}
"""Number of each signal of moteus.dbc, in the order of its float32 values."""

_REPLY_WANTED = 0x8000
_READ_FLOATS, _REPLY, _ERRORS, _NOP = 0x1C, 0x20, (0x30, 0x31), 0x50
_VALUES = tuple(struct.Struct(f'<{kind}') for kind in 'bhif')
_PAYLOAD = struct.Struct(f'<{len(REGISTERS)}f')
_SIZE = frame_length(_PAYLOAD.size)


class MoteusRegisters:
    """Queries for some registers of servos, and the values in the replies.

    names: of the registers, as in REGISTERS. servos: their numbers by drive. host: the address
    that replies go to; another one than that of a program which moves the servos, so that neither
    gets the other's replies. refused counts registers that a firmware does not have, by name.
    """

    def __init__(self, names: Iterable[str], servos: Mapping[str, int], host: int) -> None:
        numbers = sorted(REGISTERS[name] for name in set(names))
        # Consecutive numbers, which one query reads, are equally far from their places.
        runs = groupby(enumerate(numbers), lambda pair: pair[1] - pair[0])
        registers = ([number for _, number in run] for _, run in runs)
        data = b''.join(bytes([_READ_FLOATS, len(run), run[0]]) for run in registers)
        self.queries = [
            can.Message(
                arbitration_id=_REPLY_WANTED | host << 8 | servo,
                is_extended_id=True,
                is_fd=True,
                bitrate_switch=True,
                data=data.ljust(frame_length(len(data)), bytes([_NOP])),
            )
            for servo in servos.values()
        ]
        self.refused: Counter[str] = Counter()
        self._names = {number: name for name, number in REGISTERS.items()}

    def payload(self, data: bytes) -> bytes:
        """Return a reply as the message REGISTERS of moteus.dbc; b'' if it cannot be read."""
        values = dict.fromkeys(REGISTERS.values(), nan)
        try:
            for number, value in _subframes(data):
                if value is None:
                    self.refused[self._names.get(number, f'{number:#05x}')] += 1
                elif number in values:
                    values[number] = value
        except (IndexError, struct.error):
            return b''
        return _PAYLOAD.pack(*values.values()).ljust(_SIZE, b'\0')


def _subframes(data: bytes) -> Iterator[tuple[int, float | None]]:
    """Yield number and float32 value of each register of a reply; None for a refused one."""
    place = 0
    while place < len(data):
        kind = data[place]
        place += 1
        if kind == _NOP:
            continue
        if kind in _ERRORS:
            number, place = _varuint(data, place)
            _, place = _varuint(data, place)
            yield number, None
        elif kind & 0xF0 == _REPLY:
            count = kind & 0b11
            if not count:
                count, place = _varuint(data, place)
            number, place = _varuint(data, place)
            form = _VALUES[kind >> 2 & 0b11]
            for k in range(count):
                (value,) = form.unpack_from(data, place)
                place += form.size
                if form is _VALUES[-1]:
                    yield number + k, value
        else:
            return  # of a kind whose length is not known


def _varuint(data: bytes, place: int) -> tuple[int, int]:
    """Return an unsigned integer of 7 bits a byte, and the place after it."""
    result = 0
    for shift in range(0, 35, 7):
        byte = data[place]
        place += 1
        result |= (byte & 0x7F) << shift
        if not byte & 0x80:
            break
    return result, place
