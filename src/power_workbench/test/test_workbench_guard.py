"""The server refuses whom it does not know, and lives on."""

import socket

import pytest
from power_workbench.commands.arguments import open as open_command
from power_workbench.server.guard import LONGEST_BODY
from workbench_page import served


@pytest.fixture(scope='module')
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp('guard')
    (folder / 'bags').mkdir()
    with served(folder, folder / 'bags') as running:
        running.folder = folder
        yield running


def written(folder):
    return sorted(path.name for path in (folder / 'workbench').glob('**/*'))


def test_a_token_opens_the_page_and_becomes_a_cookie_that_no_other_site_can_send(bench):
    import http.client

    connection = http.client.HTTPConnection('127.0.0.1', bench.port)
    connection.request('GET', f'/?token={bench.token}')
    answer = connection.getresponse()
    cookie = answer.getheader('Set-Cookie')
    assert answer.status == 303
    assert 'SameSite=Strict' in cookie
    assert 'HttpOnly' in cookie
    answer.read()
    status, page = bench.ask('/', X_Token=None, Cookie=cookie.partition(';')[0])
    assert status == 200
    assert b'<h1>Workbench</h1>' in page


@pytest.mark.parametrize(
    'headers',
    [
        {'X_Token': None},
        {'X_Token': 'wrong'},
        {'X_Token': 'é' * 30},
        {'X_Token': None, 'Cookie': 'workbench=x; ;;=;"'},
        {'Host': 'evil.example'},
        {'Host': 'evil.example:80'},
        {'Host': ''},
        {'Origin': 'http://evil.example'},
        {'Origin': 'null'},
    ],
    ids=str,
)
def test_a_wrong_token_a_foreign_host_and_a_foreign_origin_are_refused(bench, headers):
    before = written(bench.folder)
    for path in ('/', '/api/known', '/plotly.js', '/page/app.js'):
        assert bench.ask(path, **headers)[0] in (400, 403)
    assert bench.ask('/api/sessions', {}, **headers)[0] in (400, 403)
    assert written(bench.folder) == before


def test_a_token_in_the_address_serves_for_the_first_page_alone(bench):
    assert bench.ask(f'/api/known?token={bench.token}', X_Token=None)[0] == 403
    assert bench.ask('/?token=wrong', X_Token=None)[0] == 403


def test_a_body_that_is_too_large_is_refused_before_it_is_read(bench):
    before = written(bench.folder)
    with socket.create_connection(('127.0.0.1', bench.port), timeout=20) as link:
        head = (
            f'POST /api/sessions HTTP/1.1\r\nHost: 127.0.0.1:{bench.port}\r\n'
            f'X-Token: {bench.token}\r\nContent-Type: application/json\r\n'
        )
        link.sendall(f'{head}Content-Length: {10**9}\r\n\r\n'.encode())
        assert link.recv(100).startswith(b'HTTP/1.1 413')
    with socket.create_connection(('127.0.0.1', bench.port), timeout=20) as link:
        link.sendall(
            head.replace('/api/sessions', '/api/sessions/x/step').encode()
            + b'Transfer-Encoding: chunked\r\n\r\n'
        )
        part = b'10000\r\n' + b' ' * 0x10000 + b'\r\n'
        try:
            for _ in range(3 * LONGEST_BODY // 0x10000):
                link.sendall(part)
            said = link.recv(100)
        except OSError:
            said = b'HTTP/1.1 413'  # it hung up while we went on
        assert said.startswith(b'HTTP/1.1 413')
    assert bench.ask('/api/known')[0] == 200
    assert written(bench.folder) == before


def test_a_file_is_taken_whole_under_the_name_of_a_log_into_the_session_alone(bench):
    session = bench.ask('/api/sessions', {})[1]['session']
    here, before = f'/api/sessions/{session}/upload', written(bench.folder)
    kind = {'Content_Type': 'application/octet-stream'}
    for name in ('run.py', '..%2Flog.csv', '%2Fetc%2Flog.csv', '.csv', 'a%00.csv', ''):
        assert bench.ask(f'{here}?name={name}', body=b'1', **kind)[0] == 400, name
    assert bench.ask(f'{here}?name=log.csv', body=b'1')[0] == 415
    assert bench.ask(f'{here}?name=log.csv', body=b'1', **kind, X_Token=None)[0] == 403
    assert bench.ask(f'{here}?name=log.csv', body=b'1', **kind, Origin='null')[0] == 403
    lengths = {'Content_Length': str(3 << 30)}
    assert bench.ask(f'{here}?name=log.csv', body=b'1', **kind, **lengths)[0] == 413
    assert written(bench.folder) == before
    status, said = bench.ask(f'{here}?name=log.csv', body=b't,v\n' * 200_000, **kind)
    assert status == 200
    folder = bench.folder / 'workbench' / session / 'logs'
    assert said == {'file': str(folder / 'log.csv')}
    assert [(one.name, one.stat().st_size) for one in folder.iterdir()] == [('log.csv', 800_000)]


@pytest.mark.parametrize(
    'path',
    [
        '/page/../server.py',
        '/page/%2e%2e/server.py',
        '/page/..%2fserver.py',
        '/page/app.py',
        '/api/sessions/../../x/state',
        '/api/sessions/%2e%2e/state',
        '/api/sessions/..%2f..%2fetc/state',
    ],
)
def test_no_path_leads_out_of_the_page_or_of_the_sessions(bench, path):
    assert bench.ask(path)[0] == 404


def test_actions_stay_in_the_folders_that_were_named_and_wrong_contents_are_refused(bench):
    session = bench.ask('/api/sessions', {})[1]['session']
    here = f'/api/sessions/{session}'
    outside = bench.folder / 'outside.py'
    outside.write_text('raise SystemExit("run")')
    assert bench.ask(f'{here}/state')[1]['steps'] == []
    before = written(bench.folder)
    for step in (
        {'kind': 'open', 'recordings': ['/etc']},
        {'kind': 'open', 'recordings': [f'{bench.folder}/bags/../outside.py']},
        {'kind': 'effects', 'file': str(outside)},
        {'kind': 'load', 'file': f'{bench.folder}/bags/../other.yaml'},
        {'kind': 'load', 'file': 'ppn:/etc'},
        {'kind': 'fit', 'effects': ['idle'], 'model': '../x.yaml'},
        {'kind': 'fit', 'effects': ['idle'], 'base': 'ppn:/etc'},
        {'kind': 'fit', 'effects': ['idle']},
        {'kind': 'erase', 'file': 'x'},
        {'kind': 'open', 'recordings': [1]},
        {},
    ):
        status, said = bench.ask(f'{here}/step', step)
        assert status == 400, step
        assert said['error']
    for name in ('..%2fsession.yaml', 'open.log', 'session.yaml%00', '..'):
        assert bench.ask(f'{here}/files/{name}')[0] in (400, 404)
    for path, content in (
        ('go', {'at': 7}),
        ('go', {'at': 'x'}),
        ('allow', {'file': str(outside)}),
        ('diagnose', {}),
        ('select', {'drive': 'A', 'x': 'torque', 'y': 'velocity', 'box': {}}),
    ):
        assert bench.ask(f'{here}/{path}', content)[0] == 400
    for body in (b'', b'[]', b'{', b'[' * 100_000, b'\xff'):
        assert bench.ask(f'{here}/step', body=body)[0] == 400
    assert bench.ask(f'{here}/traces?from=nan&to=x')[0] == 400
    assert bench.ask(f'{here}/step', method='PUT', body=b'{}')[0] == 405
    assert bench.ask(f'{here}/step', body=b'{}', Content_Type='text/plain')[0] == 415
    assert written(bench.folder) == before
    assert bench.ask(f'{here}/state')[1]['steps'] == []


def test_answers_tell_the_browser_to_run_nothing_else(bench):
    import http.client

    connection = http.client.HTTPConnection('127.0.0.1', bench.port)
    connection.request('GET', '/', headers={'X-Token': bench.token})
    answer = connection.getresponse()
    policy = answer.getheader('Content-Security-Policy')
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy
    assert answer.getheader('Referrer-Policy') == 'no-referrer'
    assert answer.getheader('X-Content-Type-Options') == 'nosniff'


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['--host', '0.0.0.0'], '--token'),
        (['--host', '0.0.0.0', '--token', 'short'], '16 or more'),
        (['--port', '70000'], '0..65535'),
        (['no/such/bag'], 'does not exist'),
        (['--model', 'no_such.yaml'], 'no_such.yaml'),
    ],
)
def test_bad_arguments_are_refused_in_one_line(arguments, said, capsys):
    assert open_command([*arguments, '--no-browser']) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count('\n') == 1
