"""Hostile requests, drawn at random from a seed: refused, nothing written, the server alive."""

import json
import socket
from urllib.parse import quote

import numpy as np
import pytest
from power_workbench.server.actions import ACTIONS
from power_workbench.server.guard import LONGEST_BODY
from workbench_page import served

COUNT = 150
TOKENS = (None, '', 'wrong', 'é' * 30, 'x' * 5000, '%00', '../..')
HOSTS = ('evil.example', '127.0.0.1', 'localhost:1', '[::1]', '127.0.0.1.evil.example', '@')
ORIGINS = ('null', 'http://evil.example', 'https://127.0.0.1', 'file://', 'http://127.0.0.1:1')
UP = ('..', '%2e%2e', '..%2f..', '..%5c..', '%252e%252e', '....//', '.', '%00', '~', '/')
FILES = ('etc/passwd', 'server.py', 'session.yaml', 'open.log', 'app.js%00.png', 'walk')
VALUES = (
    *(None, True, -1, 0, 1e308, 10**30, float('nan'), float('inf'), '', 'x' * 5000, '\0'),
    *('\ud800', '../..', '/etc/passwd', 'ppn:/etc', 'http://evil.example', '__class__'),
    *([], [[]], [None] * 50, {}, {'': {}}, {'velocity': [0, 1]}, [1, 'a'], 'file:///etc'),
)
KEYS = (
    *('kind', 'recordings', 'drives', 'slow', 'file', 'effects', 'per', 'base', 'seed', 'model'),
    *('at', 'drive', 'x', 'y', 'shown', 'start', 'stop', 'width', 'box', 'span', 'regime'),
    *('seconds', 'map', 'preview', 'text', '__proto__', 'sha256', 'rmse_w'),
)
KINDS = ('open', 'load', 'fit', 'add', 'remove', 'effects', 'erase')


@pytest.fixture(scope='module')
def bench(tmp_path_factory):
    """A workbench with one session, and a file beside its folder that is none of its own."""
    folder = tmp_path_factory.mktemp('fuzz')
    (folder / 'bags').mkdir()
    (folder / 'outside.py').write_text('raise SystemExit("run")')
    with served(folder, folder / 'bags') as running:
        running.folder = folder
        running.session = running.ask('/api/sessions', {})[1]['session']
        yield running


@pytest.fixture
def unharmed(bench):
    """The server answers, and no file was made or changed."""

    def files():
        found = sorted(bench.folder.rglob('*'))
        return {path: path.read_bytes() for path in found if path.is_file() and path != log}

    log = bench.folder / 'open.log'  # of what the server prints
    before = files()
    yield
    status, state = bench.ask(f'/api/sessions/{bench.session}/state')
    assert status == 200
    assert state['steps'] == []
    assert files() == before


def picked(rng, values):
    return values[int(rng.integers(len(values)))]


def paths(bench, rng):
    """Paths of the server, and some that lead out of it."""
    here = f'/api/sessions/{bench.session}'
    out = '/'.join(picked(rng, UP) for _ in range(rng.integers(1, 4)))
    file = picked(rng, FILES)
    return picked(
        rng,
        (
            f'/page/{out}/{file}',
            f'/page/{quote(f"{out}/{file}", safe="")}',
            f'/{out}/{file}',
            f'{here}/files/{out}/{file}',
            f'{here}/files/{quote(f"{out}/{file}", safe="")}',
            f'/api/sessions/{out}/state',
            f'/api/sessions/{quote(out, safe="")}/files/{file}',
        ),
    )


def test_wrong_tokens_hosts_and_origins_are_refused_at_every_path(bench, unharmed):
    rng = np.random.default_rng(17)
    here = f'/api/sessions/{bench.session}'
    known = ['/', '/page/app.js', '/plotly.js', '/api/known', '/api/sessions', f'{here}/state']
    known += [f'{here}/{name}' for name in ('traces', 'strip', 'map', 'live', *ACTIONS)]
    for _ in range(COUNT):
        wrong = picked(
            rng,
            (
                {'X_Token': picked(rng, TOKENS)},
                {'X_Token': None, 'Cookie': f'workbench_{bench.port}={picked(rng, TOKENS[1:3])}'},
                {'Host': picked(rng, HOSTS)},
                {'Origin': picked(rng, ORIGINS)},
            ),
        )
        body = picked(rng, (None, b'{}', b'{"kind": "open"}'))
        status, _ = bench.ask(picked(rng, known), body=body, **wrong)
        assert status in (400, 403), wrong


def test_no_path_leads_to_a_file_that_is_not_the_pages(bench, unharmed):
    rng = np.random.default_rng(18)
    for _ in range(COUNT):
        path = paths(bench, rng)
        status, said = bench.ask(path)
        assert status in (400, 404), path
        assert b'root:' not in (said if isinstance(said, bytes) else b'')


def test_bodies_of_any_content_are_refused_in_one_line(bench, unharmed):
    rng = np.random.default_rng(19)
    names = [name for name in ACTIONS if name not in ('cancel', 'note')]  # these take any
    for _ in range(COUNT):
        content = {picked(rng, KEYS): picked(rng, VALUES) for _ in range(int(rng.integers(0, 6)))}
        if rng.random() < 0.5:
            content |= {'kind': picked(rng, KINDS), 'recordings': [picked(rng, VALUES)]}
        if rng.random() < 0.2:
            content['file'] = str(bench.folder / 'outside.py')
        body = json.dumps(content).encode()
        if rng.random() < 0.2:
            place = int(rng.integers(len(body)))
            body = body[:place] + rng.bytes(3) + body[place:]
        name = picked(rng, names)
        status, said = bench.ask(f'/api/sessions/{bench.session}/{name}', body=body)
        assert status == 400, (name, body)
        assert said['error'].strip()
        assert '\n' not in said['error']


def test_questions_with_any_numbers_and_names_are_answered_or_refused(bench, unharmed):
    rng = np.random.default_rng(20)
    names = ('traces', 'strip', 'map', 'preview', 'log')
    for _ in range(COUNT):
        keys = ('drive', 'from', 'to', 'width', 'x', 'y', 'candidate', 'after')
        query = '&'.join(
            f'{picked(rng, keys)}={quote(str(picked(rng, VALUES)), errors="replace")}'
            for _ in range(int(rng.integers(0, 5)))
        )
        status, _ = bench.ask(f'/api/sessions/{bench.session}/{picked(rng, names)}?{query}')
        assert status in (200, 400), query


def test_a_gigabyte_is_refused_before_it_is_there_whether_its_length_is_said_or_not(
    bench, unharmed
):
    rng = np.random.default_rng(21)
    head = (
        f'POST {{}} HTTP/1.1\r\nHost: 127.0.0.1:{bench.port}\r\nX-Token: {bench.token}\r\n'
        'Content-Type: application/json\r\n'
    )
    for name in (*ACTIONS, ''):
        path = f'/api/sessions/{bench.session}/{name}' if name else '/api/sessions'
        length = int(rng.integers(LONGEST_BODY + 1, 10**9))
        with socket.create_connection(('127.0.0.1', bench.port), timeout=20) as link:
            link.sendall(f'{head.format(path)}Content-Length: {length}\r\n\r\n'.encode())
            assert link.recv(100).startswith(b'HTTP/1.1 413')
        with socket.create_connection(('127.0.0.1', bench.port), timeout=20) as link:
            link.sendall(f'{head.format(path)}Transfer-Encoding: chunked\r\n\r\n'.encode())
            sent, part = 0, b'10000\r\n' + b' ' * 0x10000 + b'\r\n'
            try:
                while sent < 10**9:
                    link.sendall(part)
                    sent += 0x10000
            except OSError:
                pass  # it hung up
            assert sent < 100 * LONGEST_BODY


def test_what_is_no_http_ends_its_own_connection_alone(bench, unharmed):
    rng = np.random.default_rng(22)
    for _ in range(40):
        with socket.create_connection(('127.0.0.1', bench.port), timeout=20) as link:
            try:
                link.sendall(rng.bytes(int(rng.integers(1, 3000))) + b'\r\n\r\n')
                said = link.recv(100)
            except OSError:
                said = b''
            assert said == b'' or said.startswith(b'HTTP/1.1 400')
