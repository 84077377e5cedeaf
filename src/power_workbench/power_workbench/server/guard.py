"""Who may ask the server for anything: token, host, origin, size of bodies."""

import secrets
from collections.abc import Awaitable, Callable, Collection, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from power_workbench.files.logs import LARGEST_LOG

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[MutableMapping[str, Any], Receive, Send], Awaitable[None]]

LONGEST_BODY = 256 * 1024
"""Bytes."""
UPLOAD = '/upload'
"""End of the paths whose body is a file; it is passed on as it comes."""
_HEADERS = {
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; connect-src 'self'; font-src 'self'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'"
    ),
    'X-Content-Type-Options': 'nosniff',
    'X-Frame-Options': 'DENY',
    'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin',
}


class PageGuard:
    """ASGI middleware that lets through what comes from the page itself.

    hosts: values of the header Host that are the server's own, so that a foreign name that
    resolves to this machine is refused. The token comes in the address once and is a cookie, which
    no other site can make a browser send, from then on; or it is in the header X-Token.
    """

    def __init__(self, app: App, token: str, hosts: Collection[str], cookie: str) -> None:
        self._app, self._token, self._cookie = app, token, cookie
        self._hosts = frozenset(host.lower() for host in hosts)
        self._origins = frozenset(f'http://{host}' for host in self._hosts)

    async def __call__(
        self, scope: MutableMapping[str, Any], receive: Receive, send: Send
    ) -> None:
        """Answer a request, or refuse it."""
        if scope['type'] == 'lifespan':
            await self._app(scope, receive, send)
            return
        if scope['type'] != 'http':
            return
        headers = {
            name.decode('latin-1').lower(): value.decode('latin-1')
            for name, value in scope['headers']
        }
        refused = self._refusal(scope, headers)
        if refused is not None:
            await _answer(send, *refused)
            return
        if self._in_address(scope):
            await _answer(send, 303, '', self._welcome())
            return
        await self._pass(scope, receive, send)

    def _refusal(
        self, scope: MutableMapping[str, Any], headers: MutableMapping[str, str]
    ) -> tuple[int, str] | None:
        if headers.get('host', '').lower() not in self._hosts:
            return 403, 'This is not the address of the workbench.'
        origin = headers.get('origin')
        if origin is not None and origin.lower() not in self._origins:
            return 403, 'Another site may not ask the workbench for anything.'
        if not (self._in_address(scope) or self._known(headers)):
            return 403, (
                'The token is missing or wrong. Open the address that the command printed '
                '(with ?token=… at its end).'
            )
        if scope['method'] not in ('GET', 'HEAD', 'POST'):
            return 405, 'Only GET and POST are answered.'
        if scope['method'] == 'POST':
            upload = scope['path'].endswith(UPLOAD)
            kind = 'application/octet-stream' if upload else 'application/json'
            if headers.get('content-type', '').partition(';')[0].strip() != kind:
                return 415, f'A body must be {kind}.'
            length = headers.get('content-length', '' if upload else '0')
            if not length.isdecimal() or len(length) > 18 or int(length) > _most(scope):
                return 413, _too_long(scope)
        return None

    def _in_address(self, scope: MutableMapping[str, Any]) -> bool:
        if scope['path'] != '/' or scope['method'] != 'GET':
            return False
        given = parse_qs(scope['query_string'].decode('latin-1')).get('token', [''])[0]
        return self._is_token(given)

    def _known(self, headers: MutableMapping[str, str]) -> bool:
        given = headers.get('x-token', '')
        if not given:
            jar: SimpleCookie = SimpleCookie()
            try:
                jar.load(headers.get('cookie', ''))
            except CookieError:
                return False
            given = jar[self._cookie].value if self._cookie in jar else ''
        return self._is_token(given)

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self._token.encode())

    def _welcome(self) -> list[tuple[bytes, bytes]]:
        cookie = f'{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/'
        return [(b'location', b'/'), (b'set-cookie', cookie.encode())]

    async def _pass(self, scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        """Read a body within its limit, then let the application answer.

        A file is not read here: the server ends it at the length that was checked.
        """
        body = b''
        upload = scope['path'].endswith(UPLOAD)
        if scope['method'] == 'POST' and not upload:
            more = True
            while more:
                message = await receive()
                if message['type'] == 'http.disconnect':
                    return
                body += message.get('body', b'')
                more = message.get('more_body', False)
                if len(body) > LONGEST_BODY:
                    await _answer(send, 413, _too_long(scope))
                    return
        whole: list[Message] = [{'type': 'http.request', 'body': body, 'more_body': False}]

        async def read() -> Message:
            return whole.pop() if whole else await receive()

        async def dressed(message: Message) -> None:
            if message['type'] == 'http.response.start':
                message['headers'] = [*message['headers'], *_dress()]
            await send(message)

        await self._app(scope, receive if upload else read, dressed)


def _most(scope: MutableMapping[str, Any]) -> int:
    return LARGEST_LOG if scope['path'].endswith(UPLOAD) else LONGEST_BODY


def _too_long(scope: MutableMapping[str, Any]) -> str:
    return f'A body may have {_most(scope)} bytes.'


def _dress() -> list[tuple[bytes, bytes]]:
    return [(name.lower().encode(), value.encode()) for name, value in _HEADERS.items()]


async def _answer(
    send: Send, status: int, text: str, more: list[tuple[bytes, bytes]] | None = None
) -> None:
    body = text.encode()
    headers = [
        (b'content-type', b'text/plain; charset=utf-8'),
        (b'content-length', str(len(body)).encode()),
        (b'cache-control', b'no-store'),
        (b'connection', b'close'),
        *(more or []),
        *_dress(),
    ]
    await send({'type': 'http.response.start', 'status': status, 'headers': headers})
    await send({'type': 'http.response.body', 'body': body})
