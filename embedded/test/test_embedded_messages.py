"""Message classes and their bytes."""

import subprocess
import sys
from array import array
from copy import deepcopy
from hashlib import md5

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose, Quaternion
from rcl_interfaces.msg import Parameter, ParameterValue
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import BatteryState, Imu, JointState
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, Trigger

from drive_power_msgs.msg import DriveSupply, PowerEstimate

rosidl_embedded = pytest.importorskip('rosidl_embedded', reason='ROS 2 has its own messages')
from rosidl_embedded import definitions  # noqa: E402


def test_defaults_are_zeros_empty_arrays_and_the_defaults_of_the_definition():
    message = JointState()
    assert message.header.stamp.sec == 0
    assert message.name == []
    assert message.position == array('d')
    assert BatteryState().present is False
    assert Quaternion().w == 1.0
    assert Pose().orientation.w == 1.0
    assert Imu().orientation_covariance.tolist() == [0.0] * 9


@pytest.mark.parametrize(
    'given', [[1.0, 2.5], (1.0, 2.5), array('d', [1.0, 2.5]), np.array([1, 2.5], np.float32)]
)
def test_numeric_sequences_take_any_sequence_and_hold_an_array(given):
    message = JointState(position=given)
    message.velocity = given
    assert message.position == message.velocity == array('d', [1.0, 2.5])
    assert isinstance(message.position, array)
    assert message.position.typecode == 'd'
    message.position.append(7.0)
    assert deserialize_message(serialize_message(message), JointState).position[2] == 7.0


def test_assigned_numbers_are_copied():
    given = array('d', [1.0])
    message = JointState(position=given)
    given[0] = 9.0
    assert message.position[0] == 1.0


def test_unsigned_64_bit_times_survive():
    largest = 2**64 - 1
    message = DriveSupply(device_time=[0, largest], sequence=largest)
    back = deserialize_message(serialize_message(message), DriveSupply)
    assert back.device_time.tolist() == [0, largest]
    assert back.sequence == largest


def test_an_unknown_field_is_refused():
    with pytest.raises(TypeError, match='torque'):
        JointState(torque=[1.0])
    with pytest.raises(AttributeError):
        JointState().torque = [1.0]


def test_constants_belong_to_class_and_instance():
    assert (DriveSupply.OK, DriveSupply.STALE, DriveSupply().OVERRANGE) == (0, 8, 2)
    assert PowerEstimate.OUTSIDE_TRAINING_DATA == 3
    assert DiagnosticStatus.WARN == b'\x01'
    assert BatteryState.POWER_SUPPLY_STATUS_DISCHARGING == 2


def test_bytes_of_a_time_are_those_of_the_standard():
    assert (
        serialize_message(Time(sec=1, nanosec=258)).hex() == '00010000' + '01000000' + '02010000'
    )


def test_bytes_of_a_header_align_length_and_end_the_string():
    message = Header(stamp=Time(sec=-1, nanosec=2), frame_id='ab')
    expected = '00010000' + 'ffffffff' + '02000000' + '03000000' + '616200'
    assert serialize_message(message).hex() == expected


def test_big_endian_messages_are_read():
    assert deserialize_message(bytes.fromhex('00000000' + '00000001' + '00000102'), Time) == Time(
        sec=1, nanosec=258
    )


def test_an_empty_request_is_one_byte_as_on_the_wire_of_ros():
    assert serialize_message(Trigger.Request()) == b'\0\1\0\0\0'
    assert deserialize_message(b'\0\1\0\0\0', Trigger.Request) == Trigger.Request()


@pytest.mark.parametrize(
    'message',
    [
        JointState(name=['LF_HAA', ''], position=[1.5, -2.0], effort=[0.25]),
        Imu(orientation_covariance=np.arange(9.0)),
        DiagnosticArray(
            status=[
                DiagnosticStatus(level=b'\x02', name='n', values=[KeyValue(key='k', value='v')]),
                DiagnosticStatus(level=b'\xff'),
            ]
        ),
        ParameterValue(
            type=9,
            bool_value=True,
            byte_array_value=[b'\0', b'\xff'],
            bool_array_value=[True, False],
            integer_array_value=[-(2**63)],
            string_array_value=['ä', ''],
        ),
        SetBool.Response(success=True, message='on'),
        PowerEstimate(model='ppn', name=['a'], power=[1.5], total=1.5, status=1),
        String(data='Ω' * 1000),
    ],
    ids=lambda message: type(message).__name__,
)
def test_messages_survive_their_bytes(message):
    back = deserialize_message(serialize_message(message), type(message))
    assert back == message
    assert type(back) is type(message)
    assert deepcopy(back) == message


def test_bytes_agree_with_the_independent_serialiser_of_rosbags():
    store = get_typestore(Stores.ROS2_JAZZY)
    message = JointState(name=['a', 'bcd'], position=[1.0], velocity=[2.0, 3.0])
    message.header.frame_id = 'base'
    theirs = store.deserialize_cdr(serialize_message(message), 'sensor_msgs/msg/JointState')
    assert theirs.header.frame_id == 'base'
    assert theirs.name == ['a', 'bcd']
    assert theirs.velocity.tolist() == [2.0, 3.0]
    again = bytes(store.serialize_cdr(theirs, 'sensor_msgs/msg/JointState'))
    assert deserialize_message(again, JointState) == message


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        (
            'sensor_msgs/msg/JointState',
            'RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e',
        ),
        (
            'drive_power_msgs/msg/DriveSupply',
            'RIHS01_cc6bc97aa488b27e41ef60554ef2bee0002f341a95157ae2302402b8c06038a4',
        ),
        (
            'drive_power_msgs/msg/PowerEstimate',
            'RIHS01_ede62e16c6fb87212acdf1382460aed24a82fe1fb7375b80b0a63d4259576526',
        ),
    ],
)
def test_type_hashes_are_those_that_rosidl_computes_in_jazzy(name, expected):
    assert definitions.type_hash(name) == expected


@pytest.mark.parametrize(
    ('message', 'digest'),
    [
        (
            JointState(name=['a', 'bcd'], position=[1.0, 2.0, 3.0], effort=[0.5]),
            '181e388090b5c2f94b13e2c83d81b80c',
        ),
        (
            DriveSupply(
                sequence=2**40,
                device_time=[1, 2],
                name=['a'],
                voltage=[1.0, 2.0],
                current=[3.0, 4.0],
                temperature=[5.0],
                status=[0, 8],
            ),
            'b9ac5d77550fb3102fdf4e2f8a1d1366',
        ),
        (
            Imu(linear_acceleration_covariance=[float(i) for i in range(9)]),
            '4bed2959111c424905a24d6333b45f44',
        ),
        (
            DiagnosticArray(
                status=[
                    DiagnosticStatus(
                        level=b'\2',
                        name='x',
                        message='yy',
                        values=[KeyValue(key='a', value='bcde'), KeyValue()],
                    ),
                    DiagnosticStatus(),
                ]
            ),
            '0a7eddcf5fb884e029b02f63a5c3d4d3',
        ),
        (
            Parameter(
                name='p',
                value=ParameterValue(
                    type=9,
                    bool_value=True,
                    string_value='q',
                    byte_array_value=[b'a', b'\xff'],
                    bool_array_value=[True, False, True],
                    integer_array_value=[1, -2],
                    double_array_value=[1.0],
                    string_array_value=['x', '', 'yz'],
                ),
            ),
            '362b9dda3b676b9bf0cb5d64611ea7d7',
        ),
        (SetBool.Response(success=True, message='abc'), 'c322cb5afe03ea7e1899a7bb9bdf2b4c'),
    ],
    ids=lambda value: type(value).__name__,
)
def test_bytes_are_those_that_rclpy_7_1_3_makes(message, digest):
    assert md5(serialize_message(message)).hexdigest() == digest


def test_fields_and_their_types_are_told():
    types = DriveSupply.get_fields_and_field_types()
    assert types['header'] == 'std_msgs/Header'
    assert types['voltage'] == 'sequence<float>'
    assert types['name'] == 'sequence<string>'
    assert Imu.get_fields_and_field_types()['angular_velocity_covariance'] == 'double[9]'


def test_repr_names_type_and_fields():
    shown = repr(JointState(position=[1.5]))
    assert shown.startswith('sensor_msgs.msg.JointState(header=std_msgs.msg.Header(')
    assert 'position=[1.5]' in shown


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (Time(sec=2**31), 'sec'),
        (Time(nanosec=1.5), 'nanosec'),
        (String(data=5), 'data'),
        (Imu(orientation_covariance=[1.0]), 'array length'),
    ],
)
def test_what_a_field_cannot_hold_is_refused_when_serialised(message, reason):
    with pytest.raises(TypeError, match=reason):
        serialize_message(message)


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0\1\0\0\5\0\0\0abc', b'\7\7\0\0\0\0\0\0'])
def test_bytes_that_are_no_message_are_refused(data):
    with pytest.raises(ValueError, match='std_msgs/msg/String'):
        deserialize_message(data, String)


def test_a_message_that_does_not_exist_is_an_import_error():
    with pytest.raises(ImportError):
        exec('from sensor_msgs.msg import NoSuchThing')


@pytest.mark.parametrize(
    'statement',
    [
        'JointState().position = 5',
        'JointState(position=["a"])',
        'JointState().name = [1]',
        'JointState().header = 3',
        'BatteryState().voltage = 1',
        'BatteryState().power_supply_status = 256',
        'BatteryState().present = 1',
        'DiagnosticStatus().level = 2',
        'Imu().orientation_covariance = [0.0] * 8',
    ],
)
def test_field_checks_can_be_turned_on(statement):
    code = (
        'from sensor_msgs.msg import BatteryState, Imu, JointState\n'
        'from diagnostic_msgs.msg import DiagnosticStatus\n'
        'assert JointState(position=[1.0], name=["a"]).position[0] == 1.0\n'
        f'try:\n    {statement}\nexcept AssertionError as error:\n    print("refused", error)\n'
    )
    environment = {'ROS_PYTHON_CHECK_FIELDS': '1', 'PATH': ''}
    done = subprocess.run(
        [sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith('refused The ')
