"""Message types of the suite's topics, by name."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from wattwalk_core.errors import InputError

JOINT_STATE = 'sensor_msgs/msg/JointState'
BATTERY_STATE = 'sensor_msgs/msg/BatteryState'
IMU = 'sensor_msgs/msg/Imu'
ODOMETRY = 'nav_msgs/msg/Odometry'
TWIST_STAMPED = 'geometry_msgs/msg/TwistStamped'
DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'
DRIVE_SUPPLY = 'drive_power_msgs/msg/DriveSupply'
POWER_ESTIMATE = 'drive_power_msgs/msg/PowerEstimate'

TYPES: Mapping[str, str] = {
    'drive_supply': DRIVE_SUPPLY,
    'joint_states': JOINT_STATE,
    'joint_commands': JOINT_STATE,
    'supply': BATTERY_STATE,
    'power_estimate': POWER_ESTIMATE,
    'imu': IMU,
    'odom': ODOMETRY,
    'cmd_vel': TWIST_STAMPED,
    'foot_force': JOINT_STATE,
    'diagnostics': DIAGNOSTIC_ARRAY,
}


def message_class(type_name: str) -> Any:
    """Return the ROS class of `package/msg/Type`; InputError if its package is not there."""
    package, _, name = type_name.split('/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f'cannot record {type_name}: {error}; is {package} sourced?') from error
