"""The kinds of clocks."""

from enum import IntEnum


class ClockType(IntEnum):
    """ROS time follows /clock where asked to; steady time never steps."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3
