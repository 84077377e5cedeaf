"""A running workbench for tests: its process, its address, questions by hand."""

import http.client
import json
import re
import shutil
import sys
from contextlib import contextmanager
from urllib.parse import urlsplit

from wattwalk_core.processes import ChildProcess

BROWSER = next(
    filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), None
)
SLOW = 180_000  # ms
PROGRAM = 'from power_workbench.commands.arguments import open; raise SystemExit(open())'


class Served:
    """The address of a workbench, and requests to it with any headers."""

    def __init__(self, process, address):
        self.process, self.address = process, address
        parts = urlsplit(address)
        self.port, self.token = parts.port, parts.query.removeprefix('token=')

    def ask(self, path, content=None, *, method=None, body=None, **headers):
        """Status and JSON (or bytes) of an answer; headers by name with _ for -."""
        connection = http.client.HTTPConnection('127.0.0.1', self.port, timeout=60)
        given = {'X-Token': self.token}
        if content is not None:
            body = json.dumps(content).encode()
        if body is not None:
            given['Content-Type'] = 'application/json'
        given |= {name.replace('_', '-'): value for name, value in headers.items()}
        given = {name: value for name, value in given.items() if value is not None}
        try:
            method = method or ('GET' if body is None else 'POST')
            connection.request(method, path, body=body, headers=given)
            answer = connection.getresponse()
            data = answer.read()
            kind = answer.getheader('Content-Type', '')
            return answer.status, json.loads(data) if 'json' in kind else data
        finally:
            connection.close()


def page_of(browser, address, complaints):
    """A page of a workbench; what it complains of in its console is added to complaints."""
    page = browser.new_context(viewport={'width': 1280, 'height': 900}).new_page()
    page.set_default_timeout(SLOW)
    page.on('pageerror', lambda error: complaints.append(str(error)))
    page.on(
        'console',
        lambda said: complaints.append(said.text) if said.type in ('error', 'warning') else None,
    )
    page.goto(address)
    return page


@contextmanager
def served(folder, *arguments):
    """A workbench whose sessions lie in folder/workbench."""
    folder.mkdir(exist_ok=True)
    command = [sys.executable, '-c', PROGRAM, *map(str, arguments)]
    command += ['--no-browser', '--port', '0', '--folder', str(folder / 'workbench')]
    with ChildProcess(command, folder / 'open.log') as process:
        address = process.wait_for_line(r'(http://\S+)', 120)[1]
        yield Served(process, re.sub(r'\x1b\[[0-9;]*m', '', address))
        process.interrupt()
        process.wait()
