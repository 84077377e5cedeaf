"""Work of a session in a process of its own: started, watched, cancelled by its end."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Literal

from power_workbench.piped_process import PipedProcess

State = Literal['running', 'done', 'error', 'cancelled']
_LOST = 'the worker ended unexpectedly (out of memory?); the steps so far are kept, try again'


@dataclass
class SessionJob:
    """One piece of work: its name, its stage in words, and whether it ended well."""

    name: str
    stage: str = 'starting'
    state: State = 'running'
    error: str = ''
    started: float = field(default_factory=time.monotonic)

    def content(self) -> dict[str, Any]:
        """Return the job, which runs, as content of JSON for the page."""
        return {
            'name': self.name,
            'stage': self.stage,
            'state': self.state,
            'error': self.error,
            'seconds': round(time.monotonic() - self.started, 1),
        }


class JobRunner(PipedProcess):
    """Worker process of a session, which does one job at a time.

    The listener is called in a separate thread with (job, kind, content) for every message, job
    None for what was requested `beside` the jobs. A cancelled job's messages are dropped with its
    process, and the next job starts a fresh one.
    """

    def __init__(self, listener: Callable[[SessionJob | None, str, Any], None]) -> None:
        super().__init__('power_workbench.sessions.worker_process')
        self._listener = listener
        self.job: SessionJob | None = None

    @property
    def busy(self) -> bool:
        """True while a job runs."""
        return self.job is not None and self.job.state == 'running'

    def warm(self) -> None:
        """Start the worker process, so that its imports are done when the first job comes."""
        with self._lock:
            self._start()

    def run(self, name: str, request: str, arguments: Mapping[str, Any]) -> SessionJob:
        """Begin a job that calls a method of `SessionWorker`; RuntimeError while one runs."""
        with self._lock:
            if self.busy:
                raise RuntimeError('a job is running')
            self._start()  # where that fails, no job is left behind
            self.job = SessionJob(name)
            self._request(request, arguments)
            return self.job

    def beside(self, request: str, arguments: Mapping[str, Any]) -> None:
        """Call a method of `SessionWorker` that may run while a job does, without a job."""
        with self._lock:
            self._request(request, arguments)

    def _request(self, request: str, arguments: Mapping[str, Any]) -> None:
        self._start()
        assert self._pipe is not None
        self._pipe.send((request, dict(arguments)))

    def cancel(self) -> None:
        """End the running job with its process, and with what that had loaded."""
        with self._lock:
            if not self.busy:
                return
            job = self.job
            self._end()
        self._listener(job, 'cancelled', None)

    def close(self) -> None:
        """End the process, and with it a running job."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        if self.job is not None and self.busy:
            self.job.state = 'cancelled'
        self._stop()

    def _heard(self, pipe: Connection, message: tuple[str, Any] | None) -> None:
        kind, content = message or ('error', _LOST)
        with self._lock:
            job = None if kind == 'budget' else self.job
            if pipe is not self._pipe or (kind != 'budget' and not self.busy):
                return
            if job is None:
                pass
            elif kind == 'progress':
                job.stage = str(content)
            elif kind == 'done':
                job.state = 'done'
            elif kind in ('error', 'failed'):
                job.state, job.error = 'error', str(content)
        self._listener(job, kind, content)
