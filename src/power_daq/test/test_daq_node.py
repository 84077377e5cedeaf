import os
import signal
import subprocess
import sys
import threading
import time

import can
import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from power_daq.acquisition.bus_acquisition import SampleQueue
from power_daq.acquisition.publishing import JointStatePublisher, PublishingThread, SupplyPublisher
from power_daq.acquisition.receiver import Sample
from power_daq.bus.description import BusDescription
from power_daq.nodes.card_topic import subscribe_to_cards
from power_recordings.calibration import label
from power_recordings.card import Card
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from signal_generator import SignalGenerator

from drive_power_msgs.msg import DriveSupply

DOMAIN = 1 + os.getpid() % 100
RUN = 'from power_daq.commands.arguments import daq; raise SystemExit(daq())'


class Topic:
    """A publisher that keeps what it is given."""

    def __init__(self):
        self.sent = []

    def publish(self, message):
        fields = message.get_fields_and_field_types()
        copy = {name: getattr(message, name) for name in fields if name != 'header'}
        copy['stamp'] = message.header.stamp.sec, message.header.stamp.nanosec
        self.sent.append(copy)


def electrical(sequence, drives=2):
    values = np.array([[48.0] * drives, [sequence] * drives, [0.0, 4.0][:drives]])
    return Sample('electrical', sequence, 10**9 * 5 + 10**6 * sequence, 1000 * sequence, values)


def warmth(stamp, *celsius):
    return Sample('temperature', 0, stamp, 0, np.array([celsius]))


def test_one_message_a_sample_carries_its_time_place_and_values():
    topic = Topic()
    SupplyPublisher(topic, ['hip', 'knee'], 'board').take(electrical(3))
    (sent,) = topic.sent
    assert sent['stamp'] == (5, 3_000_000)
    assert (sent['sequence'], list(sent['device_time'])) == (3, [3000])
    assert list(sent['voltage']) == [48.0, 48.0]
    assert list(sent['current']) == [3.0, 3.0]
    assert list(sent['status']) == [0, 4]
    assert sent['name'] == ['hip', 'knee']
    assert list(sent['temperature']) == []


def test_a_message_of_several_samples_ends_where_one_was_lost():
    topic = Topic()
    publisher = SupplyPublisher(topic, ['hip', 'knee'], 'board', samples_per_message=3)
    for sequence in [0, 1, 2, 3, 5, 6, 7, 8]:
        publisher.take(electrical(sequence))
    assert [(m['sequence'], len(m['device_time'])) for m in topic.sent] == [(0, 3), (3, 1), (5, 3)]
    assert list(topic.sent[2]['current']) == [5.0, 5.0, 6.0, 6.0, 7.0, 7.0]
    assert topic.sent[2]['stamp'] == (5, 5_000_000)
    publisher.flush()
    assert topic.sent[-1]['sequence'] == 8


def test_temperatures_go_out_by_name_until_they_are_old():
    topic = Topic()
    publisher = SupplyPublisher(topic, ['hip', 'knee'], 'board', 1, ['knee'])
    publisher.take_temperature(warmth(5 * 10**9, 41.5))
    publisher.take(electrical(0))
    publisher.take(electrical(2001))
    hip, knee = topic.sent[0]['temperature']
    assert np.isnan(hip)
    assert knee == 41.5
    assert list(topic.sent[1]['temperature']) == []


def test_joint_states_carry_torque_as_effort():
    topic = Topic()
    values = np.array([[0.1, 0.2], [1.0, 2.0], [30.0, 40.0]])
    JointStatePublisher(topic, ['hip', 'knee']).take(Sample('joints', 0, 7, 0, values))
    (sent,) = topic.sent
    assert list(sent['position']) == [0.1, 0.2]
    assert list(sent['velocity']) == [1.0, 2.0]
    assert list(sent['effort']) == [30.0, 40.0]
    assert sent['stamp'] == (0, 7)


def test_the_publishing_thread_empties_its_queue_before_it_ends():
    queue, done = SampleQueue(100), []
    thread = PublishingThread(queue, done.append)
    for sequence in range(50):
        queue.put(electrical(sequence))
    thread.start()
    thread.stop()
    thread.join()
    assert [sample.sequence for sample in done] == list(range(50))


def test_what_was_packed_and_not_yet_sent_goes_out_at_the_end_and_counts_only_then():
    queue, topic = SampleQueue(100), Topic()
    publisher = SupplyPublisher(topic, ['hip', 'knee'], 'board', samples_per_message=10)
    sent = []
    thread = PublishingThread(
        queue,
        lambda sample: sent.append(publisher.take(sample)),
        lambda: sent.append(publisher.flush()),
    )
    for sequence in range(17):
        queue.put(electrical(sequence))
    thread.start()
    thread.stop()
    assert thread.join()
    assert [len(m['device_time']) for m in topic.sent] == [10, 7]
    assert sent == [0] * 9 + [10] + [0] * 7 + [7]
    assert queue.published.total() == 0, 'to be counted by who publishes'


def test_an_error_while_publishing_comes_out_of_join():
    def refuse(sample):
        raise OSError('no room')

    queue = SampleQueue(10)
    thread = PublishingThread(queue, refuse)
    thread.start()
    queue.put(electrical(0))
    with pytest.raises(OSError, match='no room'):
        thread.join()
    assert thread.failed


class Listener:
    """A node in this process that collects what the DAQ publishes."""

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node('listener', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.supply, self.joints, self.diagnostics, self.cards = [], [], [], []
        subscribe_to_cards(self.node, self.cards.append)
        # On a busy machine the listener falls behind by more than a second.
        qos = QoSProfile(depth=20_000, reliability=ReliabilityPolicy.RELIABLE)
        for kind, topic, found in (
            (DriveSupply, 'drive_supply', self.supply),
            (JointState, 'joint_states', self.joints),
            (DiagnosticArray, 'diagnostics', self.diagnostics),
        ):
            self.node.create_subscription(kind, topic, found.append, qos)

    def until(self, condition, deadline=60.0):
        end = time.monotonic() + deadline
        while not condition():
            assert time.monotonic() < end, 'never happened'
            self.executor.spin_once(timeout_sec=0.1)

    def close(self):
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def listener():
    listener = Listener()
    yield listener
    listener.close()


@pytest.fixture
def robot(tmp_path):
    path = str(tmp_path / 'bus')
    with can.Bus(path, 'unixsocket', host=True) as bus:
        generator = SignalGenerator(BusDescription.load(), bus, drift=30e-6)
        stop = threading.Event()
        thread = threading.Thread(target=generator.run, args=(stop,))
        thread.start()
        yield generator
        stop.set()
        thread.join()


def start(tmp_path, *parameters):
    words = [f'interface:=unixsocket channel:={tmp_path}/bus', *parameters]
    options = [part for word in ' '.join(words).split() for part in ('-p', word)]
    return subprocess.Popen(
        [sys.executable, '-c', RUN, '--ros-args', *options],
        env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN)},
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process, number=signal.SIGINT):
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    return process.returncode, errors


def good(diagnostics):
    return [m.status[0] for m in diagnostics if m.status[0].level == b'\0']


def test_the_node_publishes_every_sample_and_says_how_it_does(tmp_path, listener, robot):
    calibration = tmp_path / 'cal.yaml'
    calibration.write_text('channels: {}')
    process = start(tmp_path, f'calibration:={calibration}')
    try:
        listener.until(lambda: len(listener.supply) > 1500)
        supply, reports = list(listener.supply), len(good(listener.diagnostics))
        listener.until(lambda: len(good(listener.diagnostics)) > reports + 1)
    finally:
        code, errors = finish(process)
    assert code == 0
    assert 'Traceback' not in errors
    joints = listener.joints
    assert (np.diff([m.sequence for m in supply]) == 1).all()
    assert list(supply[0].name) == list(BusDescription.load().drives)
    assert supply[0].header.frame_id == 'power_board'
    assert len(supply[-1].temperature) == 12
    assert len(joints) > 500
    assert len(joints[0].position) == 12
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in supply]
    repeated = int((np.diff(stamps) <= 0).sum())
    now = time.time_ns() - time.monotonic_ns()
    errors = [
        stamp - now - robot.true_time(message.device_time[0] // 1000)
        for stamp, message in zip(stamps, supply, strict=True)
    ]
    assert -1e6 < np.median(errors) < 5e6
    status = good(listener.diagnostics)[-1]
    assert status.name == 'power_daq: bus'
    assert status.message == 'measuring'
    values = {entry.key: entry.value for entry in status.values}
    # A sender that falls behind by 20 ms and catches up is a jump of its clock.
    assert repeated <= int(values['clock device jumps']) + int(values['steps of the system clock'])
    assert values['electrical lost'] == '0'
    assert values['bus state'] == 'active'
    (card,) = listener.cards
    assert card == Card(calibration=label(calibration))
    assert float(values['joints rate [Hz]']) > 100
    assert {'clock device drift [ppm]', 'bus load [%]', 'error frames'} <= set(values)


def test_parameters_change_the_packing_and_the_name_of_the_device(tmp_path, listener, robot):
    process = start(tmp_path, 'samples_per_message:=10', 'frame_id:=board_7')
    try:
        listener.until(lambda: len(listener.supply) > 20)
    finally:
        finish(process, signal.SIGTERM)
    sizes = [len(m.device_time) for m in listener.supply]
    assert max(sizes) == 10
    ends = np.array([m.sequence for m in listener.supply]) + sizes
    assert (ends[:-1] == [m.sequence for m in listener.supply][1:]).all()
    assert len(listener.supply[5].voltage) == 120
    assert listener.supply[0].header.frame_id == 'board_7'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_is_stopped_publishes_what_it_has(tmp_path, listener, robot, number):
    process = start(tmp_path, 'samples_per_message:=1000')
    try:
        listener.until(lambda: listener.supply)
        assert len(listener.supply[0].device_time) == 1000
        # Joint states go out one by one, 2.5 ms each: 450 of them say that more was measured.
        listener.until(lambda: len(listener.joints) > 450)
    finally:
        code, errors = finish(process, number)
    assert (code, errors.count('Traceback')) == (0, 0), errors
    listener.until(
        lambda: sum(len(m.device_time) for m in listener.supply) > 2.5 * len(listener.joints) - 50
    )


def test_a_bus_that_is_absent_is_an_error_on_diagnostics_and_no_end(tmp_path, listener):
    process = start(tmp_path)
    try:
        listener.until(lambda: listener.diagnostics)
        status = listener.diagnostics[0].status[0]
        assert status.level == b'\2'
        assert 'bus absent' in status.message
        with can.Bus(f'{tmp_path}/bus', 'unixsocket', host=True) as bus:
            generator = SignalGenerator(BusDescription.load(), bus)
            stop = threading.Event()
            thread = threading.Thread(target=generator.run, args=(stop,))
            thread.start()
            listener.until(lambda: len(listener.supply) > 100)
            stop.set()
            thread.join()
    finally:
        code, errors = finish(process)
    assert code == 0
    assert errors.count('bus absent, will try again') >= 1


@pytest.mark.parametrize(
    ('parameter', 'words'),
    [
        ('interface:=sockatcan', "unknown CAN interface 'sockatcan'"),
        ('samples_per_message:=0', 'from 1 to 1000'),
        ('bitrate:=fast', 'expected an integer'),
        ('dbc:=/gone.dbc', '/gone.dbc'),
        ('calibration:=/gone.yaml', '/gone.yaml'),
    ],
)
def test_a_bad_parameter_ends_the_node_with_one_line(tmp_path, parameter, words):
    process = start(tmp_path, parameter)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert words in errors
    assert errors.count('\n') == 1
