"""An ODrive on a CAN bus, by the published message set of CAN Simple; nothing of the product."""

import math
import struct
from dataclasses import dataclass, field

import can

ENCODER, IQ, TEMPERATURE, BUS, TORQUES, HEARTBEAT = 0x09, 0x14, 0x15, 0x17, 0x1C, 0x01


@dataclass
class ODriveEmulator:
    """
    One axis that swings: turns = 0.5·sin(2π·t) + node, and what it would draw from 24 V.

    offsets are the times in s at which its messages come within a cycle, by command.
    """

    node: int
    cycle: float = 0.01
    offsets: dict[int, float] = field(
        default_factory=lambda: {ENCODER: 0.0, TORQUES: 0.003, BUS: 0.005, IQ: 0.006}
    )
    broken: dict[int, tuple[float, float]] = field(default_factory=dict)

    def turns(self, t: float) -> float:
        return 0.5 * math.sin(2 * math.pi * t) + self.node

    def turns_per_second(self, t: float) -> float:
        return math.pi * math.cos(2 * math.pi * t)

    def torque(self, t: float) -> float:
        return 0.2 + 0.1 * self.node + 0.05 * math.sin(2 * math.pi * t)

    def volts(self, t: float) -> float:
        return 24.0 - 0.1 * math.sin(2 * math.pi * t)

    def amperes(self, t: float) -> float:
        return 1.5 + self.node + 0.5 * math.cos(2 * math.pi * t)

    def values(self, command: int, t: float) -> tuple[float, float]:
        if command in self.broken:
            return self.broken[command]
        return {
            ENCODER: (self.turns(t), self.turns_per_second(t)),
            TORQUES: (self.torque(t) + 0.01, self.torque(t)),
            BUS: (self.volts(t), self.amperes(t)),
            IQ: (self.torque(t) / 0.05, self.torque(t) / 0.05),
            TEMPERATURE: (41.0, 55.0 + self.node),
        }[command]

    def message(self, command: int, t: float) -> can.Message:
        data = struct.pack('<ff', *self.values(command, t))
        return self._message(command, data)

    def heartbeat(self) -> can.Message:
        return self._message(HEARTBEAT, struct.pack('<IBBBx', 0, 8, 0, 0))

    def _message(self, command: int, data: bytes) -> can.Message:
        identifier = self.node << 5 | command
        return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)

    def schedule(self, seconds: float, start: float = 0.0) -> list[tuple[float, can.Message]]:
        """Return what it sends from start for some seconds, with the times."""
        cycles = range(round(seconds / self.cycle))
        sent = [
            (t, self.message(command, t))
            for k in cycles
            for command, offset in self.offsets.items()
            for t in [start + k * self.cycle + offset]
        ]
        sent += [(start + 0.1 * k, self.heartbeat()) for k in range(round(10 * seconds))]
        return sorted(sent, key=lambda pair: pair[0])
