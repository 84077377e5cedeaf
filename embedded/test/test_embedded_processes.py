"""Nodes as separate processes: they find each other, lose nothing and end in good order."""

import signal
from importlib.util import find_spec
from pathlib import Path

import pytest

IS_EMBEDDED = find_spec('rosidl_embedded') is not None
NODES = Path(__file__).parent / 'nodes'
COUNTER, GADGET = NODES / 'counter.py', NODES / 'gadget.py'


@pytest.mark.parametrize('first', ['source', 'sink'])
def test_nodes_find_each_other_in_any_start_order(node_process, first):
    roles = ['source', 'sink'] if first == 'source' else ['sink', 'source']
    started = {role: node_process.python(COUNTER, role, '--count', '5') for role in roles}
    started['sink'].wait_for_output(r'received 5 gaps 0 first 0')


def test_a_burst_at_1_khz_loses_nothing(node_process):
    common = ('--count', '2500', '--depth', '1000')
    sink = node_process.python(COUNTER, 'sink', *common)
    sink.wait_for_output('listening')
    source = node_process.python(COUNTER, 'source', *common, '--period', '0.001')
    source.wait_for_output('sent 2500')
    sink.wait_for_output('received 2500 gaps 0 first 0')


def test_a_late_joiner_gets_what_a_transient_local_publisher_kept(node_process):
    common = ('--count', '7', '--depth', '3', '--transient-local')
    source = node_process.python(COUNTER, 'source', *common, '--at-once')
    source.wait_for_output('sent 7')
    sink = node_process.python(COUNTER, 'sink', *common)
    sink.wait_for_output('received 3 gaps 0 first 4')


@pytest.mark.parametrize(
    ('source', 'sink', 'policy'),
    [
        (['--best-effort'], [], 'RELIABILITY'),
        ([], ['--transient-local'], 'DURABILITY'),
    ],
)
def test_qos_that_does_not_fit_is_warned_of_on_both_sides(node_process, source, sink, policy):
    publisher = node_process.python(COUNTER, 'source', *source)
    subscriber = node_process.python(COUNTER, 'sink', *sink)
    publisher.wait_for_output(
        r"WARN.*New subscription discovered on topic 'numbers', requesting incompatible QoS\. "
        rf'No messages will be sent to it\. Last incompatible policy: {policy}'
    )
    subscriber.wait_for_output(
        r"WARN.*New publisher discovered on topic 'numbers', offering incompatible QoS\. "
        rf'No messages will be received from it\. Last incompatible policy: {policy}'
    )


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_spin_and_runs_the_finally_block(node_process, number):
    gadget = node_process.python(GADGET)
    gadget.wait_for_output('ready')
    gadget.send_signal(number)
    assert gadget.wait() == 0, gadget.output
    assert gadget.lines[-1] == 'cleaned up'
    assert number != signal.SIGINT or gadget.lines[-2] == 'ended by KeyboardInterrupt'


MOMENTS = {
    'before spin': 'end.run()',
    'while waiting': 'end.start()',
    'while waiting, with a timer': 'node.create_timer(0.05, lambda: None); end.start()',
}


@pytest.mark.parametrize('moment', MOMENTS)
def test_sigterm_raises_external_shutdown(node_process, tmp_path, moment):
    if not IS_EMBEDDED and moment == 'before spin':
        pytest.skip('rclpy raises RCLError, which no node expects')
    if not IS_EMBEDDED and moment == 'while waiting':
        # The signal's wake-up is spent before the context is shut down, and no other comes.
        pytest.skip('rclpy wakes its executor too early, so that an idle node hangs now and then')
    # rclpy may notice the signal between two waits, where its context is gone already.
    early = '' if IS_EMBEDDED else 'except rclpy._rclpy_pybind11.RCLError:\n    print("ended")\n'
    script = tmp_path / 'idle.py'
    script.write_text(
        'import os, signal, threading, rclpy\n'
        'from rclpy.executors import ExternalShutdownException\n'
        'rclpy.init()\nnode = rclpy.create_node("idle")\n'
        'end = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGTERM))\n'
        f'{MOMENTS[moment]}\n'
        'try:\n    rclpy.spin(node)\nexcept ExternalShutdownException:\n    print("ended")\n'
        f'{early}'
    )
    process = node_process.python(script)
    process.wait_for_output('ended')
    assert process.wait() == 0


def test_remappings_and_parameters_on_the_command_line_reach_the_node(node_process):
    rules = ('__node:=tool', '__ns:=/lab', 'state:=mode', '~/enable:=/switch')
    remaps = [part for rule in rules for part in ('-r', rule)]
    gadget = node_process.python(GADGET, '--ros-args', *remaps, '-p', 'device:=daq7')
    gadget.wait_for_output('ready /lab/tool daq7')
    echo = node_process.ros2('topic', 'echo', '--once', '/lab/mode', 'std_msgs/msg/String')
    echo.wait_for_output('data: idle')
    assert echo.wait() == 0
    answer = node_process.ros2(
        'service', 'call', '/switch', 'std_srvs/srv/SetBool', '{data: true}'
    )
    answer.wait_for_output(r"success=True, message='on'")
    assert answer.wait() == 0


def test_a_parameter_file_applies_by_node_or_wildcard_and_the_last_wins(node_process, tmp_path):
    first, second = tmp_path / 'first.yaml', tmp_path / 'second.yaml'
    first.write_text(
        '/**:\n  ros__parameters: {device: everywhere, gain: 2.5, filter: {window: 8}}\n'
        '/other:\n  ros__parameters: {device: wrong}\n'
    )
    second.write_text('gadget:\n  ros__parameters:\n    device: file\n')
    gadget = node_process.python(
        GADGET, '--ros-args', '--params-file', first, '--params-file', second
    )
    gadget.wait_for_output('ready /gadget file')
    for name, value in (('gain', '2.5'), ('filter.window', '8')):
        answer = node_process.ros2('param', 'get', '/gadget', name)
        answer.wait_for_output(f'value is: {value}')
        assert answer.wait() == 0


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--frobnicate'], r"UnknownROSArgsError: \['--frobnicate'\]"),
        (['-p', 'gain'], 'gain'),
        (['--params-file', '/nowhere.yaml'], '/nowhere.yaml'),
        (['-p', 'gain:=loud'], "'gain' to 'loud' of type 'STRING', expecting type 'DOUBLE'"),
        (['-p', 'gain:=11.0'], r'Parameter gain out of range'),
        (['-r', '__node:=7up'], '7up'),
    ],
)
def test_ros_arguments_that_cannot_be_meant_end_the_node_with_their_text(
    node_process, arguments, message
):
    gadget = node_process.python(GADGET, '--ros-args', *arguments)
    gadget.wait_for_output(message)
    assert gadget.wait() == 1


def test_log_level_debug_shows_what_is_hidden_otherwise(node_process, tmp_path):
    script = tmp_path / 'logs.py'
    script.write_text(
        'import rclpy\nrclpy.init()\nlogger = rclpy.create_node("speaker").get_logger()\n'
        'logger.debug("fine print")\nlogger.info("plain")\nrclpy.shutdown()\n'
    )
    quiet = node_process.python(script)
    quiet.wait_for_output(r'\[INFO\] \[\d+\.\d{9}\] \[speaker\]: plain')
    assert 'fine print' not in quiet.output
    loud = node_process.python(script, '--ros-args', '--log-level', 'debug')
    loud.wait_for_output(r'\[DEBUG\] \[\d+\.\d{9}\] \[speaker\]: fine print')
    assert quiet.wait() == loud.wait() == 0
