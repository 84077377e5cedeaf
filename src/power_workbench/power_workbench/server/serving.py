"""The server of the workbench from its start to its end."""

import secrets
import socket
import webbrowser
from argparse import Namespace
from pathlib import Path
from types import FrameType

import uvicorn
from power_recordings.reading.bag_folder import find
from wattwalk_core.errors import InputError

from power_workbench.files.folders import Folders
from power_workbench.server.application import application
from power_workbench.server.guard import PageGuard
from power_workbench.sessions.manager import SessionManager
from power_workbench.sessions.steps import SessionStep

_LOOPBACK = '127.0.0.1'
_FOLDERS = (Path('bags'),)


def _manager(options: Namespace) -> SessionManager:
    """Return a manager of sessions, with the steps that a new session begins with."""
    spec = options.model or ''
    is_file = spec.endswith(('.yaml', '.yml'))
    files = [Path(spec.removeprefix('ppn:'))] if is_file or spec.startswith('ppn:') else []
    named = [*options.bags, *files, *options.effects_path, *_FOLDERS]
    effects = [str(file.resolve()) for file in options.effects_path]
    steps = [SessionStep('effects', file=file) for file in effects]
    bags = tuple(str(path.resolve()) for path in options.bags if _is_recording(path))
    if bags:
        doubts = {'slow': options.slow, 'anyway': options.anyway}
        drives = tuple(options.drives)
        steps.append(SessionStep('open', recordings=bags, drives=drives, **doubts))
        if spec:
            file = str(Path(spec).resolve()) if is_file else spec
            steps.append(SessionStep('load', file=file))
    return SessionManager(
        options.folder.resolve(), Folders.of(named), tuple(steps), approved=tuple(effects)
    )


def _is_recording(path: Path) -> bool:
    try:
        find(path)
    except InputError:
        return False
    return True


def serve(options: Namespace) -> int:
    """Serve until Ctrl-C and return the exit code; InputError where the port is taken.

    options: of the command `open`.
    """
    token = options.token or secrets.token_urlsafe(24)
    manager = _manager(options)
    with _listening(options.host or _LOOPBACK, options.port) as listener:
        port = listener.getsockname()[1]
        names = {_LOOPBACK, 'localhost'} | ({options.host} if options.host else set())
        guard = PageGuard(
            application(manager), token, {f'{name}:{port}' for name in names}, f'workbench_{port}'
        )
        config = uvicorn.Config(
            guard,
            log_level='warning',
            access_log=False,
            server_header=False,
            lifespan='off',
            ws='none',
            timeout_graceful_shutdown=1,
            h11_max_incomplete_event_size=32 * 1024,
        )
        address = f'http://{options.host or _LOOPBACK}:{port}/?token={token}'
        print(f'the workbench: {address}', flush=True)
        print('sessions are kept in', manager.folder, '(end with Ctrl-C)', flush=True)
        if options.browser:
            webbrowser.open(address)
        try:
            _EndingServer(config, manager).run(sockets=[listener])
        finally:
            manager.close()
    return 0


class _EndingServer(uvicorn.Server):
    """Answers those who wait for news before it ends, so that nothing has to be cut off."""

    def __init__(self, config: uvicorn.Config, manager: SessionManager) -> None:
        super().__init__(config)
        self._manager = manager

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take Ctrl-C or SIGTERM."""
        self._manager.end()
        super().handle_exit(sig, frame)


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    # With the protocol named, asyncio sends each part of an answer at once (TCP_NODELAY).
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(64)
    except OSError as error:
        listener.close()
        raise InputError(
            f'cannot listen on {host}:{port} ({error.strerror}); choose another --port'
        ) from error
    return listener
