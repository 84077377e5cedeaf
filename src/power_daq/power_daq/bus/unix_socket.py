"""A CAN FD bus over a Unix socket, for processes of a machine without vcan."""

import os
import select
import socket
import stat
import struct
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import can
from can.bus import CanProtocol

_TIME = struct.Struct('<Q')
_HEAD = struct.Struct('<IBBxx')
_EXTENDED, _REMOTE, _ERROR = 1 << 31, 1 << 30, 1 << 29
_BITRATE_SWITCH, _ERROR_STATE, _FD = 1, 2, 4
_FRAMES_PER_PACKET = 256
_PACKET_BYTES = _TIME.size + _FRAMES_PER_PACKET * (_HEAD.size + 64)
_BUFFER_BYTES = 4 << 20
_HOST_QUEUE = 4096
_SERVICE_PERIOD = 0.005
_PACKETS_PER_SERVICE = 64


def pack(messages: Iterable[can.Message]) -> bytes:
    """Return the time of sending and the frames, each as SocketCAN's canfd_frame up to its length.

    The time is system time in ns, as on vcan, where the kernel stamps a frame when it is sent.
    """
    parts: list[bytes | bytearray] = [_TIME.pack(time.time_ns())]
    for m in messages:
        identifier = m.arbitration_id | (_EXTENDED if m.is_extended_id else 0)
        identifier |= (_REMOTE if m.is_remote_frame else 0) | (_ERROR if m.is_error_frame else 0)
        flags = (_FD if m.is_fd else 0) | (_BITRATE_SWITCH if m.bitrate_switch else 0)
        flags |= _ERROR_STATE if m.error_state_indicator else 0
        parts += [_HEAD.pack(identifier, m.dlc, flags), m.data]
    return b''.join(parts)


def unpack(packet: bytes, channel: str) -> list[can.Message]:
    """Return the messages of a packet; ValueError if it is malformed."""
    if len(packet) < _TIME.size:
        raise ValueError(f'{len(packet)} bytes without a time')
    messages = []
    timestamp = 1e-9 * _TIME.unpack_from(packet)[0]
    place = _TIME.size
    while place < len(packet):
        if len(packet) - place < _HEAD.size:
            raise ValueError(f'{len(packet) - place} bytes after the last frame')
        identifier, length, flags = _HEAD.unpack_from(packet, place)
        place += _HEAD.size
        data = b'' if identifier & _REMOTE else packet[place : place + length]
        if length > 64 or (not identifier & _REMOTE and len(data) < length):
            raise ValueError(f'frame of {length} bytes in {len(packet) - place} bytes')
        place += len(data)
        messages.append(
            can.Message(
                timestamp=timestamp,
                arbitration_id=identifier & 0x1FFFFFFF,
                is_extended_id=bool(identifier & _EXTENDED),
                is_remote_frame=bool(identifier & _REMOTE),
                is_error_frame=bool(identifier & _ERROR),
                channel=channel,
                dlc=length,
                data=data,
                is_fd=bool(flags & _FD),
                bitrate_switch=bool(flags & _BITRATE_SWITCH),
                error_state_indicator=bool(flags & _ERROR_STATE),
            )
        )
    return messages


class MalformedPacketError(can.CanOperationError):
    """A packet that holds no frames; the bus is as usable as before."""


@dataclass(frozen=True)
class HostStatistics:
    """Clients of a host now and before, and the frames dropped for each slow client."""

    connected: int
    disconnected: int
    dropped: tuple[int, ...]


class UnixSocketBus(can.BusABC):
    """python-can interface 'unixsocket'; the channel is the path of the socket.

    One process is the host (host=True), the others connect to it. Every frame reaches all others.
    The host never waits for a client: frames for which a slow one has no room are dropped and
    counted. A client gets CanOperationError if the host has gone, CanInitializationError if
    there is none, MalformedPacketError for a packet that it cannot read.
    """

    def __init__(
        self,
        channel: str,
        can_filters: can.typechecking.CanFilters | None = None,
        *,
        host: bool = False,
        **kwargs: object,
    ) -> None:
        if not isinstance(channel, str | os.PathLike) or not str(channel):
            raise ValueError(f'the channel of a unixsocket bus is a path, not {channel!r}')
        self.channel = str(channel)
        self._can_protocol = CanProtocol.CAN_FD
        self.channel_info = f'unixsocket {self.channel}{" (host)" if host else ""}'
        self._pending: deque[can.Message] = deque(maxlen=_HOST_QUEUE if host else None)
        self._end: _Host | _Client = _Host(self.channel) if host else _Client(self.channel)
        super().__init__(channel, can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; a client waits up to timeout (s) for room."""
        self._end.send(pack((msg,)), 1, timeout)

    def send_all(self, messages: Sequence[can.Message], timeout: float | None = None) -> None:
        """Send frames at once, at little more cost than one of them."""
        for first in range(0, len(messages), _FRAMES_PER_PACKET):
            batch = messages[first : first + _FRAMES_PER_PACKET]
            self._end.send(pack(batch), len(batch), timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._pending:
            for packet in self._end.receive(timeout):
                try:
                    self._pending.extend(unpack(packet, self.channel))
                except ValueError as error:
                    raise MalformedPacketError(
                        f'{self.channel_info} carries a malformed packet: {error}'
                    ) from error
        return (self._pending.popleft() if self._pending else None), False

    def fileno(self) -> int:
        """Return a descriptor that becomes readable when frames arrive."""
        return self._end.fileno()

    @property
    def statistics(self) -> HostStatistics:
        """Clients and drops of a host; all zero elsewhere."""
        return self._end.statistics()

    def shutdown(self) -> None:
        """Leave the bus; without its host it ends for all clients."""
        if not self._is_shutdown:
            super().shutdown()
            self._end.close()


def _new_socket() -> socket.socket:
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
    return end


def _milliseconds(timeout: float | None) -> float | None:
    return None if timeout is None else max(0.0, timeout * 1000)


class _Client:
    def __init__(self, path: str) -> None:
        self._path = path
        self._socket = _new_socket()
        try:
            self._socket.connect(path)
        except OSError as error:
            self._socket.close()
            raise can.CanInitializationError(
                f'no unixsocket bus at {path!r}: {error.strerror or error}'
            ) from error
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(self._socket, select.POLLIN)
        self._writable.register(self._socket, select.POLLOUT)

    def send(self, packet: bytes, frames: int, timeout: float | None) -> None:
        try:
            if not self._writable.poll(_milliseconds(timeout)):
                raise can.CanTimeoutError(f'no room on unixsocket bus {self._path!r}')
            self._socket.send(packet)
        except OSError as error:
            raise self._gone() from error

    def receive(self, timeout: float | None) -> list[bytes]:
        try:
            if not self._readable.poll(_milliseconds(timeout)):
                return []
            packet = self._socket.recv(_PACKET_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            raise self._gone() from error
        if not packet:
            raise self._gone()
        return [packet]

    def _gone(self) -> can.CanOperationError:
        return can.CanOperationError(f'the host of unixsocket bus {self._path!r} is gone')

    def fileno(self) -> int:
        return self._socket.fileno()

    def statistics(self) -> HostStatistics:
        return HostStatistics(0, 0, ())

    def close(self) -> None:
        self._socket.close()


class _Host:
    def __init__(self, path: str) -> None:
        self._path = path
        self._dropped: dict[socket.socket, int] = {}
        self._disconnected = 0
        self._inbox: deque[bytes] = deque(maxlen=_HOST_QUEUE)
        self._next_service = 0.0
        self._listener = _new_socket()
        try:
            self._remove_stale_socket()
            self._listener.bind(path)
            Path(path).chmod(0o600)
            self._listener.listen(16)
        except OSError as error:
            self._listener.close()
            raise can.CanInitializationError(
                f'cannot host a unixsocket bus at {path!r}: {error.strerror or error}'
            ) from error
        self._poll = select.poll()
        self._poll.register(self._listener, select.POLLIN)
        self._clients: dict[int, socket.socket] = {}

    def _remove_stale_socket(self) -> None:
        """Delete the socket file of a killed host, and no other file."""
        try:
            if not stat.S_ISSOCK(os.stat(self._path).st_mode):
                raise FileExistsError(17, 'a file that is no socket is there')
        except FileNotFoundError:
            return
        with _new_socket() as probe:
            try:
                probe.connect(self._path)
            except ConnectionRefusedError:
                os.unlink(self._path)
            else:
                raise OSError(98, 'another host is there')

    def send(self, packet: bytes, frames: int, timeout: float | None) -> None:
        now = time.monotonic()
        if now >= self._next_service:
            self._next_service = now + _SERVICE_PERIOD
            self._service(0)
        self._fan_out(packet, frames, None)

    def _fan_out(self, packet: bytes, frames: int, sender: socket.socket | None) -> None:
        for client in list(self._dropped):
            if client is sender:
                continue
            try:
                client.send(packet)
            except BlockingIOError:
                self._dropped[client] += frames
            except OSError:
                self._forget(client)

    def _service(self, milliseconds: float | None) -> None:
        for descriptor, _ in self._poll.poll(milliseconds):
            if descriptor == self._listener.fileno():
                self._accept()
            else:
                for _ in range(_PACKETS_PER_SERVICE):
                    client = self._clients.get(descriptor)
                    if client is None or not self._read(client):
                        break

    def _accept(self) -> None:
        with suppress(OSError):
            client, _ = self._listener.accept()
            client.setblocking(False)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
            self._dropped[client] = 0
            self._clients[client.fileno()] = client
            self._poll.register(client, select.POLLIN)

    def _read(self, client: socket.socket) -> bool:
        """Forward a client's packet; return whether there was one."""
        try:
            packet = client.recv(_PACKET_BYTES)
            frames = len(unpack(packet, ''))
        except BlockingIOError:
            return False
        except (OSError, ValueError):
            self._forget(client)
            return False
        self._inbox.append(packet)
        self._fan_out(packet, frames, client)
        return True

    def _forget(self, client: socket.socket) -> None:
        if self._dropped.pop(client, None) is not None:
            self._disconnected += 1
            self._poll.unregister(client)
            del self._clients[client.fileno()]
            client.close()

    def receive(self, timeout: float | None) -> list[bytes]:
        if not self._inbox:
            self._service(_milliseconds(timeout))
        packets = list(self._inbox)
        self._inbox.clear()
        return packets

    def fileno(self) -> int:
        return self._listener.fileno()

    def statistics(self) -> HostStatistics:
        dropped = tuple(self._dropped.values())
        return HostStatistics(len(dropped), self._disconnected, dropped)

    def close(self) -> None:
        self._listener.close()
        with suppress(OSError):
            os.unlink(self._path)
        for client in list(self._dropped):
            client.close()
        self._dropped.clear()
        self._clients.clear()
