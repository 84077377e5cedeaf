import os
import signal
import socket
import subprocess
import sys
import time
from collections import deque

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st
from power_daq.bus.unix_socket import pack, unpack


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / 'bus')


@pytest.fixture
def host(path):
    with can.Bus(interface='unixsocket', channel=path, host=True) as bus:
        yield bus


def connect(path, **kwargs):
    return can.Bus(interface='unixsocket', channel=path, **kwargs)


def frame(identifier=1, data=b'\x01\x02', **kwargs):
    return can.Message(
        arbitration_id=identifier, data=data, is_extended_id=False, is_fd=True, **kwargs
    )


def until(condition, deadline=20.0):
    end = time.monotonic() + deadline
    while not condition():
        assert time.monotonic() < end, 'never happened'
        time.sleep(0.002)


def serve_until_connected(host, clients):
    def served():
        host.recv(0.01)
        return host.statistics.connected == clients

    until(served)


@given(
    frames=st.lists(
        st.tuples(
            st.integers(0, 0x7FF), st.sampled_from([0, 1, 8, 12, 64]), st.booleans(), st.booleans()
        ),
        max_size=5,
    )
)
def test_what_is_packed_unpacks_to_the_same_frames(frames):
    messages = [
        can.Message(
            arbitration_id=identifier,
            is_extended_id=extended,
            data=bytes(range(length)),
            is_fd=True,
            bitrate_switch=switch,
            error_state_indicator=not switch,
        )
        for identifier, length, extended, switch in frames
    ]
    messages.append(can.Message(is_error_frame=True, dlc=8, data=bytes(8)))
    messages.append(can.Message(is_remote_frame=True, dlc=4, arbitration_id=7))
    again = unpack(pack(messages), '')
    assert len(again) == len(messages)
    for sent, received in zip(messages, again, strict=True):
        assert sent.equals(
            received, check_channel=False, check_direction=False, timestamp_delta=None
        )


def test_python_can_finds_the_interface_by_its_name():
    assert 'unixsocket' in can.VALID_INTERFACES


def test_every_frame_reaches_all_others_and_not_its_sender(host, path):
    with connect(path) as one, connect(path) as two:
        serve_until_connected(host, 2)
        host.send_all([frame(1), frame(2)])
        for bus in (one, two):
            assert [bus.recv(10).arbitration_id for _ in range(2)] == [1, 2]
        one.send(frame(3, b'abc'))
        assert bytes(host.recv(10).data) == b'abc'
        assert two.recv(10).arbitration_id == 3
        assert one.recv(0) is None


def test_frames_carry_the_time_at_which_they_were_sent(host, path):
    with connect(path) as bus:
        serve_until_connected(host, 1)
        before = time.time()
        host.send(frame())
        after = time.time()
        time.sleep(0.05)
        assert before - 1e-6 <= bus.recv(10).timestamp <= after + 1e-6


def test_filters_keep_other_identifiers_away(host, path):
    with connect(path, can_filters=[{'can_id': 5, 'can_mask': 0x7FF}]) as bus:
        serve_until_connected(host, 1)
        host.send_all([frame(4), frame(5), frame(6)])
        assert bus.recv(10).arbitration_id == 5
        assert bus.recv(0.01) is None


def test_a_bus_without_host_is_refused_with_its_path(path):
    with pytest.raises(can.CanInitializationError, match='no unixsocket bus at') as error:
        connect(path)
    assert path in str(error.value)
    with pytest.raises(can.CanInitializationError, match='too long'):
        connect('/tmp/' + 'x' * 200)
    with pytest.raises(can.CanInitializationError, match='cannot host'):
        connect('/no/such/folder/bus', host=True)
    with pytest.raises(ValueError, match='path'):
        connect(3)


def test_clients_are_told_that_the_host_has_gone(path):
    host = connect(path, host=True)
    with connect(path) as bus:
        serve_until_connected(host, 1)
        host.shutdown()
        host.shutdown()
        with pytest.raises(can.CanOperationError, match='gone'):
            bus.recv(10)
        with pytest.raises(can.CanOperationError, match='gone'):
            bus.send(frame())
    assert not os.path.exists(path)


def test_a_client_that_does_not_read_loses_frames_but_holds_nobody_up(host, path):
    with connect(path) as slow, connect(path) as keen:
        serve_until_connected(host, 2)
        sent = 0
        while not sum(host.statistics.dropped):
            host.send_all([frame(n % 2048, bytes(64)) for n in range(64)])
            sent += 64
            for _ in range(64):
                assert keen.recv(10) is not None
        dropped = host.statistics.dropped
        assert sorted(dropped) == [0, 64]
        received = 0
        while slow.recv(0) is not None:
            received += 1
        assert received == sent - 64


def test_a_client_that_has_gone_is_forgotten(host, path):
    bus = connect(path)
    serve_until_connected(host, 1)
    bus.shutdown()
    host.send(frame())
    assert host.statistics.connected == 0
    assert host.statistics.disconnected == 1


def test_a_foreign_program_on_the_socket_is_thrown_off(host, path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as foreign, connect(path) as bus:
        foreign.connect(path)
        serve_until_connected(host, 2)
        foreign.send(b'GET / HTTP/1.1')
        serve_until_connected(host, 1)
        host.send(frame(9))
        assert bus.recv(10).arbitration_id == 9


def test_one_path_has_one_host(host, path):
    with pytest.raises(can.CanInitializationError, match='another host'):
        connect(path, host=True)
    with connect(path) as bus:
        serve_until_connected(host, 1)
        host.send(frame(1))
        assert bus.recv(10).arbitration_id == 1


def test_a_file_in_the_way_is_not_deleted(tmp_path):
    precious = tmp_path / 'notes'
    precious.write_text('keep')
    with pytest.raises(can.CanInitializationError, match='no socket'):
        connect(str(precious), host=True)
    assert precious.read_text() == 'keep'


HOST = """
import can, sys, time
bus = can.Bus(interface='unixsocket', channel=sys.argv[1], host=True)
print('ready', flush=True)
n = 0
while True:
    bus.send(can.Message(arbitration_id=n % 2048, is_extended_id=False, data=b'x'))
    n += 1
    time.sleep(0.001)
"""


def test_a_host_in_another_process_that_is_killed_can_be_replaced(path):
    with subprocess.Popen([sys.executable, '-c', HOST, path], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b'ready\n'
        with connect(path) as bus:
            first, second = bus.recv(20), bus.recv(20)
            assert second.arbitration_id == first.arbitration_id + 1
            process.send_signal(signal.SIGKILL)
            with pytest.raises(can.CanOperationError, match='gone'):
                deque(bus, maxlen=0)
    assert os.path.exists(path)
    with pytest.raises(can.CanInitializationError, match='no unixsocket bus'):
        connect(path)
    with connect(path, host=True) as host, connect(path) as bus:
        serve_until_connected(host, 1)
        host.send(frame(8))
        assert bus.recv(10).arbitration_id == 8
