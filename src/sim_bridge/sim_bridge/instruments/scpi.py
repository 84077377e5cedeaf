"""Emulated bench supply with SCPI over TCP in the dialect of EA's PSB 9000.

It follows what drivers and manuals of that series agree on: line-terminated commands, long or
short words in any case, a number with its unit in each answer, setting values only under remote
control (`SYST:LOCK ON`), no answer to what it does not know but an entry in the error queue, one
connection at a time.
"""

import socket
import socketserver
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from wattwalk_core.errors import InputError

IDENTITY = 'EA Elektro-Automatik GmbH & Co. KG, PSB 9080-120 3U, 0000000000, V3.02 (simulated)'
RATED_VOLTAGE, RATED_CURRENT = 80.0, 120.0
_MOST_ERRORS = 5
_POLL = 0.1
_ERRORS = {
    -113: 'Undefined header',
    -104: 'Data type error',
    -201: 'Invalid while in local',
    -222: 'Data out of range',
    -350: 'Queue overflow',
}
_SHORT = {
    'MEASURE': 'MEAS',
    'VOLTAGE': 'VOLT',
    'CURRENT': 'CURR',
    'POWER': 'POW',
    'ARRAY': 'ARR',
    'SYSTEM': 'SYST',
    'NOMINAL': 'NOM',
    'ERROR': 'ERR',
    'OWNER': 'OWN',
    'OUTPUT': 'OUTP',
}

Sent = Sequence[tuple[float, bytes]]


@dataclass(frozen=True)
class Terminals:
    """Voltage, V, and current, A, out of the supply (negative into it)."""

    voltage: float
    current: float


class SupplyState:
    """State of the emulated supply: set points (V, A), output, remote control, error queue."""

    def __init__(self, terminals: Callable[[], Terminals], output: bool = True) -> None:
        self._terminals = terminals
        self._errors: deque[int] = deque()
        self.output, self.remote = output, False
        self.voltage, self.current = 48.0, RATED_CURRENT
        self.heard: deque[str] = deque(maxlen=1000)

    def answer(self, line: str) -> str | None:
        """Execute a command line; return the answer if it is a query; errors are queued."""
        self.heard.append(line)
        header, _, argument = line.strip().partition(' ')
        words = header.upper().removesuffix('?').lstrip(':').split(':')
        words = [_SHORT.get(word, word) for word in words if word not in ('SOUR', 'SOURCE')]
        name = ':'.join(words)
        if header.endswith('?'):
            return self._next_error() if name == 'SYST:ERR' else self._answer(name)
        self._set(name, argument.strip())
        return None

    def error(self, code: int) -> None:
        """Queue an error code; a full queue ends with −350."""
        if len(self._errors) < _MOST_ERRORS:
            self._errors.append(code)
        else:
            self._errors[-1] = -350

    def _answer(self, name: str) -> str | None:
        now = self._terminals() if self.output else Terminals(0.0, 0.0)
        voltage, current = f'{now.voltage:.2f} V', f'{now.current:.2f} A'
        power = f'{now.voltage * now.current:.1f} W'
        answers = {
            '*IDN': IDENTITY,
            'MEAS:ARR': f'{voltage}, {current}, {power}',
            'MEAS:VOLT': voltage,
            'MEAS:CURR': current,
            'MEAS:POW': power,
            'SYST:NOM:VOLT': f'{RATED_VOLTAGE:.2f} V',
            'SYST:NOM:CURR': f'{RATED_CURRENT:.2f} A',
            'SYST:LOCK:OWN': 'REMOTE' if self.remote else 'NONE',
            'VOLT': f'{self.voltage:.2f} V',
            'CURR': f'{self.current:.2f} A',
            'OUTP': 'ON' if self.output else 'OFF',
        }
        if name not in answers:
            self.error(-113)
        return answers.get(name)

    def _next_error(self) -> str:
        if not self._errors:
            return '0,"No error"'
        code = self._errors.popleft()
        return f'{code},"{_ERRORS.get(code, "Device-specific error")}"'

    def _set(self, name: str, argument: str) -> None:
        if name == '*CLS':
            self._errors.clear()
        elif name == 'SYST:LOCK':
            self.remote = self._switch(argument, self.remote)
        elif name in ('VOLT', 'CURR', 'OUTP') and not self.remote:
            self.error(-201)
        elif name == 'VOLT':
            self.voltage = self._number(argument, self.voltage, RATED_VOLTAGE)
        elif name == 'CURR':
            self.current = self._number(argument, self.current, RATED_CURRENT)
        elif name == 'OUTP':
            self.output = self._switch(argument, self.output)
        else:
            self.error(-113)

    def _switch(self, argument: str, before: bool) -> bool:
        if argument.upper() in ('ON', 'OFF', '1', '0'):
            return argument.upper() in ('ON', '1')
        self.error(-104)
        return before

    def _number(self, argument: str, before: float, most: float) -> float:
        try:
            value = float(argument)
        except ValueError:
            self.error(-104)
            return before
        if not 0.0 <= value <= most:
            self.error(-222)
            return before
        return value


def whole(_: str, answer: str) -> Sent:
    """Return an answer as one piece without a delay; the default `send` of `ScpiInstrument`."""
    return [(0.0, answer.encode('ascii') + b'\n')]


class ScpiInstrument(socketserver.TCPServer):
    """Server of a SupplyState on a TCP socket, in a thread, for one client at a time.

    send: returns, for a query and its answer, pairs of a delay in s and the bytes to send, so that
    tests can corrupt answers. port: 0 takes a free one. InputError if the port is taken.
    """

    allow_reuse_address = True
    request_queue_size = 1

    def __init__(
        self,
        state: SupplyState,
        host: str = '127.0.0.1',
        port: int = 0,
        send: Callable[[str, str], Iterable[tuple[float, bytes]]] = whole,
    ) -> None:
        self.state, self.send = state, send
        self.connections = 0
        try:
            super().__init__((host, port), socketserver.BaseRequestHandler)
        except (OSError, OverflowError) as error:
            raise InputError(
                f'cannot listen on {host}:{port} ({error}); give another host or port'
            ) from error
        self.host, self.port = self.socket.getsockname()[:2]
        self._client: socket.socket | None = None
        self._stop = threading.Event()
        threading.Thread(
            target=self.serve_forever, args=(_POLL,), name='instrument', daemon=True
        ).start()

    def drop(self) -> None:
        """Break the connection, as a pulled cable does."""
        client = self._client
        if client is not None:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End the server."""
        self._stop.set()
        self.drop()
        self.shutdown()
        self.server_close()

    def finish_request(self, request: Any, client_address: Any) -> None:
        """Serve a client until it disconnects; overrides that of `TCPServer`."""
        self.connections += 1
        self._client = request
        # A client that came after `drop` would hold up `close`.
        with suppress(OSError), request.makefile('rb') as lines:
            for line in () if self._stop.is_set() else lines:
                if not line.endswith(b'\n'):  # cut off with the connection
                    break
                self._reply(request, line.decode('ascii', 'replace').rstrip('\r\n'))
        self._client = None

    def _reply(self, client: socket.socket, line: str) -> None:
        answer = self.state.answer(line)
        if answer is None:
            return
        for pause, piece in self.send(line, answer):
            if self._stop.wait(pause):
                return
            client.sendall(piece)
