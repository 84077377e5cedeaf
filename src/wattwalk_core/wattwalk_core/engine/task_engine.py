"""Tasks shared out to processes of this machine or to the workers of a Dask scheduler."""

import logging
import os
import platform
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

from threadpoolctl import threadpool_limits

from wattwalk_core.engine.options import Workplace
from wattwalk_core.errors import InputError, printable
from wattwalk_core.files import code_fingerprint

if TYPE_CHECKING:
    from distributed import Client, Future, LocalCluster

Item = TypeVar('Item')
Result = TypeVar('Result')

_PATIENCE: Final = 5.0  # s, for a scheduler to answer
_WORKERS_WITHIN: Final = 10.0  # s, for a scheduler to have a worker
_LOGS: Final = ('distributed', 'tornado')
_BEFORE: Final = {
    **{f'{name}_NUM_THREADS': '1' for name in ('OMP', 'OPENBLAS', 'MKL', 'NUMBA')},
    'MALLOC_TRIM_THRESHOLD_': str(256 << 20),
    'MALLOC_MMAP_THRESHOLD_': str(32 << 20),
}
"""
Environment of local workers: one thread, and bytes from which the C library gives memory back.
Dask's 64 KiB has the kernel clear the pages of every array anew.
"""


def _run(
    function: Callable[[Item], Result], code: tuple[str, ...], expected: str, item: Item
) -> Result:
    """Run a function, whose products get one thread, on a worker that has the expected code."""
    if expected and (found := _installed(code)) != expected:
        raise InputError(
            f'worker on {platform.node()} has other versions ({found}) than this machine '
            f'({expected}): install the same on both'
        )
    with threadpool_limits(limits=1):
        return function(item)


class TaskEngine:
    """Runs a function on each of many tasks, in this process or on workers.

    Workers are begun with the first call that has more than one task. They import the function by
    its name, and functions and items are pickled. A task runs again where its worker is lost, so
    that it must not matter how often it has begun. Results do not depend on the number of
    workers: a seed belongs to a task, and products of matrices have one thread everywhere.
    """

    def __init__(
        self,
        place: Workplace | None = None,
        say: Callable[[str], None] = lambda line: print(line, file=sys.stderr),
    ) -> None:
        """place: None for one process to a core; say: called with the dashboard's address."""
        self.place = place or Workplace()
        self._say = say
        self._open = ExitStack()
        self._cluster: LocalCluster | None = None
        self._client: Client | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is not None:
            self._kill()
        self._open.close()
        self._client = self._cluster = None

    def completed(
        self, function: Callable[[Item], Result], items: Sequence[Item], code: Sequence[str] = ()
    ) -> Iterator[tuple[int, Result]]:
        """Yield (index of the item, result of the function) of each item as its task ends.

        code: packages or modules that must be the same on the workers of a scheduler, by default
        the function's package. A task's error is raised here, and the others are cancelled.
        InputError for a scheduler that cannot be used, or a task that workers do not survive.
        """
        for place, outcome in self._ended(function, items, code):
            yield place, outcome()

    def in_order(
        self, function: Callable[[Item], Result], items: Sequence[Item], code: Sequence[str] = ()
    ) -> Iterator[Result]:
        """Yield the function's results in the order of the items, each once those before it are.

        Of several errors the one of the first item is raised; else as `completed`.
        """
        waiting: dict[int, Callable[[], Result]] = {}
        due = 0
        for place, outcome in self._ended(function, items, code):
            waiting[place] = outcome
            while due in waiting:
                yield waiting.pop(due)()
                due += 1

    def _ended(
        self, function: Callable[[Item], Result], items: Sequence[Item], code: Sequence[str]
    ) -> Iterator[tuple[int, Callable[[], Result]]]:
        """Yield places of items as their tasks end, each with a call for its result."""
        remote = bool(self.place.scheduler)
        if not items or (not remote and self.place.processes(len(items)) == 1):
            for place, item in enumerate(items):
                yield place, partial(_run, function, (), '', item)
            return
        from distributed import as_completed  # slow to import

        names = tuple(code) or (_package_of(function),)
        task = partial(_run, function, names, _installed(names) if remote else '')
        client = self._client or self._begin(len(items))
        futures = client.map(task, items, pure=False, key='task')
        places = {future.key: place for place, future in enumerate(futures)}
        try:
            for future in as_completed(futures, loop=client.loop):
                place = places[future.key]
                yield place, partial(self._result, future, items[place])
        finally:
            with suppress(Exception):
                client.cancel(futures, force=True)

    def _result(self, future: 'Future[Any]', item: object) -> Any:
        from distributed import KilledWorker  # slow to import
        from distributed.client import FutureCancelledError
        from distributed.comm import CommClosedError

        try:
            result = future.result()
            future.release()
            return result
        except KilledWorker:
            raise InputError(
                f'{printable(str(item))}: every worker that took it was lost; is there memory '
                'enough for so many at a time?'
            ) from None
        except (FutureCancelledError, CommClosedError):
            raise InputError(
                f'the scheduler {self.place.scheduler} was lost; run again when it is back'
            ) from None
        except (ImportError, AttributeError) as error:
            if not self.place.scheduler:
                raise
            raise InputError(
                f'--scheduler {self.place.scheduler}: {error}; install the same there'
            ) from None

    def _begin(self, tasks: int) -> 'Client':
        import distributed  # noqa: F401  gives its loggers levels of their own

        # A lost worker is no news, its tasks run again; and a lost scheduler is told in one line.
        for name in [name for name in logging.root.manager.loggerDict if name.startswith(_LOGS)]:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        client = self._connect() if self.place.scheduler else self._start(tasks)
        self._client = client
        self._open.callback(client.close, timeout=_PATIENCE)
        return client

    def _connect(self) -> 'Client':
        from distributed import Client, Security  # slow to import; one process does without

        address = self.place.scheduler
        security = Security()
        if (
            address.startswith('tls:')
            and not security.get_connection_args('client')['ssl_context']
        ):
            raise InputError(
                f'--scheduler {address}: no certificates; name them under distributed.comm.tls in '
                'the configuration of Dask'
            )
        if address.startswith('tcp:') and security.require_encryption:
            raise InputError(f'--scheduler {address}: the configuration of Dask wants tls://')
        try:
            client = Client(address, timeout=_PATIENCE, set_as_default=False, security=security)
        except (OSError, TimeoutError) as error:
            raise InputError(
                f'--scheduler {address}: no scheduler answers there '
                f'({type(error).__name__}); start one by `dask scheduler`'
            ) from None
        try:
            client.wait_for_workers(1, timeout=_WORKERS_WITHIN)
        except TimeoutError:
            client.close(_PATIENCE)
            raise InputError(
                f'--scheduler {address}: it has no workers; start some by `dask worker {address}`'
            ) from None
        self._say(f'dashboard: {client.dashboard_link}')
        return client

    def _start(self, tasks: int) -> 'Client':
        import dask  # slow to import; one process does without
        from distributed import Client, LocalCluster, Security
        from distributed.utils import LoopRunner

        scratch = self._open.enter_context(TemporaryDirectory(prefix='wattwalk_'))
        loop = LoopRunner()
        # Workers inherit the mask of the thread that starts them, and leave Ctrl-C to this one.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            loop.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        self._open.callback(loop.stop)
        # Nannies read what their workers begin with from the configuration alone.
        with dask.config.set({'distributed.nanny.pre-spawn-environ': _BEFORE}):
            # Other users of the machine reach a port on loopback, so that only a key opens it.
            self._cluster = cluster = LocalCluster(
                n_workers=self.place.processes(tasks),
                threads_per_worker=1,
                memory_limit=0,
                host='127.0.0.1',
                dashboard_address='127.0.0.1:0',
                security=Security.temporary(),
                silence_logs=logging.CRITICAL,
                loop=loop.loop,
                local_directory=scratch,
            )
        self._open.callback(cluster.close, timeout=_PATIENCE)
        if find_spec('bokeh') is not None:
            self._say(f'dashboard: {cluster.dashboard_link}')
        return Client(cluster, set_as_default=False)

    def _kill(self) -> None:
        """End local workers at once, without waiting for their tasks."""
        for nanny in self._cluster.workers.values() if self._cluster is not None else ():
            nanny.auto_restart = False
            if nanny.process is not None and nanny.process.pid:
                with suppress(ProcessLookupError):
                    os.kill(nanny.process.pid, signal.SIGKILL)


def _package_of(function: Callable[..., Any]) -> str:
    inner = getattr(function, 'func', function)
    return str(inner.__module__).partition('.')[0]


def _installed(code: tuple[str, ...]) -> str:
    """Versions that results depend on, in words."""
    python = '.'.join(platform.python_version_tuple()[:2])
    digest = code_fingerprint(*code)[:8]
    return f'Python {python}, numpy {version("numpy")}, code {digest}'
