"""The worker: a process that does the heavy work of one session and answers over a pipe."""

import os
import sys
import threading
import traceback
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any

from wattwalk_core.errors import InputError

_NICER = 5  # than the page's server, which answers while work is done


def main(descriptor: int) -> None:
    """Answer requests (name, arguments) in turn with messages (kind, content).

    Kinds: `progress` a text, `view` a view before the end, `done` the result, `error` a line for
    the user, `failed` a traceback; `budget` an energy budget, which is worked out beside the other
    requests, and before it a first look. Ends with the other end of the pipe, at once.
    """
    os.nice(_NICER)
    pipe = Connection(descriptor)
    waiting: SimpleQueue[Any] = SimpleQueue()
    budgets: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_receive, args=(pipe, waiting, budgets), daemon=True).start()

    from power_workbench.sessions.opened_cache import OpenedCache  # slow to import
    from power_workbench.sessions.worker import SessionWorker

    worker = SessionWorker(OpenedCache.usual())
    one_at_a_time = threading.Lock()

    def show(kind: str, content: Any) -> None:
        with one_at_a_time:
            pipe.send((kind, content))

    def account() -> None:
        while True:
            latest = budgets.get()
            while not budgets.empty():
                latest = budgets.get()
            worker.budget(partial(show, 'budget'), **latest)

    threading.Thread(target=account, daemon=True).start()
    name, arguments = waiting.get()
    _answer(show, getattr(worker, name), arguments)
    threading.Thread(target=worker.prepare, daemon=True).start()
    while True:
        name, arguments = waiting.get()
        _answer(show, getattr(worker, name), arguments)


def _answer(show: Callable[[str, Any], None], function: Any, arguments: Any) -> None:
    try:
        show('done', function(show, **arguments))
    except InputError as error:
        show('error', str(error))
    except MemoryError:
        show('error', 'the memory of this machine is used up; open fewer or shorter recordings')
    except Exception as error:
        traceback.print_exc()
        show('failed', f'{type(error).__name__}: {error}')


def _receive(pipe: Connection, waiting: 'SimpleQueue[Any]', budgets: 'SimpleQueue[Any]') -> None:
    """Pass requests on; the process ends as soon as nobody is there for its answers."""
    try:
        while True:
            name, arguments = pipe.recv()
            if name == 'budget':
                budgets.put(arguments)
            else:
                waiting.put((name, arguments))
    except (EOFError, OSError):
        os._exit(0)


if __name__ == '__main__':
    main(int(sys.argv[1]))
