"""The live view: its figures from the bytes of messages, its rows, and the command over DDS."""

import fcntl
import os
import pty
import re
import select
import subprocess
import sys
import termios
import time
from array import array
from io import StringIO

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from power_daq.commands.arguments import watch as main
from power_daq.monitor.screen import Screen, line
from power_daq.monitor.state import MonitorState
from power_recordings.messages import cdr
from rclpy.context import Context
from rclpy.qos import QoSProfile
from rich.cells import cell_len
from rich.console import Console
from wattwalk_core.anymal import JOINT_NAMES

from drive_power_msgs.msg import DriveSupply

LONG = 300.0
MS = 1_000_000
DRIVES = ['LF_HAA', 'LF_KFE']


def supply_messages(count, amps, *, first=0, status=0, start_ns=0):
    """`count` samples at 1 kHz of two drives at 48 V."""
    stamps = start_ns + MS * (first + np.arange(count))
    current = np.tile(np.asarray(amps, float), (count, 1))
    given = (stamps, first, stamps, DRIVES, 48.0, current, [40.0, 60.0], status)
    return cdr.in_a_list(*cdr.drive_supply_blocks(*given))


def battery_messages(stamps):
    """The supply at 50 V, which draws 4 A."""
    return cdr.in_a_list(cdr.battery_block(stamps, [50.0] * len(stamps), [-4.0] * len(stamps)))


def feed(state, topic, messages, now):
    for message in messages:
        state.source(topic).take(message, now)


def a_second(**options):
    """A state that has heard one second of 1 A and −0.5 A, and of the supply at 50 V, −4 A."""
    state = MonitorState(0.0)
    feed(state, 'drive_supply', supply_messages(1001, [1.0, -0.5], **options), 1.0)
    feed(state, 'supply', battery_messages(10 * MS * np.arange(101)), 1.0)
    return state


def test_watts_joules_and_what_is_left_for_the_electronics():
    view = a_second().view(1.0)
    assert [drive.power for drive in view.drives] == [48.0, -24.0]
    assert view.total == 24.0
    assert view.supply == 200.0
    assert view.electronics == 176.0
    assert view.drive_energy == pytest.approx(24.0)
    assert view.supply_energy == pytest.approx(200.0)
    assert [drive.temperature for drive in view.drives] == [40.0, 60.0]
    assert {topic.name: topic.rate for topic in view.topics}['drive_supply'] == 1001.0
    assert view.missed == 0


def test_energy_goes_on_from_look_to_look_and_a_gap_adds_nothing():
    state = MonitorState(0.0)
    feed(state, 'drive_supply', supply_messages(500, [1.0, 0.0]), 0.5)
    state.view(0.5)
    feed(state, 'drive_supply', supply_messages(501, [1.0, 0.0], first=500), 1.0)
    assert state.view(1.0).drive_energy == pytest.approx(48.0)
    feed(state, 'drive_supply', supply_messages(1001, [1.0, 0.0], first=9000), 2.0)
    view = state.view(2.0)
    assert view.drive_energy == pytest.approx(96.0)
    assert view.missed == 9000 - 1001


def test_a_gap_is_what_is_long_for_the_stream():
    """1 kHz for half a second, 20 ms of nothing, half a second again: 48 W over 2 × 0.499 s."""
    state = MonitorState(0.0)
    feed(state, 'drive_supply', supply_messages(500, [1.0, 0.0]), 0.5)
    feed(state, 'drive_supply', supply_messages(500, [1.0, 0.0], first=519), 1.0)
    assert state.view(1.0).drive_energy == pytest.approx(48.0 * 2 * 0.499)


@pytest.mark.parametrize('rate', [1, 5, 20, 100, 200])
def test_a_supply_of_any_rate_that_its_node_allows_has_an_energy(rate):
    """40 s at 200 W, looked at twice a second; then a minute of nothing, and 10 s more."""
    state = MonitorState(0.0)
    stamps = [i * 1_000_000_000 // rate for i in range(40 * rate + 1)]
    stamps += [100_000_000_000 + i * 1_000_000_000 // rate for i in range(10 * rate + 1)]
    for look in range(1, 222):
        now, before = 0.5 * look, 0.5 * (look - 1)
        part = [stamp for stamp in stamps if before <= stamp / 1e9 < now]
        if part:
            feed(state, 'supply', battery_messages(part), now)
        view = state.view(now)
    assert view.supply_energy == pytest.approx(200.0 * 50.0)


def test_status_flags_are_words():
    state = a_second(status=0)
    feed(state, 'drive_supply', supply_messages(1, [1, 1], first=1001, status=6), 1.0)
    assert {drive.status for drive in state.view(1.0).drives} == {'over range, device error'}


def test_what_no_longer_comes_is_no_longer_shown():
    state = a_second()
    state.view(1.0)
    view = state.view(5.0)
    assert not view.drives
    assert np.isnan(view.total)
    assert 'no drive_supply for 4 s' in view.warnings
    assert view.drive_energy == pytest.approx(24.0), 'what was measured stays measured'


def test_before_anything_came_it_says_what_to_start():
    assert 'ros2 run power_daq daq' in MonitorState(0.0).view(1.0).warnings[0]


def test_estimates_stand_beside_the_measurement_by_name():
    state = a_second()
    message = cdr.message(
        cdr.POWER_ESTIMATE, model='ppn:x', name=DRIVES[::-1], power=[-20.0, 50.0], total=30.0
    )
    feed(state, 'power_estimate', [cdr.serialize(cdr.POWER_ESTIMATE, message)], 1.0)
    view = state.view(1.0)
    assert [drive.estimate for drive in view.drives] == [50.0, -20.0]
    assert (view.estimate, view.estimate_status, view.model) == (30.0, 'ok', 'ppn:x')


def test_the_budget_of_ten_seconds_and_the_hours_left_stand_below_the_energy():
    """Drives 24 W, of which the model explains 20 W, supply 200 W: 10 Wh less 200 J last 3 min."""
    state = a_second()
    state.battery = 10.0
    figures = {'copper_loss [W]': '15.0', 'shaft [W]': '5.0'}
    state.report('power_estimator: budget', 0, '20.0 W', figures, 1.0)
    view = state.view(1.0)
    assert view.budget.parts == pytest.approx(
        {'electronics': 176.0, 'copper_loss': 15.0, 'shaft': 5.0, 'unexplained': 4.0}
    )
    assert view.hours == pytest.approx((10.0 - 200.0 / 3600.0) / 200.0)
    text = line(view, '12:00:00')
    assert 'in 10 s: electronics 176.0 W 88 %, copper loss 15.0 W 8 %' in text
    assert 'battery 0.05 h left' in text
    assert 'copper loss' not in line(state.view(4.0), '12:00:03'), 'the report is old'


def test_damaged_messages_are_told_and_do_no_harm():
    state = a_second()
    feed(state, 'drive_supply', [b'', b'\0\1\0\0junk', b'\xff' * 40], 1.0)
    view = state.view(1.0)
    assert view.total == 24.0
    assert any('drive_supply: 3 damaged messages' in warning for warning in view.warnings)


def report(state, level=0, sentence='measuring'):
    figures = {
        'bus state': 'active',
        'bus load [%]': '43.1',
        'electrical lost': '7',
        'clock board offset [s]': '1.234567',
        'clock board drift [ppm]': '-18.02',
        'clock board worst delay [us]': '131',
    }
    state.report('power_daq: bus', level, sentence, figures, 1.0)
    bag = {'size [B]': '12300000', 'samples lost': '2'}
    state.report('recorder: bag', 0, 'recording', bag, 1.0)


def twelve_drives():
    state = MonitorState(0.0)
    stamps = MS * np.arange(10)
    amps = np.linspace(-0.5, 3.0, 12) * np.ones((10, 1))
    given = (stamps, 0, stamps, JOINT_NAMES, 48.0, amps, np.full(12, 41.5))
    feed(state, 'drive_supply', cdr.in_a_list(*cdr.drive_supply_blocks(*given)), 1.0)
    report(state, 1, 'in the last second: 3 electrical lost')
    return state


def rendered(state, *, width=80, encoding='utf-8', environment=None):
    class Out(StringIO):
        pass

    Out.encoding = encoding
    screen = Screen()
    screen.update(state.view(1.0), '12:00:00')
    console = Console(file=Out(), width=width, force_terminal=True, _environ=environment or {})
    console.print(screen)
    return console.file.getvalue()


def test_twelve_drives_fit_on_a_terminal_of_80_by_24():
    rows = rendered(twelve_drives(), environment={'NO_COLOR': '1', 'TERM': 'xterm'}).splitlines()
    bare = [re.sub(r'\x1b\[[0-9;]*m', '', row) for row in rows]
    assert len(bare) <= 24
    assert max(cell_len(row) for row in bare) <= 80
    text = '\n'.join(bare)
    for shown in (
        'RH_KFE',
        '144.0 W',
        '41.5',
        'active, load 43.1 %',
        '1.235 s, -18.0 ppm, 131 us',
    ):
        assert shown in text
    assert 'bus 7, this view 0, recorder 2' in text
    assert 'recording, 12.3 MB' in text
    assert '! power_daq: bus: in the last second: 3 electrical lost' in text


def on_ethercat(state, interface='eth0', absence=''):
    figures = {
        'interface': interface,
        'segment': 'EK1100, EL3681',
        'segment state': absence or 'operating',
        'cycles lost': '13',
    }
    state.report('power_daq: segment', 2 if absence else 0, 'measuring', figures, 1.0)


@pytest.mark.parametrize('absence', ['', 'no slave answers'])
def test_a_daq_on_ethercat_shows_its_segment_and_the_cycles_that_it_lost(absence):
    state = a_second()
    on_ethercat(state, absence=absence)
    text = re.sub(
        r'\x1b\[[0-9;]*m', '', rendered(state, environment={'NO_COLOR': '1', 'TERM': 'xterm'})
    )
    assert re.search(rf'segment +{absence or "operating"}', text)
    assert 'cycles 13, this view 0' in text
    assert 'no diagnostics of the DAQ' not in text
    assert 'bus' not in text


def test_two_daqs_on_a_bus_and_on_ethercat_are_both_shown():
    state = twelve_drives()
    on_ethercat(state)
    rows = rendered(state, width=90, environment={'NO_COLOR': '1', 'TERM': 'xterm'}).splitlines()
    text = '\n'.join(re.sub(r'\x1b\[[0-9;]*m', '', row) for row in rows)
    assert 'active, load 43.1 %, segment operating' in text
    assert 'bus 7, cycles 13, this view 0, recorder 2' in text
    assert len(rows) <= 24


def test_however_many_nodes_complain_it_stays_on_24_rows():
    state = twelve_drives()
    for name in ('policy_runner', 'sim_bridge', 'supply'):
        state.report(name, 2, 'down', {}, 1.0)
    text = rendered(state)
    assert len(text.splitlines()) <= 24
    assert 'policy_runner: down' in text
    assert 'and 3 more: sim_bridge, supply, power_daq' in text


def test_without_colour_there_is_none():
    plain = rendered(twelve_drives(), environment={'NO_COLOR': '1', 'TERM': 'xterm'})
    assert not re.search(r'\x1b\[[0-9;]*(3[0-7]|38|4[0-7]|9[0-7])[;m]', plain)


def test_a_terminal_without_unicode_gets_bars_of_its_own():
    text = rendered(twelve_drives(), encoding='ascii')
    assert '####' in text
    assert '█' not in text


def test_one_line_has_it_all():
    state = a_second()
    report(state)
    text = line(state.view(1.0), '12:00:00')
    assert '\n' not in text
    for shown in ('24.0 W of supply 200.0 W', 'electronics 176.0 W', '24 J of 200 J', '0 missed'):
        assert shown in text


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [(['--duration', '-1'], '--duration is -1 s'), (['--save', 'x.png'], '--save is x.png')],
)
def test_bad_arguments_end_with_one_line(capsys, arguments, error):
    assert main(arguments) == 2
    stderr = capsys.readouterr().err
    assert error in stderr
    assert stderr.count('\n') == 1


class Robot:
    """Publishes drive_supply and diagnostics from the test's process, in the test's domain."""

    def __init__(self):
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('power_daq', context=self.context)
        self.drives = self.node.create_publisher(
            DriveSupply, 'drive_supply', QoSProfile(depth=1000)
        )
        self.words = self.node.create_publisher(DiagnosticArray, 'diagnostics', 10)
        self.sequence = 0

    def send(self):
        message = DriveSupply(name=DRIVES, sequence=self.sequence, status=array('B', [0, 0]))
        now = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
        message.device_time = array('Q', [self.sequence * MS])
        message.voltage, message.current = array('f', [48.0] * 2), array('f', [1.0, 2.0])
        self.drives.publish(message)
        self.sequence += 1
        if self.sequence % 200 == 0:
            values = [KeyValue(key='bus state', value='active')]
            status = DiagnosticStatus(
                level=DiagnosticStatus.WARN,
                name='power_daq: bus',
                message='a frame',
                values=values,
            )
            self.words.publish(DiagnosticArray(status=[status]))
        time.sleep(0.002)

    def close(self):
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def robot(ros_domain):
    made = Robot()
    yield made
    made.close()


def test_into_a_pipe_it_prints_a_line_at_a_time_and_ctrl_c_ends_it(robot, node_process):
    watch = node_process('power_daq', 'watch')
    deadline = time.monotonic() + LONG
    while not re.search(r'drives 144\.0 W.*a frame', watch.output):
        assert time.monotonic() < deadline, watch.output
        robot.send()
    robot.sequence += 50
    while ', 50 missed here' not in watch.output:
        assert time.monotonic() < deadline, watch.output
        robot.send()
    assert '\x1b' not in watch.output
    watch.interrupt()
    assert watch.wait(LONG) == 0
    assert 'Traceback' not in watch.output


def test_on_a_terminal_it_draws_a_screen_until_ctrl_c(robot, node_process, tmp_path):
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    picture = tmp_path / 'now.svg'
    run = 'import sys; from power_daq.commands.arguments import watch as main; sys.exit(main())'
    process = subprocess.Popen(
        [sys.executable, '-c', run, '--save', str(picture)],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        env={**os.environ, 'TERM': 'xterm-256color', 'COLUMNS': '80', 'LINES': '24'},
    )
    os.close(theirs)
    shown = b''

    def read():
        nonlocal shown
        while select.select([ours], [], [], 0)[0]:
            try:
                shown += os.read(ours, 65536)
            except OSError:
                return

    try:
        deadline = time.monotonic() + LONG
        while not (b'LF_KFE' in shown and b'96.0 W' in shown):
            assert time.monotonic() < deadline, shown
            robot.send()
            read()
        os.write(ours, b'\x03')
        while process.poll() is None:
            assert time.monotonic() < deadline, shown
            time.sleep(0.05)
            read()
        read()
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    assert process.returncode == 0, shown
    assert b'\x1b[?1049l' in shown, 'the terminal is given back as it was'
    assert b'Traceback' not in shown
    assert 'LF_KFE' in picture.read_text()
    assert 'https://cdn' not in picture.read_text(), 'it needs no network'
