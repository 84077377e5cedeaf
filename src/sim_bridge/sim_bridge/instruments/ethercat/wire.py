"""EtherCAT frames from a raw socket through emulated slaves and back."""

import socket
import struct
import threading
from collections.abc import Sequence
from contextlib import suppress

from sim_bridge.instruments.ethercat.controller import SlaveController

ETHERTYPE = 0x88A4
_HEADER = 14
_POLL = 0.1


def process(frame: bytes, slaves: Sequence[SlaveController]) -> bytes | None:
    """
    Pass an Ethernet frame through slaves and back; None for one that is no EtherCAT frame.

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
    """
    Emulated slaves on a network interface, served by a thread; requires raw sockets.

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
                answer = process(frame, self.slaves) if self.plugged else None
                if answer is not None:
                    self.frames += 1
                    self._socket.send(answer)
