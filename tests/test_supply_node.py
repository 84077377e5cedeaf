"""The supply node in a process of its own, with a simulated instrument and the recorder."""

import re
import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from power_recordings.alignment.align import load_aligned
from power_recordings.reading.reader import Recording
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState, JointState
from sim_bridge.instruments.scpi import ScpiInstrument, SupplyState, Terminals
from std_srvs.srv import Trigger

from drive_power_msgs.msg import DriveSupply

PATIENCE = 300.0
DRIVES = ['LF_HAA', 'LF_HFE', 'LF_KFE']


class Robot:
    """Publishes three drives that draw 96 W and hears what the supply node says."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('robot', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        qos = QoSProfile(depth=1000)
        self.drives = self.node.create_publisher(DriveSupply, 'drive_supply', qos)
        self.joints = self.node.create_publisher(JointState, 'joint_states', qos)
        self.supply, self.reports = [], []
        self.node.create_subscription(BatteryState, 'supply', self.supply.append, qos)
        self.node.create_subscription(DiagnosticArray, 'diagnostics', self._hear, qos)
        self.sequence = 0
        self.start = self.sent = time.time_ns()

    def _hear(self, message):
        self.reports += [s for s in message.status if s.name == 'supply: instrument']

    def publish_until_now(self):
        """Samples at 1 kHz and joint states at 200 Hz up to now, a message each 50 samples."""
        while self.sent + 50_000_000 < time.time_ns():
            message = DriveSupply(name=DRIVES, sequence=self.sequence)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.sent, 10**9)
            message.header.frame_id = 'board'
            ticks = self.sent + np.arange(50, dtype=np.uint64) * np.uint64(1_000_000)
            message.device_time = ticks.tolist()
            message.voltage = [48.0] * 150
            message.current = [0.5, 1.0, 0.5] * 50
            message.status = [0] * 150
            self.drives.publish(message)
            for tick in ticks[::5].tolist():
                joints = JointState(name=DRIVES, position=[0.0] * 3, velocity=[0.0] * 3)
                joints.effort = [0.0] * 3
                joints.header.stamp.sec, joints.header.stamp.nanosec = divmod(tick, 10**9)
                self.joints.publish(joints)
            self.sequence += 50
            self.sent += 50_000_000

    def until(self, condition, publish=False):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'waited in vain; {self.last()}'
            self.executor.spin_once(timeout_sec=0.02)
            if publish:
                self.publish_until_now()

    def last(self):
        if not self.reports:
            return {}
        status = self.reports[-1]
        figures = {value.key: value.value for value in status.values}
        return {'level': status.level, 'message': status.message, **figures}

    def close(self):
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def robot(ros_domain):
    robot = Robot(ros_domain)
    yield robot
    robot.close()


@pytest.fixture
def instrument():
    instrument = ScpiInstrument(SupplyState(lambda: Terminals(48.0, 2.5)))
    yield instrument
    instrument.close()


def options(instrument, *more):
    given = [f'host:=127.0.0.1 -p port:={instrument.port} -p timeout:=5.0', *more]
    return ['--ros-args', *f'-p {" -p ".join(given)}'.split()]


def test_a_supply_is_published_recorded_aligned_and_set_against_the_drives(
    robot, instrument, node_process, tmp_path
):
    node_process('power_daq', 'supply', *options(instrument))
    robot.until(lambda: len(robot.supply) > 5)
    message = robot.supply[-1]
    assert (message.voltage, message.current) == (48.0, -2.5), 'a battery that is drawn from'
    assert np.isnan(message.percentage)
    assert np.isnan(message.charge)
    assert message.present
    assert message.header.frame_id == 'supply'

    robot.sent = time.time_ns()
    bag = tmp_path / 'bag'
    topics = ['drive_supply', 'joint_states', 'supply', 'diagnostics']
    recorder = node_process('power_daq', 'record', '-o', str(bag), '--topics', *topics)
    recorder.wait_for_output('recording to', timeout=PATIENCE)
    robot.until(
        lambda: 'supply minus drives (electronics), mean of 30 s [W]' in robot.last(), publish=True
    )
    figures = robot.last()
    assert float(figures['supply, mean of 1 s [W]']) == pytest.approx(120.0)
    assert float(figures['drives, mean of 1 s [W]']) == pytest.approx(96.0)
    assert float(figures['supply minus drives (electronics), mean of 30 s [W]']) == 24.0
    assert figures['drives compared'] == '3: LF_HAA, LF_HFE, LF_KFE'
    counted, seconds = float(figures['energy [J]']), float(figures['energy counted over [s]'])
    assert counted == pytest.approx(120.0 * seconds, abs=2.0)
    enough = robot.sent + 10**9
    robot.until(lambda: robot.sent > enough, publish=True)
    recorder.interrupt()
    assert recorder.wait(PATIENCE) == 0, recorder.output

    recording = Recording.open(bag)
    assert set(np.unique(recording.supply().current)) == {-2.5}
    data = load_aligned([bag], rate=50.0)
    known = data.supply[np.isfinite(data.supply)]
    assert len(known)
    np.testing.assert_allclose(known, 120.0)


def test_a_supply_that_goes_is_an_error_on_diagnostics_and_no_end(robot, instrument, node_process):
    node = node_process('power_daq', 'supply', *options(instrument, 'timeout:=0.5'))
    robot.until(lambda: robot.last().get('level') in (b'\0', b'\1') and robot.supply)
    instrument.close()
    robot.until(lambda: robot.last()['level'] == b'\2')
    assert 'supply absent' in robot.last()['message']
    robot.until(lambda: 'refused' in robot.last()['message'])
    heard, reports = len(robot.supply), len(robot.reports)
    robot.until(lambda: len(robot.reports) > reports + 1)
    assert len(robot.supply) == heard
    state = SupplyState(lambda: Terminals(48.0, -1.0))
    back = ScpiInstrument(state, port=instrument.port)
    try:
        robot.until(lambda: len(robot.supply) > heard + 5)
        assert robot.supply[-1].current == 1.0, 'power goes into the supply'
        robot.until(lambda: robot.last()['level'] != b'\2')
        assert int(robot.last()['readings lost']) > 0
        assert len(re.findall('supply absent, will try again', node.output)) == 1
        node.interrupt()
        assert node.wait(PATIENCE) == 0, node.output
    finally:
        back.close()


def test_the_energy_is_counted_from_zero_on_request(robot, instrument, node_process):
    node_process('power_daq', 'supply', *options(instrument))
    client = robot.node.create_client(Trigger, 'reset_energy')
    robot.until(lambda: float(robot.last().get('energy [J]', 0.0)) > 200.0)
    robot.until(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    robot.until(answer.done)
    assert answer.result().success
    assert re.match(r'\d+\.\d J \(0\.\d+ Wh\) in \d+\.\d s until now', answer.result().message)
    robot.until(lambda: float(robot.last()['energy counted over [s]']) < 2.0)


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ((), 'give the name or IPv4 address of the supply'),
        (('host:=x', 'rate:=1000.0'), 'from 1 to 200'),
        (('host:=x', 'switch_output_on:=true'), 'set_voltage is 0 V'),
        (('host:=x', 'set_voltage:=100.0'), 'from 0 to 60'),
    ],
)
def test_a_bad_parameter_ends_the_node_with_one_line(node_process, parameters, words):
    given = [word for parameter in parameters for word in ('-p', parameter)]
    node = node_process('power_daq', 'supply', '--ros-args', *given)
    assert node.wait(PATIENCE) == 2
    assert words in node.output
    assert len(node.own_lines) == 1
