"""moteus servos on a CAN FD bus, by their published register protocol; nothing of the product."""

import math
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import can

POSITION, VELOCITY, TORQUE, POWER, VOLTAGE, TEMPERATURE = 0x001, 0x002, 0x003, 0x007, 0x00D, 0x00E


@dataclass
class MoteusEmulator:
    """
    A servo that turns at 0.25 turns/s and answers queries for float32 registers.

    missing: registers that its firmware does not have. deaf: numbers of queries that it leaves
    unanswered. form: changes the reply.
    """

    servo: int
    missing: set[int] = field(default_factory=set)
    broken: dict[int, float] = field(default_factory=dict)
    is_deaf: bool = False
    form: Callable[[bytes], bytes] = bytes
    queries: list[can.Message] = field(default_factory=list)

    def value(self, register: int, t: float) -> float:
        if register in self.broken:
            return self.broken[register]
        return {
            POSITION: 0.25 * (t % 1000.0),
            VELOCITY: 0.25,
            TORQUE: 0.1 * self.servo,
            POWER: 12.0 * self.servo,
            VOLTAGE: 24.0,
            TEMPERATURE: 37.0,
        }[register]

    def answer(self, query: can.Message, t: float) -> can.Message | None:
        """Return the reply to a frame that is for this servo and wants one."""
        identifier = query.arbitration_id
        if identifier & 0x7F != self.servo or not identifier & 0x8000 or self.is_deaf:
            return None
        self.queries.append(query)
        host = identifier >> 8 & 0x7F
        reply, data = b'', bytes(query.data)
        while data:
            if data[0] == 0x50:
                data = data[1:]
                continue
            assert data[0] >> 4 == 1, 'only reads are asked of a servo that others move'
            assert data[0] >> 2 & 3 == 3, 'as float32'
            count, start, data = (
                (data[0] & 3, data[1], data[2:]) if data[0] & 3 else (data[1], data[2], data[3:])
            )
            present = [r for r in range(start, start + count) if r not in self.missing]
            for register in range(start, start + count):
                if register in self.missing:
                    reply += bytes([0x31, register, 1])
            if present:
                head = [0x2C | len(present)] if len(present) < 4 else [0x2C, len(present)]
                values = [self.value(register, t) for register in present]
                assert present == list(range(present[0], present[-1] + 1))
                reply += bytes([*head, present[0]]) + struct.pack(f'<{len(values)}f', *values)
        size = next(n for n in (*range(9), 12, 16, 20, 24, 32, 48, 64) if n >= len(reply))
        return can.Message(
            arbitration_id=self.servo << 8 | host,
            is_extended_id=(self.servo << 8) >= 2048,
            is_fd=True,
            bitrate_switch=True,
            data=self.form(reply.ljust(size, b'\x50')),
        )


class ServoBus(threading.Thread):
    """Servos that answer on a bus until it is stopped."""

    def __init__(self, bus: can.BusABC, *servos: MoteusEmulator) -> None:
        super().__init__(daemon=True)
        self._bus, self._servos = bus, servos
        self.stop = threading.Event()

    def run(self) -> None:
        while not self.stop.is_set():
            query = self._bus.recv(0.05)
            for servo in self._servos if query is not None else ():
                reply = servo.answer(query, time.time())
                if reply is not None:
                    self._bus.send(reply)


def turns(t: float) -> float:
    """Position that the servos have at a time."""
    return math.fmod(t, 1000.0) * 0.25
