"""The verbs of `ros2`, on a node in another process."""

import os
import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import rclpy
import yaml

GADGET = Path(__file__).parent / 'nodes' / 'gadget.py'


IS_EMBEDDED = find_spec('rosidl_embedded') is not None


@pytest.fixture
def gadget(node_process):
    process = node_process.python(GADGET)
    process.wait_for_output('ready')
    return process


@pytest.fixture
def ros2(node_process):
    def run(*arguments, code=0):
        process = node_process.ros2(*arguments)
        assert process.wait() == code, process.output
        return process.output

    return run


def test_lists_show_nodes_topics_and_services(gadget, ros2):
    assert '/gadget' in ros2('node', 'list', '--no-daemon').splitlines()
    assert '/state [std_msgs/msg/String]' in ros2('topic', 'list', '-t', '--no-daemon')
    assert '/gadget/enable [std_srvs/srv/SetBool]' in ros2('service', 'list', '-t')
    shown = ros2('node', 'info', '/gadget', '--no-daemon')
    assert '/state: std_msgs/msg/String' in shown
    assert '/gadget/enable: std_srvs/srv/SetBool' in shown


def test_a_node_that_ended_is_no_longer_listed(gadget, ros2):
    assert '/gadget' in ros2('node', 'list', '--no-daemon').splitlines()
    gadget.interrupt()
    gadget.wait()
    assert '/gadget' not in ros2('node', 'list', '--no-daemon').splitlines()


def test_echo_prints_yaml_and_hz_a_rate(gadget, node_process, ros2):
    first, _ = ros2('topic', 'echo', '--once', '/state', 'std_msgs/msg/String').split('---')
    assert yaml.safe_load(first) == {'data': 'idle'}
    assert 'idle' in ros2(
        'topic', 'echo', '--once', '--field', 'data', '/state', 'std_msgs/msg/String'
    )
    rate = node_process.ros2('topic', 'hz', '/state')
    rate.wait_for_output(r'average rate: \d+\.\d+')
    rate.interrupt()
    rate.wait()


def test_topic_info_tells_the_qos_of_publishers(gadget, ros2):
    shown = ros2('topic', 'info', '-v', '/state', '--no-daemon')
    assert 'Publisher count: 1' in shown
    assert 'Node name: gadget' in shown
    assert 'Reliability: RELIABLE' in shown


def test_parameters_are_read_set_and_described(gadget, ros2):
    listed = {line.strip() for line in ros2('param', 'list', '/gadget').splitlines()}
    assert {'gain', 'count', 'device', 'filter.window', 'names', 'use_sim_time'} <= listed
    assert 'Double value is: 1.5' in ros2('param', 'get', '/gadget', 'gain')
    assert 'successful' in ros2('param', 'set', '/gadget', 'gain', '2.25')
    gadget.wait_for_output('applied gain=2.25')
    dumped = yaml.safe_load(ros2('param', 'dump', '/gadget'))['/gadget']['ros__parameters']
    assert dumped['gain'] == 2.25
    assert dumped['filter']['window'] == 4
    assert dumped['names'] == ['LF', 'RF']
    described = ros2('param', 'describe', '/gadget', 'gain')
    assert 'V/A' in described
    assert 'Max value: 10.0' in described


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('gain', '99.0', 'out of range'),
        ('gain', 'high', 'Wrong parameter type'),
        ('count', '12', 'not a valid step'),
        ('device', 'daq1', 'read-only'),
        ('filter.window', '3', 'the window must be even'),
    ],
)
def test_a_value_that_is_refused_is_told_with_the_reason(
    gadget, node_process, name, value, reason
):
    process = node_process.ros2('param', 'set', '/gadget', name, value)
    process.wait_for_output(f'Setting parameter failed:.*{reason}')
    process.wait()


def test_services_are_called_with_yaml(gadget, ros2):
    call = ('service', 'call', '/gadget/enable', 'std_srvs/srv/SetBool')
    assert "SetBool_Response(success=True, message='on')" in ros2(*call, '{data: true}')
    assert "SetBool_Response(success=False, message='off')" in ros2(*call)


@pytest.mark.skipif(not IS_EMBEDDED, reason='words of the embedded ros2')
@pytest.mark.parametrize(
    ('name', 'values', 'told'),
    [
        ('tf2_msgs/msg/TFMessage', {'transforms': 3}, 'transforms .* sequence<.*Stamped>, got 3'),
        ('tf2_msgs/msg/TFMessage', {'transforms': [3]}, r'transforms\[0\] .* of header.*, got 3'),
        ('sensor_msgs/msg/JointState', {'position': 'x'}, "position .* sequence<double>, got 'x'"),
        (
            'sensor_msgs/msg/JointState',
            {'position': [1, 'x']},
            r"position\[1\] .* double, got 'x'",
        ),
        ('sensor_msgs/msg/JointState', {'name': 3}, 'name .* sequence<string>, got 3'),
        (
            'sensor_msgs/msg/JointState',
            {'header': {'stamp': {'sec': 1.5}}},
            'header.stamp.sec .*1.5',
        ),
        ('sensor_msgs/msg/Imu', {'angular_velocity_covariance': [1]}, r'double\[9\], got \[1\]'),
        ('std_msgs/msg/String', {'data': 3}, 'data must be of type string, got 3'),
        ('std_msgs/msg/Float32', {'data': 1e300}, r'type float, got 1e\+300'),
        ('std_msgs/msg/Char', {'data': 'x'}, "type char, got 'x'"),
        ('std_srvs/srv/SetBool_Request', {'data': 'on'}, "type boolean, got 'on'"),
    ],
)
def test_a_value_that_a_field_cannot_hold_is_refused_in_a_line(name, values, told):
    from ros2cli.main import CommandError
    from ros2cli.verbs import fill
    from rosidl_embedded.message import class_of

    with pytest.raises(CommandError, match=told) as refused:
        fill(class_of(name)(), values)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.skipif(not IS_EMBEDDED, reason='words of the embedded ros2')
def test_values_of_yaml_fill_fields_of_all_kinds():
    from diagnostic_msgs.msg import DiagnosticArray
    from ros2cli.verbs import fill
    from sensor_msgs.msg import Image, JointState

    joints, image, found = JointState(), Image(), DiagnosticArray()
    fill(joints, {'name': ['a'], 'position': [1, 2.5], 'header': {'stamp': {'sec': 3}}})
    assert (joints.name, [*joints.position], joints.header.stamp.sec) == (['a'], [1.0, 2.5], 3)
    fill(image, {'data': b'ab'})
    assert [*image.data] == [97, 98]
    fill(found, {'status': [{'level': 2, 'values': [{'key': 'k'}]}]})
    assert found.status[0].level == b'\2'
    assert found.status[0].values[0].key == 'k'


def test_pub_reaches_a_subscription(node_process):
    echo = node_process.ros2('topic', 'echo', '/word', 'std_msgs/msg/String')
    pub = node_process.ros2('topic', 'pub', '--once', '/word', 'std_msgs/msg/String', '{data: hi}')
    assert pub.wait() == 0
    echo.wait_for_output('data: hi')
    echo.interrupt()
    echo.wait()


def test_run_passes_arguments_output_and_exit_code_on(node_process, tmp_path, monkeypatch):
    folder = tmp_path / 'lib' / 'toy'
    folder.mkdir(parents=True)
    script = folder / 'say'
    script.write_text(f'#!{sys.executable}\nimport sys\nprint(sys.argv[1:])\nsys.exit(7)\n')
    script.chmod(0o755)
    index = tmp_path / 'share' / 'ament_index' / 'resource_index' / 'packages'
    index.mkdir(parents=True)
    (index / 'toy').touch()
    others = os.environ.get('AMENT_PREFIX_PATH', '')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}{os.pathsep}{others}')
    process = node_process('toy', 'say', '--loud', 'a b')
    process.wait_for_output(r"\['--loud', 'a b'\]")
    assert process.wait() == 7


@pytest.mark.skipif(not IS_EMBEDDED, reason='ROS 2 knows no executable of that name')
@pytest.mark.parametrize('asked', ['--help', '-h'])
def test_run_help_of_a_package_has_a_line_on_each_executable(node_process, asked):
    process = node_process.ros2('run', 'power_lab', asked)
    assert process.wait() == 0
    assert 'usage: ros2 run power_lab EXECUTABLE' in process.output
    assert re.search(r'^ +fit +coefficients of named effects', process.output, re.M)
    assert re.search(r'^ +diagnose +\w', process.output, re.M)


@pytest.mark.skipif(not IS_EMBEDDED, reason='ROS 2 says it with other words and tracebacks')
@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['run', 'no_such_package', 'x'], "Package 'no_such_package' not found"),
        (['run', 'toy'], "which executable of 'toy'"),
        (['topic', 'echo', '/nobody'], "Could not determine the type.*'/nobody'"),
        (['topic', 'echo', '/a', 'std_msgs/msg/Nope'], "message type 'std_msgs/msg/Nope' is inva"),
        (['topic', 'info', '/nobody'], "Unknown topic '/nobody'"),
        (
            ['service', 'call', '/a', 'std_srvs/srv/Nope'],
            "service type 'std_srvs/srv/Nope' is inv",
        ),
        (
            ['service', 'call', '--timeout', '0.1', '/a', 'std_srvs/srv/Empty'],
            "'/a' is not available",
        ),
        (['service', 'call', '/a', 'std_srvs/srv/SetBool', '{dta: 1}'], "no field 'dta'"),
        (['service', 'call', '/a', 'std_srvs/srv/SetBool', '{dta'], 'as YAML'),
        (['service', 'call', '/a', 'std_srvs/srv/SetBool', '{data: 3}'], 'data .* boolean, got 3'),
        (['topic', 'pub', '/a', 'std_msgs/msg/String', '{data: 3}'], 'data .* string, got 3'),
        (['node', 'info', '/nobody'], "Unable to find node '/nobody'"),
    ],
)
def test_what_cannot_be_done_is_told_in_one_line_and_ends_with_1(
    ros_domain, capfd, arguments, message
):
    from ros2cli.main import main

    try:
        assert main(arguments) == 1
    finally:
        rclpy.uninstall_signal_handlers()
    said = capfd.readouterr().err
    assert re.fullmatch(rf'ros2 {arguments[0]}: .*{message}.*\n', said)
