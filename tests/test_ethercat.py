"""SOEM against an emulated EtherCAT segment on a veth pair, alone and inside the DAQ node."""

import struct
import time

import network
import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from ethercat_peer import Peer
from hypothesis import given, settings
from hypothesis import strategies as st
from kept_log import KeptLog
from power_daq.ethercat.acquisition import SegmentAcquisition, SegmentPatience
from power_daq.ethercat.mapping import SegmentMapping
from power_daq.ethercat.soem import SoemSegment
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sim_bridge.instruments.ethercat.controller import DatagramCommand
from sim_bridge.instruments.ethercat.terminals import EK1100, EL3102, process

from drive_power_msgs.msg import DriveSupply

PATIENCE = 240.0
MAPPING = """
device: terminals
cycle: 0.005
frame_timeout: 0.5
segment: [EK1100, EL3102, EL3102]
electrical:
  drives:
    - drive: LF_HFE
      voltage: {terminal: 1, channel: 1, ratio: 10.0}
      current: {terminal: 1, channel: 2, ratio: 5.0}
    - drive: LF_KFE
      voltage: {terminal: 1, channel: 1, ratio: 10.0}
      current: {terminal: 2, channel: 1, ratio: 5.0, offset: 0.5}
"""
GONE = DriveSupply.STALE | DriveSupply.DEVICE_ERROR
LSB = 10.0 / 32767


@pytest.fixture(scope='module')
def possible():
    reason = network.why_not()
    if reason:
        pytest.skip(reason)


@pytest.fixture
def cable(possible):
    with network.cable() as ends:
        yield ends


@pytest.fixture
def mapping(tmp_path):
    path = tmp_path / 'ethercat.yaml'
    path.write_text(MAPPING)
    return path


class Bench:
    """An acquisition by SOEM at the near end, emulated slaves at the far end."""

    def __init__(self, cable, mapping, kinds=('EK1100', 'EL3102', 'EL3102')):
        near, far = cable
        self.peer = Peer(far, kinds)
        self.samples, self.said = [], KeptLog()
        loaded = SegmentMapping.load(mapping)
        self.acquisition = SegmentAcquisition(
            loaded,
            lambda: SoemSegment(near, loaded.frame_timeout),
            self.samples.append,
            self.said,
            None,
            SegmentPatience(0.05, 0.2, 5),
        )
        if len(kinds) == 3:
            self.peer.ask('set_volts', 1, 4.8, 0.4)
            self.peer.ask('set_volts', 2, 0.3, 0.0)

    def __enter__(self):
        self.acquisition.start()
        return self

    def __exit__(self, *_):
        self.acquisition.stop()
        try:
            self.acquisition.join(PATIENCE)
        finally:
            self.peer.close()

    def until(self, condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'waited in vain; it said {self.said}'
            if self.acquisition.failed:
                self.acquisition.join()
            time.sleep(0.01)

    def more(self, count=5):
        enough = len(self.samples) + count
        self.until(lambda: len(self.samples) >= enough)

    def said_once(self, words):
        return sum(words in line for line in self.said) == 1


@pytest.fixture
def bench(cable, mapping):
    with Bench(cable, mapping) as bench:
        yield bench


def test_soem_brings_the_terminals_to_operation_and_reads_what_lies_at_them(bench):
    bench.more()
    voltage, current, status = bench.samples[-1].values
    assert voltage == pytest.approx([48.0, 48.0], abs=10 * LSB)
    assert current == pytest.approx([2.0, 2.0], abs=5 * LSB)
    assert not status.any()
    assert bench.peer.ask('states') == [8, 8, 8]
    for place in (1, 2):
        for index in (0x8000, 0x8010):
            assert bench.peer.ask('object', place, index, 6) == b'\0', 'the filter is off'
    assert bench.said_once('operating EK1100, EL3102, EL3102')
    sequence = [sample.sequence for sample in bench.samples]
    assert sequence == sorted(set(sequence))
    bench.acquisition.stop()
    bench.acquisition.join(PATIENCE)
    assert bench.peer.ask('states') == [1, 1, 1], 'back in INIT at the end'


def test_each_conversion_comes_out_once(bench):
    bench.more(2)
    for step in range(5):
        bench.peer.ask('set_volts', 2, 0.3 + 0.1 * step, 0.0)
        bench.more(4)
    seen = {round(float(sample.values[1, 1]), 2) for sample in bench.samples}
    assert {2.0, 2.5, 3.0, 3.5, 4.0} <= seen
    assert bench.acquisition.counts.stale == 0


def test_voltages_beyond_the_range_are_clipped_and_flagged(bench):
    bench.more(2)
    bench.peer.ask('set_volts', 2, 11.0, 0.0)
    over = DriveSupply.OVERRANGE | DriveSupply.DEVICE_ERROR
    bench.until(lambda: bench.samples[-1].values[2, 1] == over)
    assert bench.samples[-1].values[1, 1] == pytest.approx(50.5)
    assert bench.samples[-1].values[2, 0] == 0, 'the other drive is sound'
    bench.peer.ask('set_volts', 2, -11.0, 0.0)
    under = DriveSupply.UNDERRANGE | DriveSupply.DEVICE_ERROR
    bench.until(lambda: bench.samples[-1].values[2, 1] == under)
    assert bench.samples[-1].values[1, 1] == pytest.approx(-49.5)


@pytest.mark.parametrize(
    ('fault', 'flags'), [('invalid', DriveSupply.DEVICE_ERROR), ('frozen', DriveSupply.STALE)]
)
def test_invalid_and_old_data_of_a_terminal_are_flagged_and_no_numbers(bench, fault, flags):
    bench.more(2)
    bench.peer.ask('set_fault', 2, fault, True)
    bench.until(lambda: bench.samples[-1].values[2, 1] == flags)
    assert np.isnan(bench.samples[-1].values[1, 1])
    assert bench.samples[-1].values[1, 0] == pytest.approx(2.0, abs=0.01)
    bench.peer.ask('set_fault', 2, fault, False)
    bench.until(lambda: not bench.samples[-1].values[2].any())


def test_a_terminal_that_drops_out_is_flagged_waited_for_and_set_up_again(bench):
    bench.more(2)
    bench.peer.ask('set_present', 2, False)
    bench.until(lambda: bench.acquisition.absence)
    last = bench.samples[-1].values
    assert last[2].tolist() == [0, GONE]
    assert np.isnan(last[1, 1])
    assert last[1, 0] == pytest.approx(2.0, abs=0.01), 'the one before it goes on'
    bench.until(lambda: any('segment ends after 2 of 3 slaves' in line for line in bench.said))
    assert any('working counter 1 instead of 2' in line for line in bench.said)
    before = len(bench.samples)
    bench.peer.ask('set_present', 2, True)
    bench.until(lambda: len(bench.samples) > before + 3)
    assert not bench.samples[-1].values[2].any()
    assert bench.peer.ask('object', 2, 0x8000, 6) == b'\0', 'the filter is off again'
    assert bench.acquisition.counts.times_operating >= 2
    assert bench.acquisition.lost > 0
    assert bench.samples[-1].sequence - bench.samples[before - 1].sequence > 1


def test_a_cable_that_is_pulled_and_put_back(bench):
    bench.more(2)
    bench.peer.ask('set_plugged', False)
    bench.until(lambda: any('no slave answers on ecat0' in line for line in bench.said))
    assert any('no frame came back for 5 cycles' in line for line in bench.said)
    bench.peer.ask('set_plugged', True)
    bench.more(3)
    assert not bench.samples[-1].values[2].any()
    assert bench.acquisition.counts.frames_lost >= 5


def test_another_terminal_than_the_mapping_names_is_told_with_both(cable, mapping):
    with Bench(cable, mapping, ('EK1100', 0x0BC23052, 'EL3102')) as bench:
        bench.until(lambda: bench.said)
        time.sleep(0.5)
    assert bench.said == [
        'EtherCAT: EL3102 (vendor 0x2, product 0x0c1e3052) should be at position 1, there is '
        'EL3010 (vendor 0x2, product 0x0bc23052); will try again'
    ]
    assert bench.samples == []


def test_a_filter_that_cannot_be_switched_off_keeps_the_segment_from_operating(cable, mapping):
    bench = Bench(cable, mapping)
    bench.peer.ask('set_fault', 1, 'filter_sticks', True)
    with bench:
        bench.until(lambda: any('cannot be switched off' in line for line in bench.said))
        assert bench.samples == []
        bench.peer.ask('set_fault', 1, 'filter_sticks', False)
        bench.more(1)


def test_an_interface_that_is_not_there_is_told_with_those_that_are(cable, mapping):
    near, _ = cable
    loaded = SegmentMapping.load(mapping)
    said = KeptLog()
    acquisition = SegmentAcquisition(
        loaded, lambda: SoemSegment('eth77', loaded.frame_timeout), print, said
    )
    acquisition.start()
    end = time.monotonic() + PATIENCE
    while not said:
        assert time.monotonic() < end
        time.sleep(0.01)
    acquisition.stop()
    acquisition.join(PATIENCE)
    assert "there is no network interface 'eth77'" in said[0]
    assert near in said[0]


def test_the_daq_node_publishes_what_the_terminals_measure(
    cable, mapping, ros_domain, node_process
):
    near, far = cable
    peer = Peer(far, ('EK1100', 'EL3102', 'EL3102'))
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    listener = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener)
    heard, reports = [], []
    qos = QoSProfile(depth=1000)
    listener.create_subscription(DriveSupply, 'drive_supply', heard.append, qos)
    listener.create_subscription(DiagnosticArray, 'diagnostics', reports.append, qos)

    def until(condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'waited in vain; the node said {node.output}'
            executor.spin_once(timeout_sec=0.05)

    try:
        peer.ask('set_volts', 1, 4.8, 0.4)
        peer.ask('set_volts', 2, 0.3, 0.0)
        given = (f'channel:={near}', f'mapping:={mapping}', 'interface:=ethercat')
        words = [word for parameter in given for word in ('-p', parameter)]
        node = node_process('power_daq', 'daq', '--ros-args', *words)
        until(lambda: len(heard) > 20)
        message = heard[-1]
        assert list(message.name) == ['LF_HFE', 'LF_KFE']
        assert message.header.frame_id == 'terminals'
        assert list(message.voltage) == pytest.approx([48.0, 48.0], abs=0.01)
        assert list(message.current) == pytest.approx([2.0, 2.0], abs=0.01)
        assert list(message.status) == [0, 0]
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        assert abs(stamp - time.time()) < 60.0
        until(lambda: reports)
        status = reports[-1].status[0]
        assert status.name == 'power_daq: segment'
        assert status.hardware_id == 'ethercat ecat0'
        peer.ask('set_present', 1, False)
        until(lambda: reports[-1].status[0].level == b'\2')
        assert 'segment absent' in reports[-1].status[0].message
        peer.ask('set_present', 1, True)
        known = len(heard)
        until(lambda: len(heard) > known + 5)
        node.interrupt()
        assert node.wait(PATIENCE) == 0, node.output
    finally:
        listener.destroy_node()
        rclpy.shutdown(context=context)
        peer.close()


def test_a_node_without_a_mapping_says_what_it_needs(node_process):
    node = node_process('power_daq', 'daq', '--ros-args', '-p', 'interface:=ethercat')
    assert node.wait(PATIENCE) == 2
    assert 'interface ethercat needs a mapping' in node.output


def datagram(command, address, offset, data, more=False):
    length = len(data) | (0x8000 if more else 0)
    return struct.pack('<BBHHHH', command, 7, address, offset, length, 0) + data + b'\0\0'


def frame(*datagrams):
    body = b''.join(datagrams)
    ethernet = b'\xff' * 6 + b'\x01' * 6 + b'\x88\xa4'
    return ethernet + struct.pack('<H', len(body) | 0x1000) + body


def counters(answer, *lengths):
    found, at = [], 16
    for length in lengths:
        at += 10 + length
        found.append(int.from_bytes(answer[at : at + 2], 'little'))
        at += 2
    return found


def test_working_counters_count_the_slaves_that_took_part():
    slaves = [EK1100(), EL3102(lambda: (0.0, 0.0))]
    station = struct.pack('<H', 1001)
    answer = process(
        frame(
            datagram(DatagramCommand.BRD, 0, 0x0000, b'\0\0', more=True),
            datagram(DatagramCommand.APWR, 0xFFFF, 0x0010, station, more=True),
            datagram(DatagramCommand.FPRD, 1001, 0x0010, b'\0\0', more=True),
            datagram(DatagramCommand.FPRD, 1002, 0x0010, b'\0\0', more=True),
            datagram(DatagramCommand.LRD, 0, 0, bytes(8)),
        ),
        slaves,
    )
    assert counters(answer, 2, 2, 2, 2, 8) == [2, 1, 1, 0, 0]
    assert answer[18:20] == b'\x02\x00', 'each slave adds one to the address of a broadcast'
    slaves[1].present = False
    assert counters(process(frame(datagram(DatagramCommand.BRD, 0, 0, b'\0')), slaves), 1) == [1]


@settings(deadline=None)
@given(st.binary(max_size=120))
def test_no_frame_brings_the_emulated_slaves_down(body):
    slaves = [EK1100(), EL3102(lambda: (1.0, 2.0))]
    process(b'\xff' * 12 + b'\x88\xa4' + body, slaves)


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(list(DatagramCommand)),
            st.sampled_from([0, 0xFFFF, 1001]),
            st.integers(0, 0xFFFF),
            st.binary(min_size=1, max_size=16),
        ),
        min_size=1,
        max_size=6,
    )
)
def test_every_well_formed_frame_comes_back_as_long_as_it_was(commands):
    slaves = [EK1100(), EL3102(lambda: (1.0, 2.0))]
    last = len(commands) - 1
    sent = frame(*(datagram(*entry, more=number < last) for number, entry in enumerate(commands)))
    answer = process(sent, slaves)
    assert len(answer) == len(sent)


def test_what_is_no_ethercat_frame_is_left_alone():
    assert process(b'\xff' * 12 + b'\x08\x00' + bytes(40), [EK1100()]) is None


def test_the_segment_can_be_tried_by_a_command(cable, mapping, node_process):
    near, far = cable
    volts = ['--volts', '4.8', '0.4', '0.3', '0.0']
    segment = node_process('sim_bridge', 'ethercat_segment', '--interface', far, *volts)
    segment.wait_for_output('EK1100 and 2 EL3102 on ecat1', timeout=PATIENCE)
    daq = node_process(
        *('power_daq', 'daq', '--ros-args', '-p', 'interface:=ethercat'),
        *('-p', f'channel:={near}', '-p', f'mapping:={mapping}'),
    )
    daq.wait_for_output('operating EK1100, EL3102, EL3102', timeout=PATIENCE)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--interface', 'eth77'], 'cannot use eth77: '),
        (['--interface', 'lo', '--volts', '1'], '--volts has 1 numbers; give two'),
    ],
)
def test_a_segment_that_cannot_be_is_told_in_a_line(node_process, arguments, words):
    segment = node_process('sim_bridge', 'ethercat_segment', *arguments)
    assert segment.wait(PATIENCE) == 2
    assert words in segment.output
    assert len(segment.own_lines) == 1
