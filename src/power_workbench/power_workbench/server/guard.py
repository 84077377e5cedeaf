"""Who may ask the server for anything: token, host, origin, size of bodies."""

import secrets
from collections.abc import Collection

from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from power_workbench.files.logs import LARGEST_LOG

LONGEST_BODY = 256 * 1024
"""Bytes."""
UPLOAD = '/upload'
"""End of the paths whose body is a file."""
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

    def __init__(self, app: ASGIApp, token: str, hosts: Collection[str], cookie: str) -> None:
        self._app, self._token, self._cookie = app, token, cookie
        self._hosts = frozenset(host.lower() for host in hosts)
        self._origins = frozenset(f'http://{host}' for host in self._hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope['type'] != 'http':
            return

        async def dressed(message: Message) -> None:
            if message['type'] == 'http.response.start':
                own = ((name.lower().encode(), text.encode()) for name, text in _HEADERS.items())
                message['headers'] = [*message['headers'], *own]
            await send(message)

        request = Request(scope)
        refused = self._refusal(request)
        if refused is not None:
            await _answer(*refused)(scope, receive, send)
        elif self._in_address(request):
            cookie = f'{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/'
            welcome = _answer(303, '', {'location': '/', 'set-cookie': cookie})
            await welcome(scope, receive, send)
        else:
            await self._app(scope, receive, dressed)

    def _refusal(self, request: Request) -> tuple[int, str] | None:
        headers, method = request.headers, request.method
        hosts = headers.getlist('host')
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return 403, 'This is not the address of the workbench.'
        origin = headers.get('origin')
        if origin is not None and origin.lower() not in self._origins:
            return 403, 'Another site may not ask the workbench for anything.'
        given = headers.get('x-token') or request.cookies.get(self._cookie, '')
        if not (self._in_address(request) or self._is_token(given)):
            return 403, (
                'The token is missing or wrong. Open the address that the command printed '
                '(with ?token=… at its end).'
            )
        if method not in ('GET', 'HEAD', 'POST'):
            return 405, 'Only GET and POST are answered.'
        if method == 'POST':
            upload = request.scope['path'].endswith(UPLOAD)
            kind = 'application/octet-stream' if upload else 'application/json'
            if headers.get('content-type', '').partition(';')[0].strip() != kind:
                return 415, f'A body must be {kind}.'
            # The server ends a body at its length, but would take any number of chunks.
            length = headers.get('content-length', '' if upload else '0')
            most = LARGEST_LOG if upload else LONGEST_BODY
            is_known = 'transfer-encoding' not in headers and length.isdecimal()
            if not is_known or len(length) > 18 or int(length) > most:
                return 413, f'A body may have {most} bytes.'
        return None

    def _in_address(self, request: Request) -> bool:
        is_page = request.scope['path'] == '/' and request.method == 'GET'
        return is_page and self._is_token(request.query_params.get('token', ''))

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self._token.encode())


def _answer(status: int, text: str, more: dict[str, str] | None = None) -> PlainTextResponse:
    own = {'cache-control': 'no-store', 'connection': 'close'}
    return PlainTextResponse(text, status, {**own, **(more or {}), **_HEADERS})
