"""A log of others becomes a recording on the page, by the map that one sees."""

import shlex

import numpy as np
import pytest
import yaml
from power_recordings.commands.arguments import import_logs as import_main
from power_recordings.importing.listing import preview_log
from power_recordings.importing.map_file import parse_map
from power_recordings.importing.sources import open_source
from power_recordings.reading.reader import Recording
from real_logs import REAL
from wattwalk_core.errors import InputError
from workbench_page import BROWSER, served

playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
in_browser = pytest.mark.skipif(BROWSER is None, reason='no Chromium on this machine')

SLOW = 60_000  # ms
HEAD = 'time_s,motor_pos_rev,motor_vel_rpm,motor_torque_Nm,bus_voltage_V,bus_current_A'
SIGNALS = ('position', 'velocity', 'effort')


@pytest.fixture(scope='module')
def browser():
    with playwright.sync_playwright() as running:
        made = running.chromium.launch(executable_path=BROWSER, args=['--no-sandbox'])
        yield made
        made.close()


@pytest.fixture
def logs(tmp_path):
    """A folder with one log: a motor swings at 100 Hz for 60 s with P = τω + 2 τ² + 3 W."""
    t = np.arange(6000) / 100
    angle = 0.4 * np.sin(2 * np.pi * 1.3 * t) + 0.2 * np.sin(2 * np.pi * 0.31 * t)  # rad
    speed = np.gradient(angle, t)
    torque = 0.5 * np.gradient(speed, t) / 10 + 0.3 * np.sin(2 * np.pi * 0.11 * t)
    power = torque * speed + 2 * torque**2 + 3
    columns = (t, angle / 2 / np.pi, speed * 30 / np.pi, torque, np.full(6000, 24.0), power / 24)
    folder = tmp_path / 'logs'
    folder.mkdir()
    rows = '\n'.join(','.join(f'{x:.9g}' for x in row) for row in np.stack(columns, axis=1))
    (folder / 'swing.csv').write_text(f'{HEAD}\n{rows}\n')
    return folder


def page_of(browser, address):
    page = browser.new_context(viewport={'width': 1280, 'height': 900}).new_page()
    page.set_default_timeout(SLOW)
    page.complaints = []
    page.on('pageerror', lambda error: page.complaints.append(str(error)))
    page.goto(address)
    return page


def look_into(page, log):
    page.get_by_text('Import CSV, MAT, HDF5 …').click()
    page.get_by_label('Log', exact=True).select_option(label=f'{log.parent.name}/{log.name}')
    page.get_by_role('button', name='Look into it').click()
    page.get_by_role('heading', name=f'Map of {log.name}').wait_for()


def imported(page, folder):
    """The recording that the page made, and the one that its command makes elsewhere."""
    page.get_by_role('button', name='Import', exact=True).click()
    page.get_by_text('Imported: ').wait_for()
    command = page.locator('#log-result pre.command').inner_text()
    words = shlex.split(command)
    assert words[:4] == ['ros2', 'run', 'power_recordings', 'import']
    made = Recording.open(folder / words[-1])
    again = folder / 'again'
    assert import_main([*words[4:-1], str(again)]) == 0
    return made, Recording.open(again)


def assert_same(one, other):
    for name in SIGNALS:
        left, right = (getattr(r.joint_states(), name) for r in (one, other))
        np.testing.assert_array_equal(left, right)


@in_browser
def test_a_log_is_looked_into_corrected_previewed_imported_and_opened(
    browser, logs, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with served(tmp_path / 'page', logs) as bench:
        page = page_of(browser, bench.address)
        look_into(page, logs / 'swing.csv')
        unit = page.get_by_label('DRIVE position: unit')
        assert unit.input_value() == 'rev'
        unit.fill('furlong')
        page.get_by_role('button', name='Preview in SI units').click()
        page.locator('#log-error', has_text='furlong').wait_for()
        row = page.locator('tr[data-place="drives.DRIVE.position"]')
        assert 'furlong' in row.inner_text()
        assert row.locator('[aria-invalid="true"]').count() == 1
        unit.fill('rev')
        page.get_by_label('Name of DRIVE').fill('KNEE')
        page.get_by_label('Name of DRIVE').press('Tab')
        page.get_by_label('KNEE torque: at').select_option(label='of the motor')
        voltage = page.get_by_label('KNEE voltage: column')
        assert voltage.input_value() == 'bus_voltage_V', 'a constant voltage is a voltage'
        voltage.fill('')
        page.get_by_role('button', name='Preview in SI units').click()
        page.locator('#log-error', has_text='current without voltage').wait_for()
        assert voltage.get_attribute('aria-invalid') == 'true'
        voltage.fill('= 24')
        page.get_by_role('button', name='Preview in SI units').click()
        shown = page.locator('#log-result tr', has_text='position')
        shown.wait_for()
        previewed = shown.inner_text()
        assert 'rad' in previewed
        assert page.locator('#log-error').inner_text() == ''
        made, again = imported(page, tmp_path)
        assert_same(made, again)
        assert made.card.torque == {'KNEE': 'motor'}
        highest = float(made.joint_states().position.max())
        assert f'{highest:.3g}' in previewed.split()
        page.get_by_role('button', name='Open the recording').click()
        page.get_by_role('button', name='Fit', exact=True).click()
        page.locator('#stairs-words', has_text='The first model is').wait_for()
        assert page.complaints == []


@in_browser
def test_a_real_log_is_imported_as_its_command_imports_it(browser, tmp_path, monkeypatch):
    log = REAL / 'ur3e_L1L2.csv'
    if not log.exists():
        pytest.skip('shared/real_data is not here')
    monkeypatch.chdir(tmp_path)
    with served(tmp_path / 'page', REAL) as bench:
        page = page_of(browser, bench.address)
        look_into(page, log)
        assert page.get_by_label('Time: column').input_value() == 'timestamp', 'not the row number'
        made, again = imported(page, tmp_path)
        assert len(made.joint_states().names) == 6
        assert_same(made, again)
        assert page.complaints == []


@in_browser
def test_a_map_of_efficiency_is_chosen_as_a_file_and_imported_with_its_power(
    browser, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bags').mkdir()
    log = tmp_path / 'elsewhere' / 'dyno.csv'
    log.parent.mkdir()
    rows = [f'{n},{m / 10},{50 + m},48' for n in range(500, 3000, 250) for m in range(1, 40, 3)]
    log.write_text('\n'.join(['speed_rpm,torque_Nm,system_efficiency_%,dc_voltage_V', *rows]))
    with served(tmp_path / 'page', tmp_path / 'bags') as bench:
        page = page_of(browser, bench.address)
        page.get_by_text('Import CSV, MAT, HDF5 …').click()
        page.get_by_label('A file of this computer').set_input_files(log)
        page.get_by_role('heading', name='Map of dyno.csv').wait_for()
        field = page.get_by_label('DRIVE efficiency: column')
        assert field.input_value() == 'system_efficiency_%'
        page.get_by_role('button', name='Import', exact=True).click()
        page.get_by_text('Imported: ').wait_for()
        words = shlex.split(page.locator('#log-result pre.command').inner_text())
        made = Recording.open(tmp_path / words[-1])
        power = made.drive_supply().power[:, 0]
        expected = 0.1 * 500 * np.pi / 30 / 0.51  # W of the first row
        assert power[0] == pytest.approx(expected, rel=1e-4)
        field.fill('')
        page.get_by_label('Signal to add to DRIVE').select_option('loss')
        assert page.get_by_label('DRIVE loss: column').input_value() == ''
        assert page.complaints == []


def test_logs_outside_the_folders_and_maps_that_are_none_are_refused(logs, tmp_path):
    with served(tmp_path / 'page', logs) as bench:
        session = bench.ask('/api/sessions', {})[1]['session']
        here = f'/api/sessions/{session}/log'
        for content in (
            {'file': '/etc/passwd'},
            {'file': f'{logs}/../secret.csv'},
            {'file': f'{logs}/swing.csv', 'map': []},
            {'file': f'{logs}/swing.csv', 'map': {}, 'preview': 'maybe'},
            {},
        ):
            status, said = bench.ask(here, content)
            assert status == 400, content
            assert said['error']


def test_a_preview_is_in_si_units_and_has_the_same_faults_as_the_import(logs):
    content = {
        'format': 'import/1',
        'time': {'column': 'time_s', 'unit': 's'},
        'drives': {
            'KNEE': {
                'velocity': {'from': 'motor_vel_rpm', 'unit': 'rpm'},
                'torque': {'from': 'motor_torque_Nm', 'unit': 'mN*m'},
                'voltage': {'value': 24, 'unit': 'V'},
                'current': {'from': 'bus_current_A', 'unit': 'A', 'positive': 'fed'},
            }
        },
    }
    source = open_source(logs / 'swing.csv')
    found = {one.quantity: one for one in preview_log(source, parse_map(content, 'map'), 'map')}
    raw = np.loadtxt(logs / 'swing.csv', delimiter=',', skiprows=1)
    assert found['velocity'].high == pytest.approx(raw[:, 2].max() * np.pi / 30)
    assert found['torque'].high == pytest.approx(raw[:, 3].max() / 1000)
    assert found['current'].high == pytest.approx(-raw[:, 5].min())
    assert (found['voltage'].low, found['voltage'].high) == (24, 24)
    assert {one.unit for one in found.values()} == {'rad/s', 'N*m', 'V', 'A'}
    content['drives']['KNEE']['torque']['from'] = 'motor_torque'
    with pytest.raises(InputError, match=r'^map: drives\.KNEE\.torque: no column'):
        preview_log(source, parse_map(yaml.safe_load(yaml.safe_dump(content)), 'map'), 'map')
