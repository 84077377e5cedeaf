"""Routes of the workbench, and the server that answers them."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from power_estimator.effects import load_catalogue
from power_lab.budget.families import FAMILIES
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from wattwalk_core.errors import InputError

from power_workbench.files.logs import ENDINGS, keep_log
from power_workbench.server import actions, answers
from power_workbench.server.guard import UPLOAD
from power_workbench.sessions.manager import SessionManager
from power_workbench.sessions.session import WorkbenchSession
from power_workbench.views import maps, moments
from power_workbench.views.view import PowerView

_PAGE = Path(__file__).parent / 'page'
_KINDS = {'.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css'}
TOPIC = 'topic'
"""In place of a model: what the nodes publish on `power_estimate`."""
_PATIENCE = 25.0  # s, that a question for news is held
_FRESH = {'Cache-Control': 'no-store'}


def application(manager: SessionManager) -> Starlette:
    """Return the web application of a workbench, to be put behind a `PageGuard`."""
    news = _News()
    manager.changed = news.tell
    stream = _News()
    manager.streamed = stream.tell

    def session_of(request: Request) -> WorkbenchSession:
        return manager.session(request.path_params['session'])

    def of_session(route: Callable[[WorkbenchSession, Request], Any]) -> Callable[..., Response]:
        """A route of one session; Starlette runs it beside the event loop."""
        return lambda request: _response(route(session_of(request), request))

    def of_view(route: Callable[[PowerView, Request], Any]) -> Callable[..., Response]:
        """A route of what a session shows."""
        return of_session(lambda session, request: route(answers.view_of(session), request))

    def action(name: str) -> Callable[..., Any]:
        """A route that changes a session; its body is an object."""

        async def answer(request: Request) -> Response:
            try:
                content = json.loads(await request.body() or b'{}')
            except (ValueError, RecursionError):
                raise InputError('the body is no JSON') from None
            if not isinstance(content, dict):
                raise InputError('the body is no object')

            def work() -> Response:
                session = session_of(request)
                found = actions.act(name, manager.readable(session), session, content)
                return _response(found or {'revision': session.revision})

            return await run_in_threadpool(work)

        return answer

    async def state(request: Request) -> Response:
        """Return the state once it is newer than the page's, or after some time."""
        after = _number(request, 'after', -1.0)
        try:
            session = await run_in_threadpool(session_of, request)
        except InputError as error:
            return _json({'error': str(error)}, 404)
        await news.wait(lambda: session.revision > after or manager.ending, _PATIENCE)
        return _json(await run_in_threadpool(answers.state, session))

    async def live(request: Request) -> Response:
        """Return the news of running nodes as events, for as long as the page listens."""
        given = _text(request, 'model')

        def more(seen: int) -> bool:
            return manager.ending or session.live.has_more(seen)

        def begin() -> WorkbenchSession:
            session = session_of(request)
            if given not in ('', TOPIC):
                manager.readable(session).check_model(given)
            session.live.join()
            return session

        async def events() -> AsyncIterator[str]:
            seen = 0
            try:
                while not manager.ending:
                    spec = '' if given == TOPIC else given or session.spec
                    await run_in_threadpool(session.live.use, spec, session.allowed_effects)
                    await stream.wait(partial(more, seen), _PATIENCE)
                    seen, new = session.live.after(seen)
                    yield ''.join(f'data: {json.dumps(one)}\n\n' for one in new) or ':\n\n'
            finally:
                session.live.leave()

        session = await run_in_threadpool(begin)
        return StreamingResponse(events(), media_type='text/event-stream', headers=_FRESH)

    async def upload(request: Request) -> Response:
        """Keep a log of the page's file chooser beside the session."""
        session = await run_in_threadpool(session_of, request)
        name, length = request.query_params.get('name', ''), request.headers['content-length']
        return _json(await keep_log(session.folder, name, int(length), request.stream()))

    def error_map(view: PowerView, request: Request) -> dict[str, Any]:
        drive, x, y = (_text(request, name) for name in ('drive', 'x', 'y'))
        return maps.error_map(view, drive, x, y)

    def sessions(request: Request) -> Response:
        if request.method == 'POST':
            return _json({'session': manager.new()})
        return _json({'sessions': manager.sessions()})

    def known(request: Request) -> Response:
        return _json(
            {
                'recordings': manager.folders.recordings(),
                'logs': manager.folders.logs(),
                'endings': ENDINGS,
                'models': manager.folders.models(),
                'catalogue': answers.catalogue_content(load_catalogue()),
                'families': [
                    {'name': name, 'words': words, 'color': color, 'effects': effects}
                    for name, (words, color, effects) in FAMILIES.items()
                ],
                'folders': [str(root) for root in manager.folders.roots],
            }
        )

    here = '/api/sessions/{session}'
    return Starlette(
        # What the user can correct is an answer.
        exception_handlers={InputError: lambda _, error: _json({'error': str(error)}, 400)},
        routes=[
            Route('/', _page),
            Route('/page/{name}', _page),
            Route('/plotly.js', _plotly),
            Route('/api/known', known),
            Route('/api/sessions', sessions, methods=['GET', 'POST']),
            Route(f'{here}/state', state),
            Route(f'{here}/live', live),
            Route(f'{here}{UPLOAD}', upload, methods=['POST']),
            Route(f'{here}/traces', of_view(lambda view, r: answers.traces(view, *_place(r)))),
            Route(f'{here}/log', of_session(lambda session, _: dict(session.log))),
            Route(f'{here}/budget', of_session(lambda session, _: dict(session.budget or {}))),
            Route(f'{here}/strip', of_view(lambda view, r: answers.strip(view, _width(r, 200)))),
            Route(f'{here}/map', of_view(error_map)),
            Route(
                f'{here}/moments',
                of_view(lambda view, r: moments.moments(view, _text(r, 'drive'))),
            ),
            Route(f'{here}/preview', of_session(_preview)),
            Route(f'{here}/files/{{name}}', of_session(_file)),
            *(Route(f'{here}/{name}', action(name), methods=['POST']) for name in actions.ACTIONS),
        ],
    )


class _News:
    """Wakes those who wait for a change, from any thread."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting: set[asyncio.Event] = set()

    def tell(self) -> None:
        """Say that something has changed."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for event in self._waiting:
            event.set()

    async def wait(self, condition: Callable[[], bool], patience: float) -> None:
        """Wait until the condition holds, no longer than patience [s]."""
        self._loop = asyncio.get_running_loop()
        event = asyncio.Event()
        self._waiting.add(event)
        try:
            async with asyncio.timeout(patience):
                while not condition():
                    await event.wait()
                    event.clear()
        except TimeoutError:
            pass
        finally:
            self._waiting.discard(event)


def _json(content: Any, status: int = 200) -> Response:
    return JSONResponse(content, status, headers=_FRESH)


def _response(found: Any) -> Response:
    """Bytes as they are, all but responses as JSON."""
    if isinstance(found, bytes):
        return Response(found, media_type='application/octet-stream', headers=_FRESH)
    return found if isinstance(found, Response) else _json(found)


def _preview(session: WorkbenchSession, request: Request) -> bytes:
    found, name = session.findings, _text(request, 'candidate')
    if found is None or name not in found.explained:
        raise InputError(f'there is no preview of {name!r}')
    view = answers.view_of(session)
    return answers.preview(view, found.explained[name], *_place(request))


def _file(session: WorkbenchSession, request: Request) -> Response:
    name = request.path_params['name']
    path = session.folder / name
    if not answers.KEPT.fullmatch(name) or not path.is_file():
        raise InputError(f'the session has no file {name!r}')
    return FileResponse(path, headers=_FRESH, filename=name, media_type='application/octet-stream')


def _place(request: Request) -> tuple[str, float, float, int]:
    start, stop = _number(request, 'from', 0.0), _number(request, 'to', 1e9)
    return _text(request, 'drive'), start, stop, _width(request, 800)


def _text(request: Request, name: str) -> str:
    return request.query_params.get(name, '')


def _width(request: Request, default: int) -> int:
    return int(_number(request, 'width', default))


def _number(request: Request, name: str, default: float) -> float:
    try:
        value = float(request.query_params.get(name, default))
    except ValueError:
        raise InputError(f'{name}: not a number') from None
    return value if -1e12 < value < 1e12 else default


async def _page(request: Request) -> Response:
    name = request.path_params.get('name', 'index.html')
    path = _PAGE / name
    if Path(name).name != name or path.suffix not in _KINDS or not path.is_file():
        return _json({'error': 'there is no such page'}, 404)
    return FileResponse(
        path, media_type=_KINDS[path.suffix], headers={'Cache-Control': 'no-cache'}
    )


async def _plotly(request: Request) -> Response:
    """The plotting library as the Python package has it, whose import takes a second."""
    package = find_spec('plotly')
    assert package is not None
    assert package.origin is not None
    path = Path(package.origin).parent / 'package_data' / 'plotly.min.js'
    headers = {'Cache-Control': 'private, max-age=86400'}
    return FileResponse(path, media_type='text/javascript', headers=headers)
