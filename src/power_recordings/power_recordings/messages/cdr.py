"""Encoding and decoding of messages as CDR bytes, without ROS."""

import os
import re
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags import typesys
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore
from wattwalk_core.arrays import Floats, Stamps
from wattwalk_core.errors import InputError

from power_recordings.messages.cdr_layout import Bytes, Layout

JOINT_STATE = 'sensor_msgs/msg/JointState'
BATTERY_STATE = 'sensor_msgs/msg/BatteryState'
IMU = 'sensor_msgs/msg/Imu'
ODOMETRY = 'nav_msgs/msg/Odometry'
TWIST_STAMPED = 'geometry_msgs/msg/TwistStamped'
DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'
DRIVE_SUPPLY = 'drive_power_msgs/msg/DriveSupply'
POWER_ESTIMATE = 'drive_power_msgs/msg/PowerEstimate'
VECTORS: Final = {
    IMU: (('orientation', 'xyzw'), ('angular_velocity', 'xyz'), ('linear_acceleration', 'xyz')),
    ODOMETRY: (
        *(('pose.pose.position', 'xyz'), ('pose.pose.orientation', 'xyzw')),
        *(('twist.twist.linear', 'xyz'), ('twist.twist.angular', 'xyz')),
    ),
    TWIST_STAMPED: (('twist.linear', 'xy'), ('twist.angular', 'z')),
}
"""Paths and axes of the vectors in messages that hold nothing else."""
_PACKAGE = 'drive_power_msgs'


def definitions() -> Path:
    """Return the folder of drive_power_msgs' .msg files: of ROS, the checkout or the wheels.

    Raises InputError if there is none.
    """
    prefixes = [Path(p) for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    folders = [prefix / 'share' / _PACKAGE / 'msg' for prefix in prefixes]
    above = [parent / _PACKAGE for parent in Path(__file__).resolve().parents]
    folders += [folder / name for folder in above for name in ('msg', 'definitions')]
    for folder in folders:
        if (folder / 'DriveSupply.msg').is_file():
            return folder
    raise InputError(
        f'cannot find the messages of {_PACKAGE}: source the workspace that holds it '
        '(AMENT_PREFIX_PATH), or pip install wattwalk-embedded'
    )


@cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy and of drive_power_msgs."""
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for file in sorted(definitions().glob('*.msg')):
        store.register(typesys.get_types_from_msg(file.read_text(), f'{_PACKAGE}/msg/{file.stem}'))
    return store


def vector_paths(type_name: str) -> tuple[str, ...]:
    """Return the paths of all numbers of a type of VECTORS."""
    return tuple(f'{path}.{axis}' for path, axes in VECTORS[type_name] for axis in axes)


def full_type(name: str) -> str:
    """Return `package/msg/Type` for the name of a type as ROS 1 or ROS 2 has it."""
    package, slash, rest = name.partition('/')
    return f'{package}/msg/{rest}' if slash and '/' not in rest else name


def full_name(type_name: str) -> str:
    """Return `package/msg/Type` for that or `package/Type`; InputError if unknown."""
    name = full_type(type_name)
    if name not in typestore().fielddefs:
        raise InputError(f'unknown message type {type_name!r}; expected e.g. {JOINT_STATE!r}')
    return name


@cache
def definition(type_name: str) -> str:
    """Return a type's `ros2msg` definition with nested types; InputError for an unknown type."""
    return str(typestore().generate_msgdef(full_name(type_name), ros_version=2)[0])


@cache
def type_hash(type_name: str) -> str:
    """Return the type's RIHS01 hash (REP-2016); InputError for an unknown type."""
    return str(typestore().hash_rihs01(full_name(type_name)))


def serialize(type_name: str, message: Any) -> bytes:
    """Return the CDR bytes (little-endian, with encapsulation header) of what `message` built.

    Raises InputError if the type is unknown, or a field is missing or of a wrong type.
    """
    try:
        return bytes(typestore().serialize_cdr(message, full_name(type_name)))
    except (SerdeError, AttributeError, TypeError, ValueError, AssertionError) as error:
        raise InputError(f'cannot serialize a {type_name}: {error}') from error


def deserialize(type_name: str, cdr: bytes | memoryview) -> Any:
    """Decode a message, numeric arrays as numpy arrays; InputError if it is damaged."""
    try:
        return typestore().deserialize_cdr(bytes(cdr), full_name(type_name))
    except (SerdeError, AssertionError, IndexError) as error:
        raise InputError(f'damaged {type_name} of {len(cdr)} bytes: {error}') from error


def message(type_name: str, **values: Any) -> Any:
    """Build a message with the given fields; the others are zero or empty.

    Nested messages may be dicts of their fields, numeric arrays any array-like.
    Raises InputError for a field that the type does not have.
    """
    name = full_name(type_name)
    fields = dict(typestore().fielddefs[name][1])
    if unknown := values.keys() - fields.keys():
        raise InputError(f'{type_name} has no field {min(unknown)!r}; it has {", ".join(fields)}')
    built = {key: _field(desc, values.get(key)) for key, desc in fields.items()}
    return typestore().types[name](**built)


def _field(desc: Any, value: Any) -> Any:
    kind, rest = desc
    if kind == Nodetype.BASE:
        empty: Any = '' if rest[0] == 'string' else False if rest[0] == 'bool' else 0
        return empty if value is None else value
    if kind == Nodetype.NAME:
        if value is None or isinstance(value, Mapping):
            return message(rest, **(value or {}))
        return value
    (item_kind, item), count = rest
    if item_kind == Nodetype.NAME or item[0] == 'string':
        length = count if kind == Nodetype.ARRAY else 0
        return [
            _field((item_kind, item), v) for v in ([None] * length if value is None else value)
        ]
    dtype = np.uint8 if item[0] in ('byte', 'octet', 'char') else np.dtype(item[0])
    if value is None:
        return np.zeros(count if kind == Nodetype.ARRAY else 0, dtype)
    return np.ascontiguousarray(value, dtype)


def encode_block(
    type_name: str, stamps_ns: Stamps, columns: Mapping[str, ArrayLike], **constant: Any
) -> Bytes:
    """Encode N messages that differ in numbers only as CDR bytes, uint8 [N, size].

    stamps_ns [N]: of the headers. columns: values by dotted path of a field, [N] or [N, length].
    constant: fields that all messages share, as for `message`; they set the lengths of arrays.
    InputError for a wrong field, KeyError for an unknown column, ValueError for a wrong shape.
    """
    stamps = np.asarray(stamps_ns, np.int64)
    layout = Layout(
        typestore().fielddefs,
        full_name(type_name),
        serialize(type_name, message(type_name, **constant)),
    )
    seconds, nanoseconds = np.divmod(stamps, 1_000_000_000)
    stamp = {'header.stamp.sec': seconds, 'header.stamp.nanosec': nanoseconds}
    return layout.encode(len(stamps), {**stamp, **columns})


def in_a_list(*blocks: Bytes) -> list[bytes]:
    """Return the messages of blocks [N, size] as one list of bytes, in order."""
    rows = ((block.tobytes(), block.shape[1]) for block in blocks)
    return [raw[i : i + size] for raw, size in rows for i in range(0, len(raw), size)]


def joint_state_block(
    stamps_ns: Stamps,
    names: Sequence[str],
    position: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    frame_id: str = '',
) -> Bytes:
    """Encode N sensor_msgs/JointState of D joints as CDR bytes, uint8 [N, size].

    stamps_ns [N]; position rad, velocity rad/s, effort N·m [N, D]; None: an empty array. The type
    serves joint_commands (position only), motor_current (effort: A) and foot_force (effort: N).
    """
    given = {'position': position, 'velocity': velocity, 'effort': effort}
    columns = {field: np.asarray(values) for field, values in given.items() if values is not None}
    lengths = {field: np.zeros(len(names)) for field in columns}
    header = {'frame_id': frame_id}
    return encode_block(
        JOINT_STATE, stamps_ns, columns, header=header, name=list(names), **lengths
    )


def drive_supply_blocks(
    stamps_ns: Stamps,
    sequence0: int,
    device_time: NDArray[np.uint64],
    names: Sequence[str],
    voltage: ArrayLike,
    current: ArrayLike,
    temperature: ArrayLike | None = None,
    status: ArrayLike | None = None,
    samples_per_message: int = 1,
    frame_id: str = '',
) -> list[Bytes]:
    """Encode N samples of D drives as ceil(N / samples_per_message) drive_power_msgs/DriveSupply.

    Returns a block uint8 [messages, size] of full messages and, for samples left over, a block
    with one message. stamps_ns, device_time [N] ns; voltage V, current A, status [N, D] (0 =
    good); temperature °C [D] or [N, D] (of a message's first sample), None if unknown. sequence0
    is the index of sample 0. InputError for samples_per_message below 1.
    """
    size = samples_per_message
    if size < 1:
        raise InputError(f'samples_per_message is {size}; it must be at least 1')
    stamps = np.asarray(stamps_ns, np.int64)
    samples, drives = len(stamps), len(names)
    whole = samples - samples % size
    shape = (samples, drives)
    volts, amps = (np.broadcast_to(np.asarray(x, np.float32), shape) for x in (voltage, current))
    flags = np.broadcast_to(np.asarray(0 if status is None else status, np.uint8), shape)
    celsius = np.zeros((samples, 0), np.float32)
    if temperature is not None and np.size(temperature):
        celsius = np.broadcast_to(np.asarray(temperature, np.float32), shape)
    sequence = np.arange(sequence0, sequence0 + samples, dtype=np.uint64)
    blocks: list[Bytes] = []
    for rows, length in ((slice(whole), size), (slice(whole, None), samples - whole)):
        if not length:
            continue
        columns: dict[str, NDArray[Any]] = {
            'sequence': sequence[rows][::length],
            'device_time': np.asarray(device_time, np.uint64)[rows].reshape(-1, length),
            'voltage': volts[rows].reshape(-1, length * drives),
            'current': amps[rows].reshape(-1, length * drives),
            'temperature': celsius[rows][::length],
            'status': flags[rows].reshape(-1, length * drives),
        }
        arrays = {path: np.zeros(x.shape[1]) for path, x in columns.items() if x.ndim == 2}
        blocks.append(
            encode_block(
                DRIVE_SUPPLY,
                stamps[rows][::length],
                columns,
                header={'frame_id': frame_id},
                name=list(names),
                **arrays,
            )
        )
    return blocks


def battery_block(stamps_ns: Stamps, voltage: ArrayLike, current: ArrayLike) -> Bytes:
    """Encode N sensor_msgs/BatteryState as uint8 [N, size]: V [N], A [N], negative if drawn."""
    unmeasured = ('temperature', 'charge', 'capacity', 'design_capacity', 'percentage')
    return encode_block(
        BATTERY_STATE,
        stamps_ns,
        {'voltage': voltage, 'current': current},
        power_supply_status=2,
        present=True,
        **dict.fromkeys(unmeasured, np.nan),
    )


def imu_block(
    stamps_ns: Stamps, orientation: Floats, angular_velocity: Floats, linear_acceleration: Floats
) -> Bytes:
    """Encode N sensor_msgs/Imu of `base`: quaternion x y z w [N, 4], rad/s and m/s² [N, 3]."""
    values = (orientation, angular_velocity, linear_acceleration)
    return encode_block(IMU, stamps_ns, _by_axis(IMU, *values), header={'frame_id': 'base'})


def odometry_block(
    stamps_ns: Stamps,
    position: Floats,
    orientation: Floats,
    linear_velocity: Floats,
    angular_velocity: Floats,
) -> Bytes:
    """Encode N nav_msgs/Odometry: pose in `odom`, twist in `base`.

    m, m/s and rad/s [N, 3]; quaternion x y z w [N, 4].
    """
    columns = _by_axis(ODOMETRY, position, orientation, linear_velocity, angular_velocity)
    frames: dict[str, Any] = {'header': {'frame_id': 'odom'}, 'child_frame_id': 'base'}
    return encode_block(ODOMETRY, stamps_ns, columns, **frames)


def twist_block(stamps_ns: Stamps, velocity: Floats) -> Bytes:
    """Encode N geometry_msgs/TwistStamped of `base`, [N, 3]: vx, vy m/s, yaw rate rad/s."""
    columns = _by_axis(TWIST_STAMPED, velocity[:, :2], velocity[:, 2:])
    return encode_block(TWIST_STAMPED, stamps_ns, columns, header={'frame_id': 'base'})


def _by_axis(type_name: str, *vectors: Floats) -> dict[str, Floats]:
    """Return the columns of a type of VECTORS by path, from one array [N, axes] a vector."""
    return dict(zip(vector_paths(type_name), np.hstack(vectors).T, strict=True))


_LARGEST: Final = 128 << 10  # bytes of a definition without blank lines
_BLANK = re.compile(r'(\r?\n)[ \t\r\n]+')
_SEPARATOR: Final = '=' * 80 + '\n'

Fields = Mapping[str, Any]


@lru_cache(64)
def own_fields(text: str, type_name: str) -> Fields:
    """Parse a type's definition, with nested types, to their fields by type name.

    text: a ROS 1 or 2 message, or IDL as rosbag2 writes it. ValueError for any other, or for more
    than 128 KiB.
    """
    text = _BLANK.sub(r'\1', text)
    if len(text) > _LARGEST:
        raise ValueError(f'{len(text) >> 10} KiB; at most {_LARGEST >> 10} are read')
    try:
        if text.startswith(f'{_SEPARATOR}IDL: '):
            parts = [part.split('\n', 1)[-1] for part in text.split(_SEPARATOR)[1:]]
            return {k: v for part in parts for k, v in typesys.get_types_from_idl(part).items()}
        return dict(typesys.get_types_from_msg(text, type_name))
    except (typesys.TypesysError, KeyError, RecursionError) as error:
        raise ValueError(str(error)) from None


def fields_of(text: str, type_name: str, given: Fields) -> Fields:
    """Return the fields, by type name, of all types that a message may need.

    text, the bag's own definition ('' if none), takes precedence over `given`, and that over ROS 2
    Jazzy's and this suite's types. ValueError as of `own_fields`.
    """
    own = own_fields(text, type_name) if text else {}
    return {**typestore().fielddefs, **given, **own}
