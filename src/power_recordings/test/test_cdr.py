import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from power_recordings.messages import cdr
from power_recordings.messages.cdr_layout import Layout
from wattwalk_core.errors import InputError

NAME = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
NAMES = st.lists(NAME, min_size=1, max_size=5, unique=True)
STAMP = st.integers(0, 2**31 * 10**9 - 1)


def header(stamp: int, frame: str) -> dict[str, Any]:
    return {'stamp': {'sec': stamp // 10**9, 'nanosec': stamp % 10**9}, 'frame_id': frame}


@settings(derandomize=True, max_examples=60, deadline=None)
@given(
    names=NAMES,
    frame=NAME,
    stamps=st.lists(STAMP, min_size=1, max_size=4),
    seed=st.integers(0, 99),
    there=st.tuples(st.booleans(), st.booleans(), st.booleans()),
)
def test_a_block_of_joint_states_equals_single_messages_byte_for_byte(
    names: list[str], frame: str, stamps: list[int], seed: int, there: tuple[bool, bool, bool]
) -> None:
    values = np.random.default_rng(seed).normal(size=(3, len(stamps), len(names)))
    values[0, 0, 0] = np.nan
    given_fields = {
        field: array
        for field, array, is_there in zip(
            ('position', 'velocity', 'effort'), values, there, strict=True
        )
        if is_there
    }
    block = cdr.in_a_list(
        cdr.joint_state_block(np.array(stamps), names, **given_fields, frame_id=frame)
    )
    assert block == [
        cdr.serialize(
            cdr.JOINT_STATE,
            cdr.message(
                cdr.JOINT_STATE,
                header=header(stamp, frame),
                name=names,
                **{field: array[i] for field, array in given_fields.items()},
            ),
        )
        for i, stamp in enumerate(stamps)
    ]


@settings(derandomize=True, max_examples=60, deadline=None)
@given(
    names=NAMES,
    frame=NAME,
    first=st.integers(0, 2**40),
    samples=st.integers(1, 7),
    size=st.integers(1, 4),
    known=st.booleans(),
    data=st.data(),
)
def test_a_block_of_drive_supply_equals_single_messages_byte_for_byte(
    names: list[str], frame: str, first: int, samples: int, size: int, known: bool, data: Any
) -> None:
    numbers = hnp.arrays(np.float32, (samples, len(names)), elements=st.floats(width=32))
    voltage, current, celsius = data.draw(numbers), data.draw(numbers), data.draw(numbers)
    status = data.draw(hnp.arrays(np.uint8, (samples, len(names))))
    stamps = first + np.arange(samples) * 1_000_003
    ticks = np.arange(samples, dtype=np.uint64) * 1_000_000
    block = cdr.in_a_list(
        *cdr.drive_supply_blocks(
            stamps,
            40,
            ticks,
            names,
            voltage,
            current,
            celsius if known else None,
            status,
            size,
            frame,
        )
    )
    expected = []
    for start in range(0, samples, size):
        rows = slice(start, start + size)
        expected.append(
            cdr.serialize(
                cdr.DRIVE_SUPPLY,
                cdr.message(
                    cdr.DRIVE_SUPPLY,
                    header=header(int(stamps[start]), frame),
                    sequence=40 + start,
                    device_time=ticks[rows],
                    name=names,
                    voltage=voltage[rows].ravel(),
                    current=current[rows].ravel(),
                    temperature=celsius[start] if known else [],
                    status=status[rows].ravel(),
                ),
            )
        )
    assert block == expected


def test_blocks_of_the_other_topics_come_back_as_they_went_in() -> None:
    stamps = np.array([5, 3_000_000_007])
    unit, rate, push = np.eye(4)[:2], np.array([[1, 2, 3], [4, 5, 6.5]]), -np.ones((2, 3))
    battery = cdr.deserialize(
        cdr.BATTERY_STATE, cdr.in_a_list(cdr.battery_block(stamps, [48, 47.5], [-3, -9]))[1]
    )
    assert (battery.header.stamp.sec, battery.header.stamp.nanosec) == (3, 7)
    assert (battery.voltage, battery.current, battery.present) == (47.5, -9, True)
    assert np.isnan(battery.charge)
    imu = cdr.deserialize(cdr.IMU, cdr.in_a_list(cdr.imu_block(stamps, unit, rate, push))[1])
    assert (imu.orientation.y, imu.angular_velocity.z, imu.linear_acceleration.x) == (1, 6.5, -1)
    odom = cdr.deserialize(
        cdr.ODOMETRY, cdr.in_a_list(cdr.odometry_block(stamps, rate, unit, push, rate))[0]
    )
    assert (odom.pose.pose.position.y, odom.twist.twist.linear.z) == (2, -1)
    assert (odom.pose.pose.orientation.x, odom.twist.twist.angular.x) == (1, 1)
    twist = cdr.deserialize(cdr.TWIST_STAMPED, cdr.in_a_list(cdr.twist_block(stamps, rate))[1])
    assert (twist.twist.linear.x, twist.twist.linear.y, twist.twist.angular.z) == (4, 5, 6.5)


def test_columns_come_out_of_messages_of_one_layout_only() -> None:
    values = np.arange(12.0).reshape(4, 3)
    block = cdr.in_a_list(cdr.joint_state_block(np.arange(4), 'abc', values))
    other = cdr.in_a_list(cdr.joint_state_block(np.arange(4), 'abd', values))
    layout = Layout(cdr.typestore().fielddefs, cdr.JOINT_STATE, block[0])
    rows = np.frombuffer(b''.join([*block, other[0]]), np.uint8).reshape(5, -1)
    assert layout.matches(rows).tolist() == [True] * 4 + [False]
    assert layout.strings['name'] == ('a', 'b', 'c')
    assert (layout.decode(rows[:4], 'position') == values).all()
    assert layout.decode(rows[:4], 'header.stamp.nanosec').tolist() == [0, 1, 2, 3]
    assert layout.decode(rows[:4], 'effort').shape == (4, 0)


def test_big_endian_messages_are_understood() -> None:
    store = cdr.typestore()
    message = cdr.message(cdr.JOINT_STATE, name=['a'], position=[0.5])
    raw = bytes(store.serialize_cdr(message, cdr.JOINT_STATE, little_endian=False))
    layout = Layout(store.fielddefs, cdr.JOINT_STATE, raw)
    assert layout.decode(np.frombuffer(raw, np.uint8)[None], 'position').tolist() == [[0.5]]


def test_every_cut_of_a_message_is_refused() -> None:
    store = cdr.typestore()
    raw = cdr.in_a_list(cdr.joint_state_block(np.arange(1), ['LF_HAA'], np.ones((1, 1))))[0]
    # The last eight bytes are the two empty arrays behind position.
    for length in range(len(raw)):
        with pytest.raises(ValueError, match=r'cut off|plain CDR|array of'):
            Layout(store.fielddefs, cdr.JOINT_STATE, raw[:length])
        with pytest.raises(InputError, match=f'damaged .*JointState of {length} bytes'):
            cdr.deserialize(cdr.JOINT_STATE, raw[:length])


def test_definitions_are_found_in_a_workspace_before_the_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cdr.definitions().name == 'msg'
    installed = tmp_path / 'share' / 'drive_power_msgs' / 'msg'
    installed.mkdir(parents=True)
    (installed / 'DriveSupply.msg').write_text('uint8 x\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', os.pathsep.join(['/nowhere', str(tmp_path)]))
    assert cdr.definitions() == installed


def test_definitions_that_are_nowhere_are_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cdr, '__file__', str(tmp_path / 'cdr.py'))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    with pytest.raises(InputError, match='source the workspace'):
        cdr.definitions()


def test_wrong_fields_and_types_are_quoted() -> None:
    with pytest.raises(InputError, match=r"no field 'torque'.*effort"):
        cdr.message(cdr.JOINT_STATE, torque=[1.0])
    with pytest.raises(InputError, match=r"unknown message type 'sensor_msgs/Joints'"):
        cdr.full_name('sensor_msgs/Joints')
    assert cdr.full_name('sensor_msgs/JointState') == cdr.JOINT_STATE
    with pytest.raises(InputError, match='samples_per_message is 0'):
        cdr.in_a_list(
            *cdr.drive_supply_blocks(
                np.arange(1), 0, np.arange(1), 'a', 0, 0, samples_per_message=0
            )
        )
    with pytest.raises(InputError, match='cannot serialize'):
        cdr.serialize(cdr.JOINT_STATE, cdr.message(cdr.BATTERY_STATE))


def test_no_messages_make_no_bytes() -> None:
    assert (
        cdr.in_a_list(cdr.joint_state_block(np.zeros(0, np.int64), 'ab', np.zeros((0, 2)))) == []
    )
